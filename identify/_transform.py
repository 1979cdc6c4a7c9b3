"""Bounded parameters and the free vector an optimiser or sampler moves, defined once."""

from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import AbstractModel, ParameterInfo, parameter_at, parameters

Model = TypeVar("Model", bound=AbstractModel)


class Transform(NamedTuple):
    """Between the parameters of a model and a free vector z, one entry for each number:

        no bounds       value = scale * z
        low < value     value = low + exp(z)
        value < high    value = high - exp(z)
        both            value = low + (high - low) / (1 + exp(-z))

    - `names`: the numbers that move, those of an array by their places: "E.0", "E.1".
    - `low`, `high`: their bounds; `scale`: those of the unbounded ones, or one for all.
    """

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    scale: Float[np.ndarray, " parameters"] | float

    def to_free(self, model: AbstractModel) -> Float[np.ndarray, " parameters"]:
        """z of a model's present parameters."""
        x, low, high = self.values(model), np.array(self.low), np.array(self.high)
        has_low, has_high = np.isfinite(low), np.isfinite(high)
        with np.errstate(all="ignore"):
            both = np.log((x - low) / (high - x))
            one_sided = np.where(has_low, np.log(x - low), np.log(high - x))
        bounded = np.where(has_low & has_high, both, one_sided)
        return np.where(has_low | has_high, bounded, x / self.scale)

    def to_values(self, z: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """Parameters of a free vector."""
        low, high = np.isfinite(self.low), np.isfinite(self.high)
        floor, ceiling = np.where(low, self.low, 0.0), np.where(high, self.high, 1.0)
        both = floor + (ceiling - floor) / (1 + jnp.exp(-z))
        one_sided = jnp.where(low, floor + jnp.exp(z), ceiling - jnp.exp(z))
        return jnp.where(low & high, both, jnp.where(low | high, one_sided, self.scale * z))

    def slope(self, z: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, " parameters"]:
        """d value / d z, to carry errors over."""
        h = 1e-6
        up, down = (np.asarray(self.to_values(jnp.asarray(z + d))) for d in (h, -h))
        return (up - down) / (2 * h)

    def insert(self, model: Model, values: Float[Array, " parameters"]) -> Model:
        """The model with these parameters."""
        found: dict[str, Any] = {}
        for name, value in zip(self.names, values, strict=True):
            whole, _, place = name.rpartition(".")
            if place.isdigit():
                found[whole] = jnp.append(found.get(whole, jnp.zeros_like(values[:0])), value)
            else:
                found[name] = value
        return eqx.tree_at(lambda m: [parameter_at(m, n) for n in found], model, [*found.values()])

    def values(self, model: AbstractModel) -> Float[np.ndarray, " parameters"]:
        """The parameters of a model that move."""
        return np.array([float(parameter_at(model, name)) for name in self.names])


def transform(model: AbstractModel, scale: float, input_scale: float = 1.0) -> Transform:
    """The transform of a model's free parameters, numbers and one-dimensional arrays that lie within their
    bounds; `scale` and `input_scale` are the sizes of output and input, for unbounded ones."""
    sizes = {"input": input_scale, "output / input": scale / input_scale, "1": 1.0}
    entries = [
        (name if np.ndim(value) == 0 else f"{name}.{k}", info)
        for name, info, value in parameters(model)
        if value is not None and _moves(info, value)
        for k in range(np.size(value))
    ]
    names = tuple(name for name, _ in entries)
    low, high = (tuple(float(info.bounds[k]) for _, info in entries) for k in (0, 1))
    return Transform(names, low, high, np.array([sizes.get(i.unit, scale) for _, i in entries]))


def _moves(info: ParameterInfo, value: Any) -> bool:
    if info.fixed or np.ndim(value) > 1:
        return False
    low, high = info.bounds
    return np.ndim(value) == 0 or bool(np.all((value > low) & (value < high)))
