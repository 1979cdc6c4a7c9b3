"""Periodic records of several inputs and outputs, and how much of an output is linear, distortion and
noise.

The best linear approximation G of a level is the least-squares response of its realisations over a few
neighbouring lines, in which it is a parabola (local polynomial method). What is left of the mean period is
distortion and noise; what differs between the periods is noise alone. In lines that no input excites
everything but noise is distortion, even or odd by the number of the line. Cost: one small least-squares
problem a line.

Source: Pintelon and Schoukens, System Identification (2012).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from hysteresis import InputError
from hysteresis.dynamics._feedback import Lines

from ._feedback_search import Spectra
from ._measured_motion import period_of

EXCITED = 1e-3
"""Part of the largest line of an input from which a line is excited."""

SAME_LEVEL = 1.05
"""Inputs whose sizes differ by less have one level."""

UNSTEADY = 3.0
"""A record whose periods differ so many times as much as the median record's is left out of a fit."""


class PeriodicTest(NamedTuple):
    """One realisation of a periodic excitation in steady state.

    - `u`: (samples, inputs), one period. `y`: (periods, samples, outputs). `dt`: time between samples.
    """

    u: Float[np.ndarray, "samples inputs"]
    y: Float[np.ndarray, "periods samples outputs"]
    dt: float


def periodic_test(
    u: ArrayLike, y: ArrayLike, dt: float, period: int | None = None, settling: int = 0
) -> PeriodicTest:
    """A record of rows cut into its periods.

    - `u`: (rows, inputs). `y`: (rows, outputs). `dt`: time between rows.
    - `period`: rows of a period; None to look for it in the first input.
    - `settling`: periods at the beginning that are left out.

    Raises `InputError` `not-periodic` where no whole period is left, `length-mismatch` for other lengths.

    **Example:**

        >>> row = np.sin(2 * np.pi * np.arange(96) / 32)
        >>> identify.periodic_test(row, 2 * row, dt=0.1, settling=1).y.shape
        (2, 32, 1)
    """
    u, y = (np.asarray(x, float).reshape(len(np.asarray(x)), -1) for x in (u, y))
    if len(u) != len(y):
        raise InputError(
            "length-mismatch",
            f"{len(u)} rows of inputs, {len(y)} of outputs.",
            fix="give one row of each a sample.",
        )
    period = period_of(u[:, 0]) if period is None else period
    count = len(u) // period - settling if period else 0
    if count < 1:
        raise InputError(
            "not-periodic",
            f"{len(u)} rows hold no whole period of the input.",
            fix="measure two periods in steady state, or give the rows of a period (--period N).",
        )
    rows = slice(settling * period, (settling + count) * period)
    cut = [x[rows].reshape(count, period, -1) for x in (u, y)]
    return PeriodicTest(cut[0].mean(0), cut[1], dt)


def spectra_of(tests: Sequence[PeriodicTest], finer: int = 2) -> tuple[Spectra, np.ndarray]:
    """The tests in their lines, and the noise of each, (tests, lines, outputs): standard deviations of the
    mean period's lines, NaN of a single period.

    Raises `InputError` `length-mismatch` where tests differ in clock, period, inputs or outputs.
    """
    kinds = {(*t.u.shape, t.y.shape[1], t.y.shape[2], round(float(t.dt), 15)) for t in tests}
    if len(kinds) != 1:
        raise InputError(
            "length-mismatch",
            "the tests differ in clock, period, inputs or outputs, or there is none.",
            fix="give tests of one rig with one period.",
        )
    lines = Lines(len(tests[0].u), float(tests[0].dt), finer)
    U = np.stack([lines.of(t.u) for t in tests])
    Y = np.stack([lines.of(t.y.mean(0)) for t in tests])
    noise = np.full(Y.shape, np.nan)
    for k, t in enumerate(tests):
        if len(t.y) > 1:
            each = np.stack([lines.of(y) for y in t.y])
            noise[k] = np.sqrt(each.var(0, ddof=1) / len(t.y))
    level = _levels(np.sqrt((np.abs(U[:, 1:]) ** 2).sum((1, 2))))
    size = np.stack([np.sqrt((np.abs(Y[level == k][:, 1:]) ** 2).mean((0, 1))) for k in level])
    return Spectra(lines, U, Y, level, np.maximum(size, 1e-300)), noise


def _levels(size: np.ndarray) -> np.ndarray:
    """0 for the smallest size, one more where the next one is larger."""
    order = np.argsort(size)
    rise = np.diff(size[order], prepend=size[order[:1]]) > (SAME_LEVEL - 1) * size[order]
    level = np.empty(len(size), int)
    level[order] = np.cumsum(rise)
    return level


def steady_ones(data: Spectra, noise: np.ndarray) -> np.ndarray:
    """Which tests repeat themselves as well as the others."""
    share = np.sqrt((noise[:, 1:] ** 2).sum((1, 2)) / (np.abs(data.Y[:, 1:]) ** 2).sum((1, 2)))
    if np.isnan(share).any():
        return np.ones(len(share), bool)
    return share <= UNSTEADY * np.median(share)


