"""Baselines that are curves of the input: one that is monotone, and the replay of a measured loop."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import isotonic_regression

from hysteresis import Record

from .._levels import WHOLE
from ._input_memory import OncePerInput

BINS = 64
"""Equally filled parts of the input in which a curve is averaged."""


class Curve(NamedTuple):
    """A polygon through (x, y); its ends are held."""

    x: Float[np.ndarray, " corners"]
    y: Float[np.ndarray, " corners"]

    def __call__(self, u: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
        return np.interp(u, self.x, self.y)


@dataclass(frozen=True)
class MonotoneBaseline:
    """The polygon that rises, or falls, with the input and fits the means of its parts best.

    Means of equally filled parts of the input are pooled until none violates the order (isotonic
    regression); the outermost segments go on to the ends of the trained input.

    Source: Barlow et al., Statistical Inference under Order Restrictions (1972), section 1.2.
    """

    name: str = "monotone curve"

    def prepared(self, record: Record) -> Float[np.ndarray, " samples"]:
        return record.input

    def fitted(
        self, seen: np.ndarray, output: np.ndarray, rows: np.ndarray, weights: np.ndarray
    ) -> Curve:
        u, y = seen[rows], output[rows]
        x, mean, count = binned(u, y, weights[rows])
        falls = bool(np.cov(u, y)[0, 1] < 0)
        values = isotonic_regression(mean, weights=count, increasing=not falls).x
        if len(x) > 1:
            slope = np.diff(values[[0, 1, -2, -1]])[[0, 2]] / np.diff(x[[0, 1, -2, -1]])[[0, 2]]
            ends = np.array([u.min(), u.max()])
            beyond = values[[0, -1]] + slope * (ends - x[[0, -1]])
            x, values = np.append(ends[0], x), np.append(beyond[0], values)
            x, values = np.append(x, ends[1]), np.append(values, beyond[1])
        return Curve(x, values)

    def predicted(self, seen: np.ndarray, unknowns: Curve) -> Float[np.ndarray, " samples"]:
        return unknowns(seen)


class Branches(NamedTuple):
    """The curve while the input rises, and the one while it falls."""

    rising: Curve
    falling: Curve


@dataclass(frozen=True)
class ReplayBaseline:
    """The last whole cycle of a record, or the mean branches of several sequences, over the input.

    - `cycle` (samples,): of the record it is fitted to, the cycle of each row; None for mean branches.
    - `branches`: which way the input went last, see `directions`.
    """

    name: str
    cycle: Int[np.ndarray, " samples"] | None
    branches: OncePerInput

    def prepared(self, record: Record) -> tuple[np.ndarray, np.ndarray]:
        return record.input, self.branches(record)

    def fitted(
        self,
        seen: tuple[np.ndarray, np.ndarray],
        output: np.ndarray,
        rows: np.ndarray,
        weights: np.ndarray,
    ) -> Branches:
        if self.cycle is not None:
            counts = np.bincount(self.cycle[rows])
            whole = counts >= WHOLE * np.bincount(self.cycle)[: len(counts)]
            numbers = np.flatnonzero(whole & (counts > 0))
            if (numbers := numbers[numbers > 0]).size:
                rows = rows[self.cycle[rows] == numbers[-1]]
        u, direction = (x[rows] for x in seen)
        legs = [np.flatnonzero(direction == sign) for sign in (1, -1)]
        # Where the rows go one way only, the other way is as good as nothing known.
        found = [
            _mean_curve(u[at], output[rows][at], weights[rows][at]) if len(at) else None
            for at in legs
        ]
        rising, falling = found[0] or found[1], found[1] or found[0]
        assert rising is not None
        assert falling is not None
        return Branches(rising, falling)

    def predicted(
        self, seen: tuple[np.ndarray, np.ndarray], unknowns: Branches
    ) -> Float[np.ndarray, " samples"]:
        u, direction = seen
        return np.where(direction > 0, unknowns.rising(u), unknowns.falling(u))


def replay(train: Record, branches: OncePerInput) -> ReplayBaseline:
    """The replay of a record: its last loop, or the mean branches of its sequences where it has several."""
    several = sum(bool(train.mask[rows].any()) for _, rows in train.sequences()) > 1
    if several or not (train.cycle[train.mask] > 0).any():
        return ReplayBaseline("mean branches", None, branches)
    return ReplayBaseline("replay of the last loop", train.cycle, branches)


def binned(
    u: Float[np.ndarray, " rows"],
    y: Float[np.ndarray, " rows"],
    weights: Float[np.ndarray, " rows"],
    most: int = BINS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of the inputs and outputs of equally filled parts of the input, and what each weighs: where all
    weights are 1 the number of its rows.

    As many parts as there are different inputs, at most `most`.
    """
    edges = np.unique(np.quantile(u, np.linspace(0, 1, most + 1)))
    at = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, max(len(edges) - 2, 0))
    square = weights**2
    count = np.bincount(at, square)
    have = count > 0
    x, mean = (np.bincount(at, square * v)[have] / count[have] for v in (u, y))
    return x, mean, count[have]


