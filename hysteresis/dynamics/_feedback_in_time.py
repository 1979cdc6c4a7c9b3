"""A `Feedback` model from rest, under any input: the reactions of a window of fine steps at once.

    x_(k+1) = e^(p h) x_k + b (v straight from v_k to v_(k+1)),     v = [u; w(z)],     z = 2 Re(shapes x) +
    direct u

The modes step exactly. Within a window the reactions are found as a fixed point: laws over drives, modes
over reactions, in turn; a window that does not settle is halved (waveform relaxation, Lelarasmee et al.
1982). Cost: some six passes of the laws. Straight lines between fine steps lose (pi f h)^2 / 3 of a
component f.
"""

from typing import Any

import numpy as np
import scipy
from jaxtyping import Float

from .._errors import InputError
from ..running import run
from ._recorder import interpolated

CLOSE, TURNS = 1e-9, 24
"""Part of the largest reaction so far by which the last turn changes it, and the turn at which a window is
given up."""

FIRST, LONGEST = 32, 1024
"""Fine steps of a window."""


def in_time(
    model: Any, u: Float[np.ndarray, "samples inputs"], dt: float, finer: int
) -> Float[np.ndarray, "samples outputs"]:
    """The outputs of a `Feedback` model from rest, as its `simulate` says."""
    h = dt / finer
    fine = np.stack([interpolated(x, finer) for x in u.T], 1)
    motion = _Run(model, fine, h)
    begin, window = 0, FIRST
    while begin < len(fine) - 1:
        end = min(begin + window, len(fine) - 1)
        with np.errstate(over="ignore", invalid="ignore"):  # a window too long is halved
            turns = motion.window(begin, end)
        if turns:
            begin, window = end, min(window * 2, LONGEST) if turns < TURNS // 3 else window
        elif window > 1:
            window //= 2
        else:
            raise InputError(
                "diverged",
                f"the reactions do not settle within a step at row {begin // finer}.",
                cause="the channels' gain around the loop is too large at this amplitude.",
                fix="give a smaller input, or more fine steps.",
            )
    ny, t = model.outputs, h * np.arange(len(fine))
    y = 2 * (motion.x @ model.shapes[:ny].T).real + motion.v @ model.direct[:ny].T
    if model.delay and len(t) > 1:
        y = scipy.interpolate.CubicSpline(t, y)(t - model.delay)
    return (y * (t >= model.delay)[:, None])[::finer]


class _Run:
    """Modes x and signals v = [u; w] over the fine steps so far, and what the channels remember."""

    def __init__(self, model: Any, fine: Float[np.ndarray, "fine inputs"], h: float):
        self.model, self.h, self.steps = model, h, _steps(model.poles, h)
        n = len(model.channels)
        self.x = np.zeros((len(fine), len(model.poles)), complex)
        self.v = np.concatenate([fine, np.zeros((len(fine), n))], 1)
        self.drives = fine @ model.direct[model.outputs :, : model.inputs].T
        self.laws, self.squares, self.largest = [*model.laws()], [0.0] * n, 1e-300
        w, (self.laws, self.squares) = self._reactions(self.drives[:1], np.nan)
        self.v[0, model.inputs :] = w

    def window(self, begin: int, end: int) -> int:
        """Settle the reactions after `begin` up to `end`: the turns that it took, 0 where it did not."""
        model, now = self.model, slice(begin + 1, end + 1)
        w = np.repeat(self.v[begin : begin + 1, model.inputs :], end - begin, 0)
        for turn in range(1, TURNS):
            self.v[now, model.inputs :] = w
            self._modes(begin, end)
            z = self.drives[now] + 2 * (self.x[now] @ model.shapes[model.outputs :].T).real
            new, after = self._reactions(z, self.h)
            self.largest = max(self.largest, float(np.abs(new).max(initial=0.0)))
            apart, w = np.abs(new - w).max(initial=0.0), new
            if apart < CLOSE * self.largest:
                self.laws, self.squares = after
                return turn
        return 0

    def _modes(self, begin: int, end: int) -> None:
        grow, held, rise = self.steps
        each = self.v[begin : end + 1] @ self.model.entries.T
        forced = held * each[:-1] + rise * np.diff(each, axis=0)
        for m, g in enumerate(grow):
            first = [g * self.x[begin, m]]
            moved, _ = scipy.signal.lfilter([1.0], [1.0, -g], forced[:, m], zi=first)
            self.x[begin + 1 : end + 1, m] = moved

    def _reactions(
        self, z: np.ndarray, h: float
    ) -> tuple[np.ndarray, tuple[list[Any], list[float]]]:
        """w over drives (rows, channels), and what the channels remember then."""
        w, laws, squares = np.empty_like(z), [], []
        stays = np.exp(-h / self.model.memory) if h == h else 0.0
        for i, numbers in enumerate(self.laws):
            found = run(numbers, z[:, i], np.full(len(z), h))
            first = [stays * self.squares[i]]
            square = scipy.signal.lfilter([1 - stays], [1.0, -stays], z[:, i] ** 2, zi=first)[0]
            slow = 0.5 * np.log(np.maximum(square, 1e-300))
            w[:, i] = found.value + self.model.levels[i] * z[:, i] * slow
            laws.append(numbers._replace(m=found.m))
            squares.append(float(square[-1]))
        return w, (laws, squares)


def _steps(poles: Any, h: float) -> tuple[Any, ...]:
    """e^(p h); the response at h of x' = p x + 1, and of x' = p x + t / h."""
    each = np.zeros((len(poles), 3, 3), complex)  # of x, t / h and 1 together (Van Loan 1978)
    each[:, 0, 0], each[:, 0, 1], each[:, 1, 2] = poles * h, h, 1.0
    return tuple(scipy.linalg.expm(each)[:, 0].T)
