"""`adaptive`: a compensator that recalibrates itself, from a model and a record."""

import math
from functools import singledispatch
from itertools import chain
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.special import chdtri

from hysteresis import (
    AbstractModel,
    Conditioned,
    CyclicDrift,
    InputError,
    Mixture,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    Record,
    Scaled,
    Series,
    Sum,
    TimeDrift,
)
from hysteresis._quantities import with_units
from hysteresis.curves import Clip
from hysteresis.preisach import GridDensity
from hysteresis.records._cycles import counted_cycles
from hysteresis.trees import input_range

from .._contract import Status
from .._readings import check_units, estimate
from ..inverses import inverse_of
from ._adaptive import AdaptiveCompensator

# A model as a sum of parts that each rise with the input, whose weights can be learnt.

LOOSE = 1e-6
"""A reversible part of less than this, in parts of the relays' mass, is none."""


class Part(NamedTuple):
    """One summand: nominal weight times model. `fixed`: its weight stays."""

    model: AbstractModel
    nominal: float = 1.0
    fixed: bool = False


class Split(NamedTuple):
    """sign y = constant + sum of nominal_k part_k, but not below the `floor`, where there is one."""

    sign: float
    parts: tuple[Part, ...]
    floor: float | None = None


def split(model: AbstractModel) -> Split:
    """The parts of a model, as many as rise each by itself; one, the model, where none are known.

    Raises `InputError` where the model has no inverse, or depends on a condition.
    """
    if isinstance(model, Conditioned):
        raise InputError(
            "bad-option",
            "A model that depends on a condition cannot be recalibrated while it runs.",
            fix="fit one without a condition.",
        )
    inverse_of(model)
    return _split(model)


@singledispatch
def _split(model: AbstractModel) -> Split:
    return Split(1.0, (Part(model),))


@_split.register
def _(model: Scaled) -> Split:
    sign, parts, floor = _split(model.inner)
    factor = float(model.factor)
    floor = None if floor is None else abs(factor) * floor
    scaled = tuple(part._replace(model=Scaled(part.model, abs(factor))) for part in parts)
    return Split(sign * float(np.sign(factor)), scaled, floor)


@_split.register
def _(model: Series) -> Split:
    """Stages before the last one are in front of each of its parts; a clip at the end is a floor."""
    *before, last = model.parts
    if isinstance(last, Clip) and before and np.isneginf(-float(last.high)):
        found = _split(Series(*before) if len(before) > 1 else before[0])
        whole = found.sign < 0 or found.floor is not None
        return Split(1.0, (Part(model),)) if whole else found._replace(floor=float(last.low))
    sign, parts, floor = _split(last)
    return Split(sign, tuple(p._replace(model=Series(*before, p.model)) for p in parts), floor)


@_split.register
def _(model: Sum) -> Split:
    parts: list[Part] = []
    for one in model.parts:
        if isinstance(one, CyclicDrift | TimeDrift):
            parts.append(Part(one, fixed=True))
            continue
        try:
            inverse_of(one)
        except InputError:
            return Split(1.0, (Part(model),))  # a summand that falls is held by the others
        sign, inner, floor = _split(one)
        parts += inner if sign > 0 and floor is None else [Part(one)]
    return Split(1.0, tuple(parts))


@_split.register
def _(model: Mixture) -> Split:
    return _split(model.whole)


@_split.register
def _(model: Preisach) -> Split:
    """The memoryless part and the relays.

    Relays that lead are subtracted, and rise only with enough of the memoryless part: R / ratio - P is the
    widest loop that still rises, and the rest of R is a part of its own.
    """
    grid = model.density
    if not isinstance(grid, GridDensity) or model.reversible is None or model.up is not None:
        return Split(1.0, (Part(model),))
    increments = np.asarray(model.reversible, float)
    if increments.sum() <= LOOSE * float(np.sum(np.asarray(grid.weights))):
        return Split(1.0, (Part(model),))
    curve = MonotoneCurve(np.asarray(grid.edges), jnp.asarray(increments))
    if not model.leading:
        return Split(1.0, (Part(curve), Part(_with(model, np.zeros_like(increments)))))
    fall = increments - np.asarray(model.least_slope()) * np.diff(np.asarray(grid.edges))
    used = float(np.max(fall[increments > 0] / increments[increments > 0], initial=0.0))
    if not 0.0 < used < 1.0:
        return Split(1.0, (Part(model),))
    # What rounding leaves must not fall.
    used = min(1.0, used * (1.0 + 1e-9))
    return Split(1.0, (Part(curve, 1.0 - used), Part(_with(model, used * increments))))


def _with(model: Preisach, increments: np.ndarray) -> Preisach:
    return Preisach(
        model.density, jnp.asarray(increments), 0.0, leading=model.leading, initial=model.initial,
        capacity=model.capacity, dead_band=model.dead_band,
    )  # fmt: skip


