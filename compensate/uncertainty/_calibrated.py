"""How far an estimate is off: the spread of its models, and what their own error was found to be."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from hysteresis import InputError, Record, register
from hysteresis._law_model import once
from hysteresis._parameter import array_module, as_array
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.records._cycles import counted_cycles
from hysteresis.running import Numbers, each, numbers_of
from hysteresis.trees import Tree

from .._contract import AbstractCompensator, Status
from .._readings import check_units, estimate
from ..inverses._law import UncertainEstimate
from ._motion import FASTER, GROWTH, PATH, Motions, along, error_law, path_law, seen

SCORES = 200
"""Draws of a model's error that a calibration keeps."""

TURN, MOST_TURN = 0.02, 0.5
"""Parts of the inputs' range by which an estimate has to come back to be on another branch: at least the
first, and by more where errors are larger, which would pass for reversals."""

CANDIDATES = 81
"""Errors to choose from, an eighth apart."""

TINY = 1e-30
"""The scale of residuals that are all 0."""

LASTING = 0.1
"""Correlation of errors below which nothing of it is taken to last."""

GROWTHS = np.exp(np.log(2) * np.linspace(0, 3, 13))
"""Growths of the error to choose from, over the default one: a doubling is one standard deviation of it.
None is smaller, because groups of one record are less unlike each other than another motion is."""

ROUNDS = 3
"""Of learning the error beside its growth, and the growth beside the error."""

LEAST_COVERAGE = 0.8
"""Of held-out rows in a band of 90 %: what chance may leave of it where they are one loop."""

PRIOR_VISITS = 2.0
"""As many visits of a level are added with the mean error: few say little about one level."""


class LeftOut(NamedTuple):
    """Rows (samples,), and a compensator that knows nothing of them: its model was fitted without them."""

    rows: Bool[np.ndarray, " samples"]
    compensator: AbstractCompensator


class CalibratedState(NamedTuple):
    """The inner state; what the error's law keeps of the motion so far; the time of the last reading, and
    the error there: NaN before the first one."""

    inner: Any
    motion: Float[Array, " state"]
    t: Float[Array, ""]
    error: Float[Array, ""]


