"""Quantities that vary over a cover, described by few parameters."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import Scalar, parameter

from .. import _traced as traced
from ..runtime._armor_fields import bilinear, bump


class AbstractField(eqx.Module):
    """A quantity of the place: field(surface, point) with surface k from 1 and the point P^i in metres."""

    @abc.abstractmethod
    def __call__(self, surface: Int[Array, ""], point: Float[Array, "3"]) -> Float[Array, ""]:
        """The value at one point of one surface."""

    @abc.abstractmethod
    def greatest(self) -> Float[Array, ""]:
        """No value is above this."""


class Uniform(AbstractField):
    """The same all over: one number, or one for every surface.

    **Example:**

        >>> float(compensate.armor.Uniform(1.2).greatest())
        1.2
    """

    value: Any = parameter(meaning="value of all surfaces, or of each")

    def __call__(self, surface: Int[Array, ""], point: Float[Array, "3"]) -> Float[Array, ""]:
        return _of(self.value, surface)

    def greatest(self) -> Float[Array, ""]:
        return jnp.max(self.value)


class Bumps(AbstractField):
    """A smooth bump about one point of each surface:

        base_k + amplitude_k exp(-|P - centre_k|^2 / (2 width^2))

    Examples are a frame that bends in the middle of each side, and a sheet that is thinner at its rim.

    **Arguments:** `centre` (surfaces, 3), m, e.g. `Box.centres()`; `amplitude` and `base`, one number or
    one for every surface; `width`, m.

    **Example:**

        >>> factor = compensate.armor.Bumps(box.centres(), amplitude=0.2, width=0.05, base=1.0)
        >>> round(float(factor(jnp.array(1), box.centres()[0])), 6)
        1.2
    """

    centre: Float[Array, "surfaces 3"] = parameter(
        unit="m", fixed=True, meaning="middle of each bump"
    )
    amplitude: Any = parameter(meaning="height of each bump")
    width: Scalar = parameter(unit="m", bounds=(0.0, float("inf")), meaning="width of the bumps")
    base: Any = parameter(0.0, meaning="value far from a bump")

    def __call__(self, surface: Int[Array, ""], point: Float[Array, "3"]) -> Float[Array, ""]:
        base, amplitude = _of(self.base, surface), _of(self.amplitude, surface)
        return bump(traced, base, amplitude, self.width, self.centre[surface - 1], point)

    def greatest(self) -> Float[Array, ""]:
        return jnp.max(self.base) + jnp.maximum(jnp.max(self.amplitude), 0)


class Grid(AbstractField):
    """Values on a grid over each surface, bilinear between them and constant beyond its rim.

    **Arguments:** `values` (surfaces, u, v), at least 2 x 2 each; `centre` (surfaces, 3) and `axes`
    (surfaces, 2, 3), m: the middle of each surface, and from there to the middles of two of its sides,
    as `Box.centres()` and `Box.axes()`.

    **Example:**

        >>> values = np.tile([[1.0, 1.2], [1.4, 1.6]], (5, 1, 1))
        >>> factor = compensate.armor.Grid(values, box.centres(), box.axes())
        >>> round(float(factor(jnp.array(1), box.centres()[0])), 6)
        1.3
    """

    values: Float[Array, "surfaces u v"] = parameter(meaning="values on the grid")
    centre: Float[Array, "surfaces 3"] = parameter(unit="m", fixed=True, meaning="middle of a side")
    axes: Float[Array, "surfaces 2 3"] = parameter(unit="m", fixed=True, meaning="half its sides")

    def __call__(self, surface: Int[Array, ""], point: Float[Array, "3"]) -> Float[Array, ""]:
        k = surface - 1
        return bilinear(traced, self.values[k], self.centre[k], self.axes[k], point)

    def greatest(self) -> Float[Array, ""]:
        return jnp.max(self.values)


def _of(value: Array, surface: Array) -> Array:
    """The value at a surface: a scalar as it is, or the entry of that surface."""
    return value[surface - 1] if value.ndim else value


def as_field(given: AbstractField | ArrayLike) -> AbstractField:
    """A field as it is; a number, or one for every surface, becomes `Uniform`."""
    return given if isinstance(given, AbstractField) else Uniform(given)
