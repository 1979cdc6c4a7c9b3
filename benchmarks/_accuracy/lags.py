"""Lags between two clocks: found where there is one, and none made of hysteresis.

Curves, sliders, relaxing branches and both of them are moved in five ways, two of them of a single rate,
with and without a lag, and fitted in both directions.
"""

import itertools
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

import identify
from hysteresis import PrandtlIshlinskii, Record

from .._measure import Row, judged, noted

LAGS = "lags between two clocks"
"""What `--only` has to be part of for these rows."""

STEP, ROWS, FINE = 0.02, 1200, 5
"""Sampling step, samples, and steps of the physics in each."""

LAG = 5 * STEP
NOISE = 0.001
"""Standard deviation of both readings, of their ranges."""

ONE_RATE = ("sine", "even triangles")

Samples = Float[np.ndarray, " samples"]


def _uneven() -> tuple[Samples, Samples]:
    random = np.random.default_rng(3)
    t = np.cumsum(np.append(0, random.uniform(0.4, 2.0, 60)))
    heights = np.where(np.arange(61) % 2, random.uniform(0.5, 1.0, 61), random.uniform(0, 0.35, 61))
    return t, np.append(0.0, heights[1:])


MOTIONS: dict[str, Callable[[Samples], Samples]] = {
    "sine": lambda t: 0.5 - 0.5 * np.cos(2 * np.pi * t / 2.4),
    "beat": lambda t: 0.5 - 0.5 * np.cos(2 * np.pi * t / 2.4) * (0.6 + 0.4 * np.cos(2 * np.pi * t / 17)),
    "sweep": lambda t: 0.5 - 0.5 * np.cos(2 * np.pi * (0.2 * t + 0.012 * t**2)),
    "uneven triangles": lambda t: np.interp(t, *_uneven()),
    "even triangles": lambda t: np.interp(t, 1.2 * np.arange(61), np.arange(61) % 2.0),
}  # fmt: skip

SLIDERS = PrandtlIshlinskii(
    np.array([0.03, 0.08, 0.2, 0.4]), np.array([0.15, 0.15, 0.1, 0.1]), slope=0.6
)


def _sliders(u: Samples) -> Samples:
    return np.asarray(SLIDERS.simulate(None, u))


def _branches(u: Samples, times: tuple[float, ...], springs: tuple[float, ...]) -> Samples:
    y = u + 0.3 * u**3
    for tau, spring in zip(times, springs, strict=True):
        a = np.exp(-STEP / FINE / tau)
        y = y + spring * np.asarray(lfilter([1.0], [1.0, -a], np.diff(u, prepend=u[0])))
    return y


PHYSICS: dict[str, Callable[[Samples], Samples]] = {
    "curve": lambda u: u + 0.5 * u**2,
    "sliders": _sliders,
    "branches": lambda u: _branches(u, (0.1, 0.8, 6.0), (0.3, 0.3, 0.4)),
    "both": lambda u: 0.6 * _sliders(u) + _branches(u, (0.3, 3.0), (0.4, 0.3)),
}


def _found(lag: float) -> Iterator[tuple[str, float]]:
    """The motion, and the lag that a fit takes out, in steps, of each record and direction."""
    fine = STEP / FINE * np.arange(ROWS * FINE)
    t = STEP * np.arange(ROWS)
    for motion, physics in itertools.product(MOTIONS, PHYSICS):
        u = MOTIONS[motion](fine)
        y = np.interp(t - lag, fine, PHYSICS[physics](u))
        random = np.random.default_rng(1)
        one, other = (x + NOISE * np.ptp(x) * random.normal(size=ROWS) for x in (u[::FINE], y))
        for sign, given, answer in ((1, one, other), (-1, other, one)):
            record = Record.from_arrays(given, answer, t)
            clocks = identify.fit(record, "Composition", test_tail=0.25).clocks
            yield motion, sign * clocks.lag / STEP


def rows() -> list[Row]:
    """How many lags are found, and how wrong they are."""
    without = [lag for _, lag in _found(0.0)]
    moved = list(_found(LAG))
    told = [lag for motion, lag in moved if motion not in ONE_RATE]
    given, seen = (float(np.count_nonzero(some)) for some in (without, told))
    wrong = max(abs(lag - LAG / STEP) for _, lag in moved if lag)
    return [
        judged(f"{LAGS}: of {len(without)} records without one, given one", given, 0),
        noted(f"{LAGS}: of {len(told)} with one of 5 steps and several rates, found", seen),
        judged(f"{LAGS}: the one most wrong, in steps", wrong, 1.5),
    ]
