"""Bounded parameters and the free vector an optimiser or sampler moves, defined once."""

from typing import NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import AbstractModel, parameter_at, parameters

Model = TypeVar("Model", bound=AbstractModel)


class Transform(NamedTuple):
    """Between the scalar parameters of a model and a free vector z, one entry each:

        no bounds       value = scale * z
        low < value     value = low + exp(z)
        value < high    value = high - exp(z)
        both            value = low + (high - low) / (1 + exp(-z))

    - `names`: the parameters that move; fixed ones and arrays do not.
    - `low`, `high`: their bounds; `scale`: that of the unbounded ones.
    """

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    scale: float

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
        return eqx.tree_at(lambda m: [parameter_at(m, n) for n in self.names], model, list(values))

    def values(self, model: AbstractModel) -> Float[np.ndarray, " parameters"]:
        """The parameters of a model that move."""
        return np.array([float(parameter_at(model, name)) for name in self.names])


def transform(model: AbstractModel, scale: float) -> Transform:
    """The transform of a model's free scalar parameters; `scale` is that of unbounded ones."""
    free = [
        (name, info)
        for name, info, value in parameters(model)
        if not info.fixed and value is not None and value.ndim == 0
    ]
    names = tuple(name for name, _ in free)
    low, high = (tuple(float(info.bounds[k]) for _, info in free) for k in (0, 1))
    return Transform(names, low, high, scale)
