"""The Krasnosel'skii-Pokrovskii operator, as a Preisach density of ridges."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._parameter import parameter
from .._registry import register
from ._density import AbstractCellDensity, check_weights
from ._everett import GridPairs, bilinear, everett_table, read
from ._preisach import Preisach


@register
class RidgeTable(NamedTuple):
    """E between grid nodes, and the mass of the cell beyond each node; (n+1, n+1), symmetric."""

    node: Float[Array, "nodes nodes"]
    mass: Float[Array, "nodes nodes"]


@register
class RidgeDensity(AbstractCellDensity[RidgeTable]):
    """Mass on the rising diagonal of each cell of a uniform grid: kernels of Krasnosel'skii-Pokrovskii.

    Their kernel, with the thresholds p_i >= p_j and ridges one cell wide, goes from -1 to 1 along a line,

        k = max(k before, r(u - p_i)) rising, min(k before, r(u - p_j)) falling,
        r(x) = -1 + 2 x / cell, held at -1 below 0 and at 1 beyond one cell,

    and equals the Preisach model whose relays lie evenly on (p_i + x, p_j + x), 0 <= x <= cell. Let f, g
    be the fractions of a, b in their cells I, J, let T be as for a grid, and let m be the masses, made
    symmetric and doubled on the diagonal. Then

        E(a, b) = bilinear(T; a, b) - m_IJ (min(f, g) - f g)

    exactly. The bilinear term counts f (1 - g) of the corner cell in {beta >= b, alpha <= a}, but the exact
    part is max(f - g, 0); on the diagonal it counts f (1 - g) + g (1 - f) instead of |f - g|.

    **Arguments:**

    - `low`, `high`: the inputs where all kernels are at -1, and at 1.
    - `weights`: (n, n); row i is the threshold p_i of the rising ridge, column j <= i that of the falling
      one, each the mass of its kernel; thresholds are the lower nodes of the cells.

    Raises `InputError` for an empty range, a table that is not square, weights that are negative or
    not finite.

    Source: Krasnosel'skii, Pokrovskii, Systems with Hysteresis; Banks, Kurdila, Webb, Identification of
    hysteretic control influence operators representing smart actuators, Part I (1997).

    **Example:**

        >>> density = hysteresis.preisach.RidgeDensity(0.0, 10.0, np.tri(2))
        >>> hysteresis.Preisach(density).simulate(None, np.array([0.0, 5.0, 10.0, 5.0])).tolist()
        [-3.0, -1.0, 3.0, 1.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    weights: Float[Array, "cells cells"] | np.ndarray = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="mass of each kernel"
    )
    nodes: ClassVar[None] = None

    def __check_init__(self) -> None:
        check_weights(self.weights)

    @property
    def cells(self) -> int:
        return self.weights.shape[0]

    def tabulate(self) -> RidgeTable:
        lower = jnp.tril(self.weights)
        # Padded to the shape of the other table, so that one index serves both.
        return RidgeTable(everett_table(lower).node, jnp.pad(lower + lower.T, (0, 1)))

    def everett(self, table: RidgeTable, pairs: GridPairs) -> Float[Array, "*pairs"]:
        f, g = pairs.fraction, pairs.fraction_b
        ridge = read(table.mass.reshape(-1), pairs.corner) * (jnp.minimum(f, g) - f * g)
        return bilinear(table.node, pairs) - ridge

    def mass(self, table: RidgeTable) -> Float[Array, ""]:
        return table.node[-1, 0]


def KrasnoselskiiPokrovskii(  # noqa: N802 - a model by the name it has
    low: float, high: float, weights: Any, *arguments: Any, **options: Any
) -> Preisach:
    """The Krasnosel'skii-Pokrovskii operator: `Preisach(RidgeDensity(low, high, weights), ...)`.

        y = offset + R(u) + sum of weight_ij k_ij[u](t)

    Arguments as `RidgeDensity`, then as `Preisach` behind its density.

    **Example:**

        >>> model = hysteresis.KrasnoselskiiPokrovskii(0.0, 10.0, np.tri(6))
        >>> model.simulate(None, u).shape
        (13,)
    """
    return Preisach(RidgeDensity(low, high, weights), *arguments, **options)