@register
class CalibratedCompensator(AbstractCompensator[CalibratedState, UncertainEstimate]):
    """A compensator whose deviation holds the model's own error too.

    It adds that error to the spread of the inner compensator:

        deviation^2 = spread^2 + error(level, branch)^2 + growth(motion)^2,
        draws = value + deviation scores

    The error runs linearly between `levels` of the estimate, falling and rising, and `scores` are what
    residuals were found to be over their deviation, whatever that distribution. The value is the
    inner one's. A play of half width `width` behind the estimates tells the branch and the reversals.

    `motions`: the inputs, reversals and speeds that the error was learnt on, see `Motions`; growth is 0
    among them. None: the error is the same on every motion.

    `coverage`: the part of rows that neither model nor error had seen of which value +- 1.645 deviations
    held the truth; 0.9 is meant. NaN where it was not measured. `coverage_before`: the same, before those
    rows showed that the error had to be scaled. `has_draws`: whether estimates have draws, 200 numbers a
    sample.

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
    motions: Motions | None = None
    coverage: float = eqx.field(default=float("nan"), static=True)
    coverage_before: float = eqx.field(default=float("nan"), static=True)
    has_draws: bool = eqx.field(default=True, static=True)
    share: float = eqx.field(default=0.0, static=True)
    lasts: float = eqx.field(default=0.0, static=True)

    def init(self) -> CalibratedState:
        never = jnp.asarray(jnp.nan, float)
        first = jnp.asarray(self._numbers.state, float)
        return CalibratedState(self.inner.init(), first, never, never)

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: CalibratedState
    ) -> tuple[CalibratedState, UncertainEstimate]:
        inner, found = self.inner.stream(t, y, state.inner)
        xp = array_module(t, found.value, *jax.tree.leaves((self, state)))
        value, status = xp.asarray(found.value), xp.asarray(found.status)
        told = each(
            self._numbers, "deviation", value, state=state.motion, t=state.t, held=state.error,
            times=None if t is None else xp.asarray(t, float),
            where=xp.where(status == Status.INVALID, xp.nan, value),
        )  # fmt: skip
        error = told.value
        last = error[-1] if len(error) else state.error
        after = CalibratedState(inner, *map(as_array, (told.state, told.t, last)))
        own = getattr(found, "deviation", None)
        deviation = xp.hypot(0.0 if own is None else xp.asarray(own), error)
        draws = None
        if self.has_draws:
            draws = as_array(xp.multiply.outer(xp.asarray(self.scores), deviation) + value[None])
        return after, UncertainEstimate(found.value, found.status, as_array(deviation), draws)

    @once
    def _numbers(self) -> Numbers:
        return numbers_of(self.law())

    def law(self) -> Tree:
        """See `hysteresis/laws/error.py`."""
        return error_law(self.width, self.motions, self.levels, *self.error)

    def around(self, inner: AbstractCompensator) -> "CalibratedCompensator":
        """The same error for another compensator: of the same model, fitted to more."""
        return replace(self, inner=inner)

    @property
    def knows_speeds(self) -> bool:
        """Whether the deviation depends on the times of the estimates."""
        return self.motions is not None and float(self.motions.speeds[0]) > 0


def calibrated(
    compensator: AbstractCompensator,
    record: Record,
    levels: int = 8,
    ahead: float = 1.0,
    left_out: Sequence[LeftOut] = (),
) -> CalibratedCompensator:
    """A compensator that knows what error its model makes, from residuals r = estimate - input:

        error = argmax over e of  sum over visits of mean over samples of log N(r; 0, spread^2 + e^2),

    for each level and branch, with e^2 + growth(motion)^2 in the place of e^2. A visit is one way
    through one level: neighbouring samples err alike, so it is one fact, however many samples it has.
    Those of all levels and branches count as two more. The growth is 0.3 of the error of the best cubic
    from output to input, which knows nothing of the past; left-out groups whose motion is unlike that of
    the others correct it. The scores are the quantiles of +-r over the deviation that the other cycles
    give it (sequences, where there are several), so that what varies between them is in the band.

    **Arguments:**

    - `record`: rows outside its mask are history. Residuals of the rows a model was fitted to are too
      small where samples drift: fit without the last cycle, calibrate on it, and carry the error over to
      the compensator of the whole fit, `calibrated(before, last).around(invert(...))`.
    - `levels`: into which the range of the estimates is divided.
    - `ahead`: how many times further from the fit the estimates will be than the record is, in cycles,
      where samples drift: the error then grows with its square root, as a random walk's.
    - `left_out`: groups of the rows that the model was fitted to, each with the compensator of a model
      fitted without it. Residuals are then those of these compensators, and the error is scaled so that
      1.645 deviations hold nine tenths of the scores, and of these residuals, but by no more than n groups
      leave open: the 95 % quantile of Student's t times sqrt(1 + 1/n) over 1.645.

    Raises `InputError` where no row is left.

    **Example:**

        >>> band = compensate.calibrated(compensate.invert(fit.model), record)
        >>> compensate.estimate(band, record).deviation.shape
        (101,)
    """
    check_units(compensator.units, record)
    runs = [_estimated(one, record) for one in (compensator, *(o for _, o in left_out))]
    value, status, spread = runs[0]
    group = np.full(len(record), -1)
    for k, ((rows, _), own) in enumerate(zip(left_out, runs[1:], strict=True)):
        group[rows] = k
        pairs = zip(own, (value, status, spread), strict=True)
        value, status, spread = (np.where(rows, new, old) for new, old in pairs)
    counted = record.mask & (status != Status.INVALID)
    if len(left_out):
        counted &= group >= 0
    if not counted.any():
        raise InputError("no-rows", "no row is left to learn the error from.")
    r, spread = (value - record.input)[counted], spread[counted]
    if not len(left_out):
        group = _cycles(record, counted)
    span = float(np.ptp(record.input[counted]))
    width = float(np.clip(np.quantile(np.abs(r), 0.9), TURN / 2 * span, MOST_TURN / 2 * span))
    growth = _growth(compensator, record, counted, runs[0][0])
    motions, grown, rising = _motions(record, counted, group, runs, width, growth)
    value, group = value[counted], group[counted]
    edges = np.linspace(value.min(), value.max(), levels + 1)
    middles, ways = (edges[1:] + edges[:-1]) / 2, 2 * levels
    place = rising * levels + np.clip(np.searchsorted(edges, value) - 1, 0, levels - 1)
    visits, visit = np.unique(group * ways + place, return_inverse=True)
    of_visit, rows = visits // ways, np.bincount(visit)

    def facts(variance: np.ndarray, r: np.ndarray = r) -> np.ndarray:
        """Likelihoods averaged within a visit, whose samples err alike, so that a visit counts once."""
        found = -(np.log(variance) + r**2 / variance) / 2
        return np.stack([np.bincount(visit, row) for row in found]) / rows

    # The best candidate per level and branch is a sum over visits and an argmax.
    candidates = np.geomspace(1e-3, 10, CANDIDATES) * max(float(np.std(r)), TINY)

    def error(known: np.ndarray, of: np.ndarray) -> np.ndarray:
        place = visits[of] % ways
        total = np.stack([np.bincount(place, row, minlength=ways) for row in known[:, of]])
        total += PRIOR_VISITS * known[:, of].mean(1, keepdims=True)
        return candidates[total.argmax(0)].reshape(2, levels)

    def by_row(errors: np.ndarray) -> np.ndarray:
        low, high = (np.interp(value, middles, e) for e in errors)
        return np.where(rising, high, low)

    every, factor = np.ones(len(visits), bool), 1.0
    for _ in range(ROUNDS):
        known = facts(spread**2 + candidates[:, None] ** 2 + factor**2 * grown)
        errors = error(known, every)
        if not (len(left_out) and grown.any()):
            break
        rest = np.maximum(spread**2 + by_row(errors) ** 2, TINY)
        likelihood = facts(rest + GROWTHS[:, None] ** 2 * grown).sum(1)
        factor = GROWTHS[(likelihood - np.log2(GROWTHS) ** 2 / 2).argmax()]
    more = spread**2 + factor**2 * grown

    # Each group's scores come from an error learnt without it. An error learnt with it would fit the group,
    # and the band would be too narrow for data that were not seen.
    own, unseen = by_row(errors), np.empty(len(r))
    for one in np.unique(of_visit):
        others = of_visit != one if (of_visit != one).any() else of_visit == one
        unseen = np.where(of_visit[visit] == one, by_row(error(known, others)), unseen)
    wider = 1.0
    if len(left_out) and (n := len(np.unique(of_visit))) > 1:
        open_to = float(stdtrit(n - 1, 0.95)) * np.sqrt(1 + 1 / n) / NORMAL_95
        inside = _scale(r, own, more)
        wider = float(np.clip(_scale(r, unseen, more), inside, open_to * inside))
    # On rows that it has not seen no model errs less than on those that it has; left-out rows of a motion
    # unlike all others tell of the growth only.
    fitted = (runs[0][0] - record.input)[counted]
    least = error(facts(spread**2 + candidates[:, None] ** 2, fitted), every)
    errors = np.sqrt(ahead) * np.maximum(wider * errors, least)
    scores = np.abs(r) / np.hypot(np.sqrt(more), wider * unseen)
    half = np.quantile(scores, (np.arange(SCORES // 2) + 0.5) / (SCORES // 2))
    symmetric = np.concatenate([-half[::-1], half])
    levels_of, errors_of, scores_of = map(jnp.asarray, (middles, errors, symmetric))
    motions = motions._replace(growth=factor * motions.growth)
    row = np.flatnonzero(counted)
    sequence = np.searchsorted(record.starts, row, side="right")
    share, lasts = _lasting(np.sign(r) * scores, row, sequence, record.time)
    return CalibratedCompensator(
        compensator, levels_of, errors_of, scores_of, width, motions, share=share, lasts=lasts,
        units=compensator.units,
    )  # fmt: skip


def checked(band: CalibratedCompensator, record: Record) -> CalibratedCompensator:
    """A band with its `coverage` of a record's counted rows, which neither model nor error has seen.

    Where that is below 0.8, which a few loops of chance do not explain, the error is scaled so that it
    holds nine tenths of them.
    """
    held, scores = band_holds(band, record)
    band = replace(band, coverage=held, coverage_before=held)
    if not held < LEAST_COVERAGE:
        return band
    factor = float(np.quantile(scores, 0.9, method="higher")) / NORMAL_95
    motions = band.motions and band.motions._replace(growth=factor * band.motions.growth)
    band = replace(band, error=factor * band.error, motions=motions)
    return replace(band, coverage=band_holds(band, record)[0])


def band_holds(
    band: CalibratedCompensator, record: Record
) -> tuple[float, Float[np.ndarray, " rows"]]:
    """The part of a record's counted rows with a reading of which value +- 1.645 deviations hold the input,
    NaN where there are none, and the errors of all of them over the deviation."""
    value, status, deviation = _estimated(band, record)
    used = record.mask & np.isfinite(record.output) & np.isfinite(record.input)
    used &= status != Status.INVALID
    scores = np.abs(value - record.input)[used] / np.maximum(deviation[used], TINY)
    return float((scores <= NORMAL_95).mean()) if used.any() else float("nan"), scores


def _scale(r: np.ndarray, error: np.ndarray, more: np.ndarray) -> float:
    """What to multiply errors by for 1.645 deviations to hold nine tenths of the residuals.

    |r| = 1.645 hypot(s error, more) at s = sqrt((r / 1.645)^2 - more) / error.
    """
    beyond = np.sqrt(np.maximum((r / NORMAL_95) ** 2 - more, 0.0)) / np.maximum(error, TINY)
    return max(float(np.quantile(beyond, 0.9)), TINY)


def _cycles(record: Record, counted: np.ndarray) -> np.ndarray:
    """A number for each row: of its sequence, or its cycle where there is one sequence."""
    firsts = record.starts
    if len(record.labels) == 1:
        # A cycle of which less than half is counted goes with the one before.
        firsts = [one.rows.start for one in counted_cycles(record, counted)[0][1:]]
    return np.searchsorted(firsts, np.arange(len(record)), side="right")


def _without_memory(record: Record, counted: np.ndarray) -> float:
    """The rms error of the best cubic from the output, and the conditions, to the input."""
    columns = [record.output, *(record.columns[name] for name in record.conditions)]
    y = np.column_stack([(c - c[counted].mean()) / (np.ptp(c[counted]) or 1.0) for c in columns])
    y = y[counted]
    powers = np.column_stack([np.ones(len(y)), y, y**2, y**3, y[:, :1] * y[:, 1:]])
    u = record.input[counted]
    return float(np.sqrt(np.mean((powers @ np.linalg.lstsq(powers, u, rcond=None)[0] - u) ** 2)))


def _growth(
    compensator: AbstractCompensator, record: Record, counted: np.ndarray, value: np.ndarray
) -> tuple[float, float]:
    """The errors far from all reversals seen, and far from all speeds.

    A model that knows the rate errs there by what it says that another speed does, too.
    """
    far, faster = GROWTH * _without_memory(record, counted), 0.0
    if record.time is not None:
        hurried = _estimated(compensator, replace(record, time=record.time / FASTER))[0]
        faster = float(np.sqrt(np.mean((hurried - value)[counted] ** 2)))
    return far, float(np.hypot(far, faster))


def _motions(
    record: Record,
    counted: np.ndarray,
    group: np.ndarray,
    runs: Sequence[tuple[np.ndarray, ...]],
    width: float,
    growth: tuple[float, float],
) -> tuple[Motions, np.ndarray, np.ndarray]:
    """The motions of all counted rows; of each, the variance because its own is unlike those of the other
    groups, and whether its estimate rises.

    What was seen is told from the true inputs, what is there from the estimates, as in use.
    """
    known = record.input[record.mask & np.isfinite(record.input)]
    ends = float(known.min()), float(known.max())
    path = path_law(ends, width)
    truth = along(path, "follow", record, record.input, np.isfinite(record.input), PATH)
    whole = seen(truth[counted], ends, growth)
    grown, rising = np.zeros(len(record)), np.zeros(len(record), bool)
    for k, (value, status, _) in enumerate(runs[1:] or runs):
        rows = counted & (group == k) if len(runs) > 1 else counted
        rest = counted & ~rows
        others = seen(truth[rest], ends, growth) if rest.any() else whole
        law, sound = error_law(width, others), status != Status.INVALID
        now = along(law, "deviation", record, value, sound, ("up",))[rows]
        grown[rows], rising[rows] = now[:, 0] ** 2, now[:, 1] > 0
    return whole, grown[counted], rising[counted]


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
    slope, level = np.log(min(correlation[0], 1 - 1e-6)) / lags[0], 0.0
    if len(lags) > 1:
        slope, level = np.polyfit(lags, np.log(correlation), 1)
    step = 1.0 if time is None else float(np.median(np.diff(time)[np.diff(time) > 0]))
    return float(min(np.exp(level), 1.0)), float(-step / min(slope, -1e-9))


def _estimated(compensator: AbstractCompensator, record: Record) -> tuple[np.ndarray, ...]:
    """Value, status and spread of every row."""
    found: Any = estimate(compensator, record)
    value, status = np.asarray(found.value), np.asarray(found.status)
    return value, status, np.asarray(getattr(found, "deviation", np.zeros_like(value)))


# A calibrated band as plain data, and back: what a fit's folder holds of it.

ARRAYS = ("levels", "error", "scores")
NUMBERS = ("width", "coverage", "coverage_before", "share", "lasts")


def in_words(band: CalibratedCompensator) -> dict[str, Any]:
    """All but the inner compensator, for JSON."""
    found: dict[str, Any] = {name: np.asarray(getattr(band, name)).tolist() for name in ARRAYS}
    for name in NUMBERS:
        value = float(getattr(band, name))
        found[name] = value if np.isfinite(value) else None
    motions = band.motions and {
        k: np.asarray(v).tolist() for k, v in band.motions._asdict().items()
    }
    return found | {"motions": motions}


def of_words(words: Mapping[str, Any], inner: AbstractCompensator) -> CalibratedCompensator:
    """The inverse of `in_words`, around a compensator."""
    found: dict[str, Any] = {name: jnp.asarray(words[name], float) for name in ARRAYS}
    for name in NUMBERS:
        found[name] = np.nan if words[name] is None else float(words[name])
    known = words["motions"]
    motions = known and Motions(*(jnp.asarray(known[name], float) for name in Motions._fields))
    return CalibratedCompensator(inner, motions=motions, units=inner.units, **found)