@_split.register
def _(model: PrandtlIshlinskii) -> Split:
    """The line and the plays."""
    if model.leading or model.bends is not None:
        return Split(1.0, (Part(model),))
    slope = float(model.slope)
    line = MonotoneCurve(np.array([0.0, 1.0]), jnp.asarray([slope]))
    least = 1e-9 * slope  # the plays alone, which need a slope
    plays = PrandtlIshlinskii(model.thresholds, model.weights, least, 0.0, model.rates)
    return Split(1.0, (Part(line), Part(plays)))


LEAST = 0.05
"""Of its fitted weight a part keeps this: the output still rises, so the inverse exists."""

AFTER, ZERO_AFTER = 0.3, 0.2
"""Standard deviations after a change, at most: of weights over the fitted ones, of the zero over the
output's range."""

PRECISE = 1e-3
"""Part of the output's range: residuals smaller than this are taken for this, because a sensor that changes
by less is as good as new."""

MEMORY = 5.0
"""Cycles of references whose weight is forgotten by a factor e, where others say something else."""

UNSURE = 0.02
"""Probability that a variance is larger than what is taken for it: set-up records have few cycles."""

FEWEST = 3
"""Independent parts that a record is taken for at least, so that a variance has an upper limit of use."""

CELLS, LOOP = 16, 2e-3
"""Cells of the input in which branches are compared; loops narrower than this part of the rise are none."""


def adaptive(
    model: AbstractModel,
    record: Record,
    *,
    drift: float = 0.0,
    false_alarms: float = 1e-5,
) -> AdaptiveCompensator:
    """A compensator that recalibrates itself while it runs; see `AdaptiveCompensator`.

    The parts are those of a `Sum`, the memoryless part and the relays of a `Preisach`, the line and the
    plays of a `PrandtlIshlinskii`; of other models only zero and gain are learnt.

    **Arguments:**

    - `model`: fitted, with an inverse and without a condition.
    - `record`: of the unchanged sensor, best one that the model was not fitted to. From it come the
      variance of the residuals (its upper limit of 98 per cent confidence), after how many samples they are
      independent, the rms error of estimates, and how much of the rise and of the loop each part has.

    **Other arguments:**

    - `drift`: standard deviation of a drift of the zero that is expected, in the output's unit per unit of
      time. 0: the zero is learnt, but not extrapolated.
    - `false_alarms`: the rate that is allowed, per independent reference. By 1e-5, a false alarm
      comes once in 100,000 of them on average, or less often.

    **Raises:** `InputError` where the model has no inverse or depends on a condition, `not-exportable`
    where no law is known for a part of it, `no-rows`, and `bad-option` for rates that are not between 0
    and 1, or a drift below 0.

    Source: Kulhavy 1987 (restricted exponential forgetting), Page 1954 and Lorden 1971 (the test and its
    rate).

    **Example:**

        >>> own = compensate.adaptive(fit.model, record)
        >>> float(own.simulate(record.time, record.output).gain[-1])
        1.0
    """
    if not 0 < false_alarms < 1:
        raise InputError(
            "bad-option", f"false_alarms={false_alarms:g} is no rate.", fix="between 0 and 1."
        )
    if not 0 <= drift < math.inf:
        raise InputError(
            "bad-option", f"drift={drift:g} is below 0 or not finite.", fix="0 or more."
        )
    units = model.units and model.units.reversed
    check_units(units, record)
    used = record.mask & np.isfinite(record.input) & np.isfinite(record.output)
    if used.sum() < 2:
        raise InputError("no-rows", "The record has fewer than two rows.", place=record.source)
    found = split(model)
    starts = tuple(record.starts.tolist())
    outputs = np.array(
        [p.model.simulate(record.time, record.input, starts=starts) for p in found.parts], float
    )
    nominal = np.array([p.nominal for p in found.parts])
    y = found.sign * record.output
    whole = found.sign * np.asarray(model.simulate(record.time, record.input, starts=starts), float)
    outputs, centres, zero = _centred(outputs, whole, nominal, found.floor, used)
    residual = np.where(used, y - whole, np.nan)
    span = float(np.ptp(y[used])) or 1.0
    # Cycles are numbered anew in each sequence.
    of = np.where(used, record.cycle, 0)
    turns = sum(len(np.setdiff1d(of[rows], [0])) for _, rows in record.sequences())
    correlation = _correlation(residual, record)
    noise = _at_most(float(np.nanmean(residual**2)), used.sum() / correlation)
    noise = max(noise, (PRECISE * span) ** 2)
    rises, widths = np.ptp(outputs[:, used], axis=1), _widths(outputs, record, used)
    total = float(nominal @ widths)
    widths = widths * np.sign(total) if abs(total) > LOOP * float(nominal @ rises) else 0 * widths

    free = np.array([not p.fixed for p in found.parts])
    size = free * np.maximum(nominal, AFTER)
    # What is open after the fit moves the output by as much as the residuals, all together.
    known = noise / (1 + free.sum())
    start = np.concatenate(
        [[known, drift**2], np.minimum(known / np.maximum(rises, 1e-300) ** 2, size**2)]
    )
    start[2:] *= free
    spread = np.concatenate([[(ZERO_AFTER * span) ** 2, drift**2], (AFTER * size) ** 2])
    cycle = used.sum() / max(1, turns) / correlation
    settings = {
        "sign": found.sign, "floored": found.floor is not None, "zero": zero, "centres": centres,
        "nominal": nominal, "least": np.where(free, LEAST * nominal, nominal), "rises": rises,
        "widths": widths, "noise": noise, "correlation": correlation, "memory": max(MEMORY * cycle, 2.0),
        "settling": max(cycle, 1.0), "threshold": -math.log(false_alarms), "spread": spread,
        "error": _error(model, record, used),
    }  # fmt: skip
    models = tuple(p.model for p in found.parts)
    ends = _ends(model, record, used)
    own = AdaptiveCompensator(model, models, ends, settings, jnp.asarray(start))
    return own if units is None else with_units(own, units)


