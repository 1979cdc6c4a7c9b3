"""Periodic records, and how much of each output is linear, distortion and noise.

The best linear approximation G of a level is the least-squares response of its realisations over a few
neighbouring lines, in which it is a parabola (local polynomial method). What is left of the mean period is
distortion and noise; what differs between the periods is noise alone. In lines that no input excites
everything but noise is distortion, even or odd by the number of the line. Cost: one small least-squares
problem a line.

Source: Pintelon and Schoukens, System Identification (2012).
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float
from numpy.typing import ArrayLike

from hysteresis import InputError
from hysteresis.dynamics._feedback import Lines

from .._levels import CHANCE, LITTLE
from ._feedback_search import Spectra
from ._measured_motion import check_period, period_of

SAME_LEVEL = 1.05
"""Inputs whose sizes differ by less have one level."""

UNSTEADY = 3.0
"""A test whose periods differ so many times as much as the median test's of its level is left out of a
fit."""


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
    """A record of rows cut into its periods, without a straight drift over them.

    - `u`: (rows, inputs). `y`: (rows, outputs). `dt`: time between rows.
    - `period`: rows of a period; None to look for it in the first input that moves.
    - `settling`: periods at the beginning that are left out.

    Raises `InputError` `not-periodic` where no whole period is left, `length-mismatch` for other lengths.

    **Example:**

        >>> row = np.sin(2 * np.pi * np.arange(96) / 32)
        >>> identify.periodic_test(row, 2 * row, dt=0.1, settling=1).y.shape
        (2, 32, 1)
    """
    u, y = (np.asarray(x, float).reshape(len(np.asarray(x)), -1) for x in (u, y))
    if len(u) != len(y) or not len(u):
        raise InputError(
            "length-mismatch",
            f"{len(u)} rows of inputs, {len(y)} of outputs.",
            fix="give one row of each a sample.",
        )
    moving = u[:, int(np.argmax(np.ptp(u, axis=0) > 0))]
    period = period_of(moving) if period is None else int(period)
    count = len(u) // period if period else 0
    if not count:
        raise InputError(
            "not-periodic",
            f"{len(u)} rows hold no whole period of the input.",
            fix="measure two periods in steady state, or give the rows of a period (--period N), and what"
            " tells one test from the next (--group COL).",
        )
    if not 0 <= settling < count:
        raise InputError(
            "bad-option",
            f"settling={settling} of {count} periods leaves none.",
            fix=f"leave out at most {count - 1}.",
        )
    check_period(moving, period)
    cut = [x[: count * period].reshape(count, period, -1)[settling:] for x in (u, y)]
    u, y = map(_without_drift, cut)
    return PeriodicTest(_without_noise(u), y, dt)


def _without_drift(x: Float[np.ndarray, "periods samples n"]) -> np.ndarray:
    """Periods without the usual step of their means, a straight drift, which is a sawtooth in each. Of two
    periods nothing tells it from what has not settled yet."""
    if len(x) <= 2:
        return x
    slope = np.median(np.diff(x.mean(1), axis=0), 0) / x.shape[1]
    row = np.arange(float(x[..., 0].size)).reshape(x.shape[:2])
    return x - slope * (row - row.mean())[..., None]


def _without_noise(u: Float[np.ndarray, "periods samples inputs"]) -> np.ndarray:
    """The mean period of inputs, without lines that are about the noise, in which nothing is excited."""
    if len(u) < 2:
        return u[0]
    each = np.fft.rfft(u, axis=1)
    # The power of a line of noise is gamma distributed: of a mean of periods by chance one beyond `most`.
    mean, free = each.mean(0), len(u) - 1
    power = np.median(each.var(0, ddof=1), 0) * free / scipy.special.gammaincinv(free, 0.5)
    most = np.log(len(mean) / CHANCE) * power / len(u)
    mean[1:][np.abs(mean[1:]) ** 2 < most] = 0
    return np.fft.irfft(mean, u.shape[1], axis=0)


def spectra_of(tests: Sequence[PeriodicTest], finer: int = 2) -> tuple[Spectra, np.ndarray]:
    """The tests in their lines, and the noise of each, (tests, lines, outputs): standard deviations of the
    mean period's lines, NaN of a single period.

    Raises `InputError` `length-mismatch` where tests differ in clock, period, inputs or outputs.
    """
    tests = [_checked(test, k) for k, test in enumerate(tests)]
    kinds = {(*t.u.shape, t.y.shape[2], round(float(t.dt), 15)) for t in tests}
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
    # Inputs of other units count alike, and one that rests is no level of its own.
    each = input_sizes(U, lines)
    level = _levels((each / np.maximum(each.max(0), 1e-300)).max(1))
    size = np.stack([np.sqrt((np.abs(Y[level == k][:, 1:]) ** 2).mean((0, 1))) for k in level])
    return Spectra(lines, U, Y, level, np.maximum(size, 1e-300)), noise


def _checked(test: PeriodicTest, k: int) -> PeriodicTest:
    """A test of finite numbers that fit each other."""
    u, y = np.asarray(test.u, float), np.asarray(test.y, float)
    if u.ndim != 2 or y.ndim != 3 or y.shape[1] != len(u) or not (u.size and y.size):
        raise InputError(
            "length-mismatch",
            f"u of the shape {u.shape}, y of {y.shape}.",
            place=f"test {k}",
            fix="give u (samples, inputs) and y (periods, samples, outputs), as periodic_test does.",
        )
    if not (np.isfinite(u).all() and np.isfinite(y).all() and test.dt > 0):
        raise InputError(
            "not-finite",
            "a number is missing or infinite, or the time between samples is not positive.",
            place=f"test {k}",
            fix="leave this test out, or measure it again.",
        )
    if not np.ptp(u) > 0 or not (np.ptp(y, axis=1) > 0).all():
        raise InputError(
            "constant-input" if not np.ptp(u) > 0 else "constant-output",
            "no input moves, or an output does not.",
            place=f"test {k}",
            fix="leave out what does not move.",
        )
    return PeriodicTest(u, y, float(test.dt))


def input_sizes(U: Any, lines: Lines) -> Float[np.ndarray, "tests inputs"]:
    """The root mean square of each input over a period, without its mean."""
    return np.sqrt(2 * (np.abs(U[:, 1:]) ** 2).sum(1)) / lines.samples


def _levels(size: np.ndarray) -> np.ndarray:
    """0 for the smallest size, one more where the next one is larger."""
    order = np.argsort(size)
    rise = np.diff(size[order], prepend=size[order[:1]]) > (SAME_LEVEL - 1) * size[order]
    level = np.empty(len(size), int)
    level[order] = np.cumsum(rise)
    return level


def steady_ones(data: Spectra, noise: np.ndarray) -> np.ndarray:
    """Which tests repeat themselves as well as the others of their level."""
    left = np.sqrt((noise[:, 1:] ** 2).sum(1) / data.size**2).mean(1)
    if np.isnan(left).any():
        return np.ones(len(left), bool)
    typical = np.array([np.median(left[data.level == k]) for k in data.level])
    return left <= UNSTEADY * typical


def excited_lines(U: Any, least: float = LITTLE) -> np.ndarray:
    """Numbers of the lines that some input excites, the constant one left out."""
    size = np.abs(U).max(0)
    size[0] = 0.0
    return np.flatnonzero((size > least * size.max(0)).any(1))


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
    rows = min(2 * half + 1, len(at))
    G = np.empty((len(at), Y.shape[2], nu), complex)
    left = np.empty((count, len(at), Y.shape[2]), complex)
    for k in range(len(at)):
        first = min(max(k - half, 0), len(at) - rows)
        near = at[first : first + rows]
        x = (near - at[k]) / max(half, 1)
        powers = np.stack([x**p for p in range(orders)], 1)
        wide = (powers[None, :, :, None] * U[:, near, None, :]).reshape(count * len(near), -1)
        right = Y[:, near].reshape(count * len(near), -1)
        found = np.linalg.lstsq(wide, right, rcond=None)[0]
        G[k] = found[:nu].T
        left[:, k] = Y[:, at[k]] - U[:, at[k]] @ found[:nu]
    return G, left, max(1 - orders * nu / (count * rows), 0.0)


class Distortion(NamedTuple):
    """Of one level, output and band: root mean squares of a period, in the output's unit.

    - `level`: root mean square of the inputs. `output`: which one. `band`: of frequencies.
    - `total`, `linear`: of all, and of what the best linear approximation of this level gives.
    - `changed`: by how much that differs from the approximation of the smallest level; 0 there.
    - `even`, `odd`: in even and odd lines that no input excites; NaN where there are none.
    - `stochastic`: what is not linear in excited lines, without noise: it differs from one realisation to
      the next, so the same one twice shows none. NaN of fewer lines than a window takes. `noise`: of the
      mean period; NaN of a single period, where it is in the others.
    - `smoothed`: whether the level has fewer than two realisations an input. The approximation is then
      smooth over some lines, and what it does not follow, such as a sharp resonance, is in `stochastic`.
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
    smoothed: bool


