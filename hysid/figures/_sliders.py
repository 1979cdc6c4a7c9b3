"""Which parameters of a model a reader may move, how far, and the model with them moved."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from hysteresis import AbstractModel, parameters
from hysteresis._parameter import ParameterInfo, parameter_at
from identify import FitResult

MOST = 12
"""Sliders, at most."""
NEAR = 1e-3
"""How near to a bound a slider goes, as a part of the distance between both bounds."""


class Slider(NamedTuple):
    """A parameter with its value and its meaning, and the ends of its slider: `logarithmic` where it is
    positive."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    logarithmic: bool
    meaning: str = ""


def sliders_of(fit: FitResult) -> list[Slider]:
    """A slider for each scalar parameter of a fit's model that is not fixed, at most `MOST`; none for those
    of a composition's parts, which mean little one by one.

    It spans a factor of ten to either side of a positive value, else twice its size, and never leaves the
    parameter's bounds.
    """
    train = fit.train
    try:
        units = fit.model.unit_words(train.input_unit, train.output_unit, train.time_unit)
        return [
            Slider(name, value, info.in_units(units), *_ends(info, value), info.meaning)
            for name, info, array in parameters(fit.model)
            if array is not None and array.ndim == 0 and not info.fixed and "." not in name
            for value in (float(array),)
        ][:MOST]
    except (ValueError, TypeError, NotImplementedError):  # a model of a user's own
        return []


def moved(model: AbstractModel, values: Mapping[str, float]) -> AbstractModel:
    """The model with some scalar parameters at other values; it is as it was where none differs."""
    new = model
    for name, value in values.items():
        old = parameter_at(model, name)
        if value != float(old):
            # A default binds the name of this round.
            new = eqx.tree_at(
                lambda m, name=name: parameter_at(m, name), new, jnp.asarray(value, old.dtype)
            )
    return new


def _ends(info: ParameterInfo, value: float) -> tuple[float, float, bool]:
    low, high = info.bounds
    inside = NEAR * (high - low) if math.isfinite(high - low) else 0.0  # a bound itself is no value
    if value > 0 and low >= 0:
        low = min(max(value / 10, low + inside), value)
        return low, max(min(value * 10, high - inside), value), True
    size = 2 * abs(value) or 1.0
    low = min(max(value - size, low + inside), value)
    return low, max(min(value + size, high - inside), value), False