def _centred(
    outputs: np.ndarray,
    whole: np.ndarray,
    nominal: np.ndarray,
    floor: float | None,
    used: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Outputs of the parts from their least one on, so that a weight changes a rise and not the zero; where
    there is a floor, from it on, so that it stays where the parts add up to 0. And the zero."""
    centres = outputs[:, used].min(1)
    above = used if floor is None else used & (whole > floor)
    constant = float(np.mean((whole - nominal @ outputs)[above])) if above.any() else 0.0
    if floor is None:
        return outputs - centres[:, None], centres, constant + float(nominal @ centres)
    largest = int(np.argmax(nominal * np.ptp(outputs[:, used], axis=1)))
    centres[largest] += (floor - constant - nominal @ centres) / nominal[largest]
    return outputs - centres[:, None], centres, floor


def _widths(outputs: np.ndarray, record: Record, used: np.ndarray) -> np.ndarray:
    """The mean distance of falling and rising branches, with its sign, of every part."""
    u = record.input
    edges = np.linspace(u[used].min(), u[used].max(), CELLS + 1)
    cell = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, CELLS - 1)
    ways = [used & (record.branch == sign) for sign in (1, -1)]
    counts = [np.bincount(cell[way], minlength=CELLS) for way in ways]
    both = (counts[0] > 0) & (counts[1] > 0)
    if not both.any():
        return np.zeros(len(outputs))
    means = [
        np.stack([np.bincount(cell[way], one[way], minlength=CELLS) for one in outputs])[:, both]
        / count[both]
        for way, count in zip(ways, counts, strict=True)
    ]
    return (means[1] - means[0]).mean(1)


def _correlation(residual: np.ndarray, record: Record) -> float:
    """Samples after which residuals are independent, by autocorrelations and by the means of cycles.

    An error of the model often lasts a whole cycle and changes its sign within it. 1 + 2 sum of
    autocorrelations until one is below 0 does not see that; the variance of the means of cycles does.
    """
    sequences = [rows for _, rows in record.sequences()]
    longest = max(sequences, key=lambda rows: rows.stop - rows.start)
    r = np.nan_to_num(residual[longest] - np.nanmean(residual))
    n = len(r)
    power = np.abs(np.fft.rfft(r, 2 * n)) ** 2
    rho = np.fft.irfft(power)[:n]
    if not rho[0] > 0:
        return 1.0
    rho = rho / rho[0]
    end = int(np.argmax(rho < 0)) if (rho < 0).any() else n
    lasting = max(1 + 2 * float(rho[1:end].sum()), _by_cycles(residual, record))
    return min(lasting, max(float(np.isfinite(residual).sum()) / FEWEST, 1.0))


def _by_cycles(residual: np.ndarray, record: Record) -> float:
    """The variance of the means of cycles, at most, over that of a mean of independent residuals; a cycle
    at most, because cycles are taken for independent."""
    every = chain.from_iterable(counted_cycles(record, np.isfinite(residual), 0.0))
    parts = [part[np.isfinite(part)] for part in (residual[one.rows] for one in every)]
    if len(parts) < 2:
        return 1.0
    rows = float(np.mean([len(part) for part in parts]))
    variance = float(np.var([part.mean() for part in parts], ddof=1))
    return min(rows * _at_most(variance, len(parts) - 1) / float(np.nanvar(residual)), rows)


def _at_most(variance: float, independent: float) -> float:
    """A variance's upper limit of 98 per cent confidence, from so many independent values."""
    return variance * independent / float(chdtri(independent, 1 - UNSURE))


def _ends(model: AbstractModel, record: Record, used: np.ndarray) -> tuple[float, float]:
    """The inputs to look for: those that the model names, else the record's and half as much more."""
    while isinstance(model, Scaled | Series):
        model = model.inner if isinstance(model, Scaled) else model.parts[0]
    if (ends := input_range(model)) is not None:
        return float(ends[0]), float(ends[1])
    low, high = float(record.input[used].min()), float(record.input[used].max())
    return low - (high - low) / 2, high + (high - low) / 2


def _error(model: AbstractModel, record: Record, used: np.ndarray) -> float:
    """The rms error of estimates, at least a thousandth of the input's range."""
    found = estimate(inverse_of(model), record)
    sound = used & (np.asarray(found.status) != Status.INVALID)
    error = (np.asarray(found.value) - record.input)[sound]
    least = PRECISE * float(np.ptp(record.input[used]))
    return max(float(np.sqrt(np.mean(error**2))), least)
