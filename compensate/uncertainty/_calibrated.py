"""How far an estimate is off: the spread of its models, and what their own error was found to be."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike

from hysteresis import InputError, Record, register
from hysteresis.numerics._normal import NORMAL_95

from .._contract import AbstractCompensator, Status
from .._estimate import estimate
from ._ensemble import UncertainEstimate

SCORES = 200
"""Draws of a model's error that a calibration keeps."""

TURN = 0.02
"""Part of the inputs' range by which an estimate has to come back to be on another branch."""

CANDIDATES = 81
"""Errors to choose from, an eighth apart."""

TINY = 1e-30
"""The scale of residuals that are all 0."""

LASTING = 0.1
"""Correlation of errors below which nothing of it is taken to last."""

PRIOR_VISITS = 2.0
"""As many visits of a level are added with the mean error: few say little about one level."""


class LeftOut(NamedTuple):
    """Rows (samples,), and a compensator that knows nothing of them: its model was fitted without them.

    **Example:**

        >>> rows = record.cycle == 1
        >>> bool(compensate.LeftOut(rows, compensate.invert(fit.model)).rows.any())
        True
    """

    rows: Bool[np.ndarray, " samples"]
    compensator: AbstractCompensator


class CalibratedState(NamedTuple):
    """The inner state; a play behind the estimates, NaN before the first; whether it rose last."""

    inner: Any
    follower: Array
    rising: Array


@register
class CalibratedCompensator(AbstractCompensator[CalibratedState, UncertainEstimate]):
    """A compensator whose deviation holds the model's own error too.

    It adds that error to the spread of the inner compensator:

        deviation^2 = spread^2 + error(level, branch)^2,     draws = value + deviation scores

    The error runs linearly between `levels` of the estimate, falling and rising, and `scores` are what
    residuals were found to be over their deviation, whatever that distribution. The value is the
    inner one's. A play of half width `width` behind the estimates tells the branch.

    `coverage`: the part of rows that neither model nor error had seen of which value +- 1.645 deviations
    held the truth; 0.9 is meant. NaN where it was not measured. `has_draws`: whether estimates have draws,
    200 numbers a sample.

    `share`, `lasts`: the part of the error's variance that lasts, and the time in which it decays to 1/e,
    in the unit of the record's times (in samples where it has none). A filter that takes the error for
    white noise trusts it too much; with these it can make a state of it:

        estimate = input + deviation (beta + sqrt(1 - share) v),    beta' = -beta / lasts + noise, var share

    **Example:**

        >>> band = compensate.calibrated(compensate.invert(fit.model), record, levels=4)
        >>> band.error.shape
        (2, 4)
    """

    inner: AbstractCompensator
    levels: Float[Array, " levels"]
    error: Float[Array, "2 levels"]
    scores: Float[Array, " scores"]
    width: float = eqx.field(static=True)
    coverage: float = eqx.field(default=float("nan"), static=True)
    has_draws: bool = eqx.field(default=True, static=True)
    share: float = eqx.field(default=0.0, static=True)
    lasts: float = eqx.field(default=0.0, static=True)

    def init(self) -> CalibratedState:
        return CalibratedState(self.inner.init(), jnp.asarray(jnp.nan, float), jnp.asarray(1))

    def step(
        self, state: CalibratedState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[CalibratedState, UncertainEstimate]:
        inner, found = self.inner.step(state.inner, t, y)
        way = _way(self.width, (state.follower, state.rising), (found.value, found.status))
        return CalibratedState(inner, *way), self._widened(found, way[1])

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: CalibratedState | None = None
    ) -> UncertainEstimate:
        state = self.init() if state is None else state
        found = self.inner.simulate(t, y, state.inner)
        fresh = jnp.zeros(found.value.shape, bool)
        return self._widened(found, _ways(self.width, state.follower, state.rising, found, fresh))

    def around(self, inner: AbstractCompensator) -> "CalibratedCompensator":
        """The same error for another compensator: of the same model, fitted to more."""
        return replace(self, inner=inner)

    @eqx.filter_jit
    def _widened(self, found: Any, rising: Array) -> UncertainEstimate:
        falling_error, rising_error = (jnp.interp(found.value, self.levels, e) for e in self.error)
        error = jnp.where(rising > 0, rising_error, falling_error)
        deviation = jnp.hypot(getattr(found, "deviation", jnp.zeros_like(error)), error)
        if not self.has_draws:
            return UncertainEstimate(found.value, found.status, deviation)
        draws = jnp.multiply.outer(self.scores, deviation) + jnp.expand_dims(found.value, 0)
        return UncertainEstimate(found.value, found.status, deviation, draws)


