"""A density that is a product of a function of each threshold."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._parameter import is_concrete, parameter
from .._registry import register
from ._density import AbstractGridDensity, as_nodes


@register
class FactorisedDensity(AbstractGridDensity):
    """mu(alpha, beta) = f(alpha) g(beta), both constant on each of n cells: 2n parameters, exact.

        mass of cell (i, j) = rising_i falling_j,  j < i;  half of that for the half cells j = i

    Multiplying `rising` and dividing `falling` by the same number gives the same density.

    **Arguments:**

    - `low`, `high`: the inputs where all relays are down, and up.
    - `rising`: (n,), none negative, the part of the switch-up threshold alpha.
    - `falling`: (n,), none negative, the part of the switch-down threshold beta.
    - `nodes`: the n+1 inputs between which the cells lie; None for cells of one width.

    Raises `InputError` for an empty range, nodes that do not fit, parts of different length, numbers
    that are negative or not finite.

    Source: Biorci, Pescetti, Analytical theory of the behaviour of ferromagnetic materials, Il Nuovo
    Cimento 7 (1958); Kadar, On the Preisach function of ferromagnetic hysteresis, J. Appl. Phys. 61
    (1987).

    **Example:**

        >>> rising, falling = np.array([1.0, 2.0]), np.array([4.0, 2.0])
        >>> density = hysteresis.preisach.FactorisedDensity(0.0, 10.0, rising, falling)
        >>> density.masses().tolist()
        [[2.0, 0.0], [8.0, 2.0]]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    rising: Float[Array, " cells"] | np.ndarray = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="part of the switch-up threshold"
    )
    falling: Float[Array, " cells"] | np.ndarray = parameter(
        bounds=(0.0, float("inf")), meaning="part of the switch-down threshold"
    )
    nodes: tuple[float, ...] | None = eqx.field(
        default=None, static=True, kw_only=True, converter=as_nodes
    )

    def __check_init__(self) -> None:
        if self.rising.ndim != 1 or self.rising.shape != self.falling.shape:
            raise InputError(
                "length-mismatch",
                f"the factors have shapes {self.rising.shape} and {self.falling.shape}.",
                fix="give each one number per cell.",
            )
        for name, factor in (("rising", self.rising), ("falling", self.falling)):
            if is_concrete(factor) and not _finite_and_not_negative(factor):
                raise InputError(
                    "parameter-out-of-bounds", f"{name} is negative or not finite somewhere."
                )

    @property
    def cells(self) -> int:
        return self.rising.shape[0]

    def masses(self) -> Float[Array, "cells cells"]:
        product = jnp.outer(jnp.asarray(self.rising), jnp.asarray(self.falling))
        return jnp.tril(product) - jnp.diag(jnp.diagonal(product) / 2)


def _finite_and_not_negative(factor: Any) -> bool:
    factor = np.asarray(factor)
    return bool((np.isfinite(factor) & (factor >= 0)).all())
