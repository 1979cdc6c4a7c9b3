"""Which parameters of a model a reader may move, how far, and the model with them moved."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from hysteresis import AbstractModel, parameters
from hysteresis._parameter import ParameterInfo, parameter_at

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


def sliders_of(model: AbstractModel, units: Mapping[str, str]) -> list[Slider]:
    """A slider for each scalar parameter of a model that is not fixed, at most `MOST`.

    It spans a factor of ten to either side of a positive value, else twice its size, and never leaves the
    parameter's bounds.
    """
    return [
        Slider(name, value, info.in_units(dict(units)), *_ends(info, value), info.meaning)
        for name, info, array in parameters(model)
        if array is not None and array.ndim == 0 and not info.fixed
        for value in (float(array),)
    ][:MOST]


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