def distortion(tests: Sequence[PeriodicTest], bands: int = 4) -> list[Distortion]:
    """How much of each output is linear, distortion and noise, by level and band.

    The bands hold equally many excited lines and touch. Even and odd are told only where some such lines
    are not excited.

    Raises `InputError` `bad-option` for more bands than lines, and as `fit_feedback` for its tests.

    **Example:**

        >>> t = np.arange(256) / 256
        >>> rng = np.random.default_rng(0)
        >>> u = sum(np.cos(2 * np.pi * (k * t + rng.random())) for k in range(1, 40, 2))
        >>> test = identify.periodic_test(np.tile(u, 2), np.tile(u + 0.1 * u**2, 2), 0.01)
        >>> row = identify.distortion([test], bands=1)[0]
        >>> row.even > 10 * row.odd
        True
    """
    data, noise = spectra_of(tests)
    lines, at, found = data.lines, excited_lines(data.U), []
    if not 1 <= bands <= len(at):
        raise InputError(
            "bad-option",
            f"bands={bands} of {len(at)} excited lines.",
            fix=f"give a number from 1 to {len(at)} (--bands N).",
        )
    # Bands touch, and the last one has what lies above.
    ends = [int(part[0]) for part in np.array_split(at, bands)][1:]
    ends = [1, *ends, lines.count]
    lowest: Any = None
    for level in np.unique(data.level):
        own = data.level == level
        U, Y, e = data.U[own], data.Y[own], noise[own]
        G, left, free = linear_response(U, Y, at, U.shape[2])
        smoothed = len(U) < 2 * U.shape[2]
        scatter = left * np.sqrt((1 - free) / free) if free > 0 else 0 * left
        # An approximation follows a part of the scatter, which counts as neither linear nor changed.
        lowest = (G, scatter, U) if lowest is None else lowest
        there = np.sqrt((np.abs(U[:, at]) ** 2).mean() / (np.abs(lowest[2][:, at]) ** 2).mean())
        linear = (U[:, at, None, :] * G).sum(3)
        changed = (U[:, at, None, :] * (G - lowest[0])).sum(3)
        rms = float(np.sqrt((input_sizes(U, lines) ** 2).mean()))
        for first, end in pairwise(ends):
            inside = np.arange(first, end)
            part = (at >= first) & (at < end)
            quiet = np.setdiff1d(inside, at)
            parity = [quiet[quiet % 2 == odd] for odd in (0, 1)]
            total, own_scatter = _size(Y[:, inside], lines), _size(scatter[:, part], lines)
            rest = _size(left[:, part], lines) / np.sqrt(free) if free > 0 else np.nan * total
            low = there * _size(lowest[1][:, part], lines)
            columns = [
                total,
                _without(_size(linear[:, part], lines), own_scatter),
                _without(_size(changed[:, part], lines), np.hypot(own_scatter, low)),
                *(
                    _without(_size(Y[:, x], lines), _size(e[:, x], lines))
                    if len(x) else np.nan * total
                    for x in parity
                ),
                _without(rest, _size(e[:, at[part]], lines)),
                _size(e[:, inside], lines),
            ]  # fmt: skip
            band = first / lines.period, (end - 1) / lines.period
            for k, figures in enumerate(np.stack(columns, 1).tolist()):
                found.append(Distortion(rms, k, band, *figures, smoothed=smoothed))
    return found


def _without(size: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """The root of a difference of squares; noise that is not known counts as none."""
    return np.sqrt(np.maximum(size**2 - np.nan_to_num(noise) ** 2, 0.0))


def _size(x: Any, lines: Lines) -> np.ndarray:
    """The root mean square over a period of signals with these lines (realisations, lines, signals)."""
    return np.sqrt(2 * (np.abs(x) ** 2).sum(1).mean(0)) / lines.samples