def _mean_curve(u: np.ndarray, y: np.ndarray, weights: np.ndarray) -> Curve:
    """Through every input once, its outputs averaged; of many rows through the means of parts."""
    if len(u) > 8 * BINS:
        return Curve(*binned(u, y, weights, 2 * BINS)[:2])
    at, which = np.unique(u, return_inverse=True)
    return Curve(at, np.bincount(which, weights**2 * y) / np.bincount(which, weights**2))


# Baselines of an output under a held input: a constant, a line in time, a power law of time.

EXPONENTS = np.linspace(-1, 1, 101).round(2)
"""Tried for a power law; 0 is the logarithm."""


class PowerLaw(NamedTuple):
    """Output over input = level + factor t^exponent, or level + factor log t where the exponent is 0."""

    level: float
    factor: float
    exponent: float


@dataclass(frozen=True)
class HoldBaseline:
    """Creep or relaxation as a power law of the time since the step, by least squares of relative errors;
    where not `relative`, of errors times their weights.

        y = input (level + factor t^n),  with n from `exponents`

    Source: Findley, Lai, Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials (1976), 2.5.
    """

    name: str
    exponents: tuple[float, ...]
    relative: bool = True

    def prepared(self, record: Record) -> tuple[np.ndarray, np.ndarray]:
        assert record.time is not None
        t = record.time
        # The law has no value at the step itself; the first reading comes later.
        return record.input, np.maximum(t, t[t > 0].min(initial=np.inf))

    def fitted(
        self,
        seen: tuple[np.ndarray, np.ndarray],
        output: np.ndarray,
        rows: np.ndarray,
        weights: np.ndarray,
    ) -> PowerLaw:
        force, t = (x[rows] for x in seen)
        y = output[rows] / force
        weight = 1 / np.abs(y) if self.relative else weights[rows] * np.abs(force)
        best, least = PowerLaw(float(y.mean()), 0.0, 0.0), np.inf
        for exponent in self.exponents:
            columns = np.column_stack([np.ones_like(t), _power(t, exponent)])
            found = np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=None)[0]
            error = float(np.mean((weight * (columns @ found - y)) ** 2))
            if error < least:
                best, least = PowerLaw(float(found[0]), float(found[1]), exponent), error
        return best

    def predicted(
        self, seen: tuple[np.ndarray, np.ndarray], unknowns: PowerLaw
    ) -> Float[np.ndarray, " samples"]:
        force, t = seen
        level, factor, exponent = unknowns
        return force * (level + factor * _power(t, exponent))


def of_holds(relative: bool = True) -> tuple[HoldBaseline, ...]:
    """The simplest first."""
    return (
        HoldBaseline("constant", (), relative),
        HoldBaseline("straight line in time", (1.0,), relative),
        HoldBaseline("power law of time", tuple(EXPONENTS.tolist()), relative),
    )


def _power(t: np.ndarray, exponent: float) -> np.ndarray:
    return np.log(t) if exponent == 0 else t**exponent