def _way(
    width: float, way: tuple[Array, Array], sample: tuple[Array, Array]
) -> tuple[Array, Array]:
    """A play behind the estimates, which only moves with them, and the direction it moved last."""
    (before, rising), (value, status) = way, sample
    after = jnp.where(jnp.isnan(before), value, jnp.clip(before, value - width, value + width))
    after = jnp.where(status == Status.INVALID, before, after)
    moved = jnp.sign(after - before)
    return after, jnp.where(moved > 0, 1, jnp.where(moved < 0, -1, rising))


@eqx.filter_jit
def _ways(width: float, before: Array, rising: Array, found: Any, fresh: Array) -> Array:
    """The direction of every sample; where one is `fresh`, nothing was before it."""

    def step(way: Any, sample: Any) -> tuple[Any, Array]:
        value, status, first = sample
        way = jnp.where(first, jnp.nan, way[0]), jnp.where(first, 1, way[1])
        after = _way(width, way, (value, status))
        return after, after[1]

    return jax.lax.scan(step, (before, rising), (found.value, found.status, fresh))[1]


def calibrated(
    compensator: AbstractCompensator,
    record: Record,
    cycles: int | None = None,
    levels: int = 8,
    ahead: float = 1.0,
    left_out: Sequence[LeftOut] = (),
) -> CalibratedCompensator:
    """A compensator that knows what error its model makes, from residuals r = estimate - input:

        error = argmax over e of  sum over visits of mean over samples of log N(r; 0, spread^2 + e^2),

    for each level and branch. A visit is one way through one level: neighbouring samples err alike, so it
    is one fact, however many samples it has. Those of all levels and branches count as two more.
    The scores are the quantiles of +-r over the deviation that the other cycles give it (sequences,
    where there are several), so that what varies between them is in the band.

    **Arguments:**

    - `record`: rows outside its mask are history. Residuals of the rows a model was fitted to are too
      small where samples drift: fit without the last cycle, calibrate on it, and carry the error over to
      the compensator of the whole fit, `calibrated(before, last).around(invert(...))`.
    - `cycles`: only so many, the last ones of each sequence; all by default.
    - `levels`: into which the range of the estimates is divided.
    - `ahead`: how many times further from the fit the estimates will be than the record is, in cycles,
      where samples drift: the error then grows with its square root, as a random walk's.
    - `left_out`: groups of the rows that the model was fitted to, each with the compensator of a model
      fitted without it. Residuals are then those of these compensators, and the error is scaled so that
      1.645 deviations hold nine tenths of the scores.

    Raises `InputError` where no row is left.

    **Example:**

        >>> band = compensate.calibrated(compensate.invert(fit.model), record)
        >>> compensate.estimate(band, record).deviation.shape
        (101,)
    """
    value, status, spread, rising, width = _residuals(compensator, record)
    group = np.full(len(record), -1)
    for k, (rows, other) in enumerate(left_out):
        group[rows] = k
        own = _residuals(other, record)[:4]
        value, status, spread, rising = (
            np.where(rows, new, old)
            for new, old in zip(own, (value, status, spread, rising), strict=True)
        )
    counted = record.mask & (status != Status.INVALID)
    if len(left_out):
        counted &= group >= 0
    if cycles is not None:
        counted &= np.concatenate([_last(record, rows, cycles) for _, rows in record.sequences()])
    if not counted.any():
        raise InputError("no-rows", "no row is left to learn the error from.")
    value, spread, rising = value[counted], spread[counted], rising[counted]
    r, firsts = value - record.input[counted], record.starts
    if len(record.labels) == 1:
        # A cycle of which less than half is counted goes with the one before.
        whole = [
            k for k in range(1, record.n_cycles + 1) if counted[record.cycle == k].mean() >= 0.5
        ]
        firsts = np.array([np.flatnonzero(record.cycle == k)[0] for k in whole[1:]], int)
    if len(left_out):
        group = group[counted]
    else:
        group = np.searchsorted(firsts, np.flatnonzero(counted), side="right")
    edges = np.linspace(value.min(), value.max(), levels + 1)
    place = rising * levels + np.clip(np.searchsorted(edges, value) - 1, 0, levels - 1)
    ways = 2 * levels
    visits, visit = np.unique(group * ways + place, return_inverse=True)
    of_visit = visits // ways

    # A likelihood for each candidate error: averaged within a visit, whose samples err alike, so that a
    # visit counts once. The best candidate per level and branch is then a sum over visits and an argmax.
    candidates = np.geomspace(1e-3, 10, CANDIDATES) * max(float(np.std(r)), TINY)
    variance = spread**2 + candidates[:, None] ** 2
    likelihood = -(np.log(variance) + r**2 / variance) / 2
    facts = np.stack([np.bincount(visit, row) for row in likelihood]) / np.bincount(visit)

    def error(of: np.ndarray) -> np.ndarray:
        total = np.stack(
            [np.bincount(visits[of] % ways, row, minlength=ways) for row in facts[:, of]]
        )
        total += PRIOR_VISITS * facts[:, of].mean(1, keepdims=True)
        return candidates[total.argmax(0)].reshape(2, levels)

    # Each group's scores come from an error learnt without it. An error learnt with it would fit the group,
    # and the band would be too narrow for data that were not seen.
    middles, scores = (edges[1:] + edges[:-1]) / 2, np.empty(len(r))
    for one in np.unique(of_visit):
        others = of_visit != one if (of_visit != one).any() else of_visit == one
        low, high = (np.interp(value, middles, e) for e in error(others))
        score = np.abs(r) / np.hypot(spread, np.where(rising, high, low))
        scores = np.where(of_visit[visit] == one, score, scores)
    errors = np.sqrt(ahead) * error(of_visit >= 0)
    if len(left_out) and (of_visit != of_visit[0]).any():
        wider = max(float(np.quantile(scores, 0.9)), TINY) / NORMAL_95
        errors, scores = wider * errors, scores / wider
    half = np.quantile(scores, (np.arange(SCORES // 2) + 0.5) / (SCORES // 2))
    symmetric = np.concatenate([-half[::-1], half])
    learnt = (jnp.asarray(part) for part in (middles, errors, symmetric))
    last_of = np.repeat(np.arange(len(record.labels)), np.diff([*record.starts, len(record)]))
    share, lasts = _lasting(
        np.sign(r) * scores, np.flatnonzero(counted), last_of[counted], record.time
    )
    return CalibratedCompensator(compensator, *learnt, width=width, share=share, lasts=lasts)


def _lasting(
    score: np.ndarray, row: np.ndarray, sequence: np.ndarray, time: np.ndarray | None
) -> tuple[float, float]:
    """Share of the variance of an error that decays exponentially, and its time: a line through the
    logarithms of its correlations at lags of 1, 2, 4, ... rows, down to the first that is small."""
    off, size = score - score.mean(), float(np.var(score))
    lags, correlation, lag = [], [], 1
    while size and lag < len(score) // 10:
        together = (row[lag:] - row[:-lag] == lag) & (sequence[lag:] == sequence[:-lag])
        if not together.any():
            break
        now = float(np.mean((off[lag:] * off[:-lag])[together])) / size
        if now < LASTING:
            break
        lags.append(lag)
        correlation.append(now)
        lag *= 2
    if not lags:
        return 0.0, 0.0
    # Two lags at least make a line; one alone is taken to hold all of the error.
    slope, level = (
        np.polyfit(lags, np.log(correlation), 1)
        if len(lags) > 1
        else (np.log(min(correlation[0], 1 - 1e-6)) / lags[0], 0.0)
    )
    step = 1.0 if time is None else float(np.median(np.diff(time)[np.diff(time) > 0]))
    return float(min(np.exp(level), 1.0)), float(-step / min(slope, -1e-9))


def _residuals(compensator: AbstractCompensator, record: Record) -> tuple[Any, ...]:
    """Value, status and spread of every row; whether it rises; `width`."""
    width = TURN / 2 * float(np.ptp(record.input))
    found = estimate(compensator, record)
    fresh = np.zeros(len(record), bool)
    fresh[record.starts] = True
    rising = _ways(width, jnp.asarray(jnp.nan, float), jnp.asarray(1), found, jnp.asarray(fresh))
    value, status, *rest = (np.asarray(part) for part in found[:3])
    return value, status, rest[0] if rest else np.zeros_like(value), np.asarray(rising) > 0, width


def _last(record: Record, rows: slice, cycles: int) -> np.ndarray:
    """The rows of the last cycles of which at least half is counted."""
    number = record.cycle[rows]
    share = np.bincount(number, record.mask[rows]) / np.maximum(np.bincount(number), 1)
    return np.isin(number, 1 + np.flatnonzero(share[1:] >= 0.5)[::-1][:cycles])