def excited_lines(U: Any) -> np.ndarray:
    """Numbers of the lines that some input excites, the constant one left out."""
    size = np.abs(U).max((0, 2))
    size[0] = 0.0
    return np.flatnonzero(size > EXCITED * size.max())


def linear_response(U: Any, Y: Any, at: np.ndarray, spare: int) -> tuple[Any, Any, float]:
    """G (lines, outputs, inputs) at the lines `at`, what it leaves of Y there (realisations, lines,
    outputs), and the degrees of freedom of that, as a part of its equations.

    A window is one line where that has `spare` more realisations than inputs, else as many as a parabola
    needs.
    """
    count, nu = len(U), U.shape[2]
    half, orders = 0, 1
    if count < nu + spare:
        half, orders = -(-3 * (nu + 1) // (2 * count)) + 1, 3
    rows = 2 * half + 1
    G, left = (
        np.empty((len(at), Y.shape[2], nu), complex),
        np.empty((count, len(at), Y.shape[2]), complex),
    )
    for k in range(len(at)):
        first = min(max(k - half, 0), max(len(at) - rows, 0))
        near = at[first : first + rows]
        x = (near - at[k]) / max(half, 1)
        powers = np.stack([x**p for p in range(orders)], 1)
        wide = (powers[None, :, :, None] * U[:, near, None, :]).reshape(count * len(near), -1)
        right = Y[:, near].reshape(count * len(near), -1)
        found = np.linalg.lstsq(wide, right, rcond=None)[0]
        G[k] = found[:nu].T
        left[:, k] = Y[:, at[k]] - U[:, at[k]] @ found[:nu]
    return G, left, 1 - min(orders * nu / (count * rows), 1)


class Distortion(NamedTuple):
    """Of one level, output and band: root mean squares of a period, in the output's unit.

    - `level`: root mean square of the inputs. `output`: which one. `band`: of frequencies.
    - `total`, `linear`: of all, and of what the best linear approximation of this level gives.
    - `changed`: by how much that differs from the approximation of the smallest level; 0 there.
    - `even`, `odd`: in even and odd lines that no input excites; NaN where there are none.
    - `stochastic`: what is not linear in excited lines, without noise. `noise`: of the mean period; NaN of
      a single period, where it is in the others.
    """

    level: float
    output: int
    band: tuple[float, float]
    total: float
    linear: float
    changed: float
    even: float
    odd: float
    stochastic: float
    noise: float


def distortion(tests: Sequence[PeriodicTest], bands: int = 4) -> list[Distortion]:
    """How much of each output is linear, distortion and noise, by level and band.

    The bands hold equally many excited lines. Even and odd are told only where some lines are not excited.

    Raises `InputError` as `spectra_of`.

    **Example:**

        >>> t = np.arange(256) / 256
        >>> rng = np.random.default_rng(0)
        >>> u = sum(np.cos(2 * np.pi * (k * t + rng.random())) for k in range(1, 40, 2))
        >>> test = identify.PeriodicTest(u[:, None], np.tile((u + 0.1 * u**2)[None, :, None], (2, 1, 1)),
        0.01)
        >>> row = identify.distortion([test], bands=1)[0]
        >>> row.even > 10 * row.odd
        True
    """
    data, noise = spectra_of(tests)
    at, lowest, found = excited_lines(data.U), None, []
    for level in np.unique(data.level):
        own = data.level == level
        U, Y, e = data.U[own], data.Y[own], noise[own]
        G, left, free = linear_response(U, Y, at, U.shape[2])
        lowest = G if lowest is None else lowest
        linear, changed = ((U[:, at, None, :] * response).sum(3) for response in (G, G - lowest))
        rms = float(_size(U[:, 1:], data.lines).mean())
        for part in np.array_split(np.arange(len(at)), bands):
            ends = (int(at[part[0]]), int(at[part[-1]])) if bands > 1 else (1, data.lines.count - 1)
            inside = np.arange(ends[0], ends[1] + 1)
            quiet = np.setdiff1d(inside, at)
            chosen = [at[part], *(quiet[quiet % 2 == odd] for odd in (0, 1))]
            total = _size(Y[:, inside], data.lines)
            rest = _size(left[:, part], data.lines) / np.sqrt(free) if free > 0 else np.nan * total
            found_in = rest, *(_size(Y[:, x], data.lines) for x in chosen[1:])
            # Without the noise of the same lines.
            stochastic, even, odd = (
                np.sqrt(np.maximum(x**2 - np.nan_to_num(_size(e[:, at_], data.lines)) ** 2, 0.0))
                if len(at_) else np.nan * total
                for x, at_ in zip(found_in, chosen, strict=True)
            )  # fmt: skip
            columns = [
                total, _size(linear[:, part], data.lines), _size(changed[:, part], data.lines), even,
                odd, stochastic, _size(e[:, inside], data.lines),
            ]  # fmt: skip
            band = ends[0] / data.lines.period, ends[1] / data.lines.period
            for k, figures in enumerate(np.stack(columns, 1).tolist()):
                found.append(Distortion(rms, k, band, *figures))
    return found


def _size(x: Any, lines: Lines) -> np.ndarray:
    """The root mean square over a period of signals with these lines (realisations, lines, signals)."""
    return np.sqrt(2 * (np.abs(x) ** 2).sum(1).mean(0)) / lines.samples
