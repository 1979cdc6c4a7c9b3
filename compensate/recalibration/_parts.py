"""A model as a sum of parts that each rise with the input, whose weights can be learnt."""

from functools import singledispatch
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from hysteresis import (
    AbstractModel,
    Conditioned,
    CyclicDrift,
    InputError,
    Mixture,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    Scaled,
    Series,
    Sum,
    TimeDrift,
)
from hysteresis.curves import Clip
from hysteresis.preisach import GridDensity

from ..inverses import inverse_of

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
