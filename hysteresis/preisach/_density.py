"""Preisach densities: the weight of the relays at each pair of thresholds."""

import abc
from functools import reduce
from operator import add
from typing import Any, Generic

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._parameter import Pairs, Table, check_range, is_concrete, parameter
from .._registry import register
from ._everett import EverettTable, GridPairs, everett_table, everett_terms


class AbstractDensity(eqx.Module, Generic[Pairs, Table]):
    """A density mu(alpha, beta) on the triangle low <= beta <= alpha <= high.

    It is known to a Preisach model through its Everett function alone,

        E(a, b) = E(b, a) = integral of mu over {b <= beta <= alpha <= a}   for b <= a,

    split into what depends on the inputs (`pair`), on the parameters (`tabulate`) and on both.

    Raises `InputError` for an empty range.
    """

    low: eqx.AbstractVar[float]
    high: eqx.AbstractVar[float]

    def __check_init__(self) -> None:
        check_range("the density reaches", self.low, self.high)

    @abc.abstractmethod
    def pair(self, a: Any, b: Any) -> Pairs:
        """Locate pairs of inputs, both in [low, high]. NumPy arrays stay NumPy arrays."""

    @abc.abstractmethod
    def tabulate(self) -> Table:
        """What every look-up shares. E(high, low) is `everett(tabulate(), pair(high, low))`."""

    @abc.abstractmethod
    def everett(self, table: Table, pairs: Pairs) -> Float[Array, "*pairs"]:
        """E(a, b) of every pair."""

    @abc.abstractmethod
    def mass(self, table: Table) -> Float[Array, ""]:
        """E(high, low): half the output's range."""


def as_nodes(nodes: Any) -> tuple[float, ...] | None:
    """Nodes as a static field keeps them."""
    return None if nodes is None else tuple(np.asarray(nodes, float).tolist())


@register
class GridDensity(AbstractDensity[GridPairs, EverettTable]):
    """A density that is constant on each cell of an n x n grid on the triangle: E is exact, by look-up.

    The formula knows inputs by cell and fraction alone, so it holds for cells of any widths: the map
    from input to cell and fraction is increasing, the same for both thresholds, and affine on every
    cell. It takes the triangle to a triangle, cells to squares, half cells to half squares, and
    leaves what is uniform on each of them uniform.

    **Arguments:**

    - `low`, `high`: the inputs where all relays are down, and up.
    - `weights`: (n, n); row i is the cell of the switch-up threshold alpha, column j that of the
      switch-down threshold beta; entries j <= i are used. Each is the *mass* of its cell; those on
      the diagonal are half cells.
    - `signed`: allow negative weights. The output may then fall while the input rises, and the model
      has no inverse in general.
    - `nodes`: the n+1 inputs between which the cells lie, increasing from `low` to `high`; None for
      cells of one width.

    Raises `InputError` for an empty range, nodes that do not fit, a table that is not square, weights
    that are not finite, and negative weights unless `signed`.

    **Example:**

        >>> density = hysteresis.preisach.GridDensity(0.0, 10.0, np.array([[2.0, 0.0], [1.0, 2.0]]))
        >>> hysteresis.Preisach(density).simulate(None, np.array([0.0, 5, 10, 5, 0])).tolist()
        [-5.0, -1.0, 5.0, 1.0, -5.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    weights: Float[Array, "cells cells"] | np.ndarray = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="mass of each cell"
    )
    signed: bool = eqx.field(default=False, static=True, kw_only=True)
    nodes: tuple[float, ...] | None = eqx.field(
        default=None, static=True, kw_only=True, converter=as_nodes
    )

    def __check_init__(self) -> None:
        check_weights(self.weights, self.signed)
        if self.nodes is None:
            return
        if len(self.nodes) != self.cells + 1:
            said = f"{len(self.nodes)} nodes for {self.cells} cells."
            mend = "give one node more than cells: low, what lies between the cells, high."
            raise InputError("length-mismatch", said, fix=mend)
        if (self.nodes[0], self.nodes[-1]) != (self.low, self.high):
            raise InputError(
                "out-of-range",
                f"the nodes reach from {self.nodes[0]:g} to {self.nodes[-1]:g}, the density from "
                f"{self.low:g} to {self.high:g}.",
                fix="let the first node be low and the last one high.",
            )
        if not (np.diff(self.nodes) > 0).all():
            raise InputError("not-increasing", "the nodes do not increase.")

    @property
    def cells(self) -> int:
        """n, the number of cells along each threshold."""
        return self.weights.shape[0]

    @property
    def edges(self) -> Float[np.ndarray, " nodes"]:
        """The inputs between which the cells lie, n+1 of them."""
        if self.nodes is None:
            return np.linspace(self.low, self.high, self.cells + 1)
        return np.asarray(self.nodes)

    def locate(self, u: Any) -> tuple[Any, Any]:
        """Cell (integer) and fraction within it; beyond the grid, below 0 or above 1 in its end cell."""
        if self.nodes is None:
            return even_place(u, self.low, self.high, self.cells)
        xp = jnp if isinstance(u, jax.Array) else np
        edges = xp.asarray(self.edges, u.dtype)
        cell = xp.clip(xp.searchsorted(edges, u, side="right") - 1, 0, self.cells - 1)
        return cell.astype(np.int32), (u - edges[cell]) / (edges[cell + 1] - edges[cell])

    def at(self, cell: Any, fraction: Any) -> Any:
        """The input at a fraction of a cell, the inverse of `locate`."""
        xp = jnp if isinstance(fraction, jax.Array) else np
        edges = xp.asarray(self.edges, fraction.dtype)
        return edges[cell] + fraction * (edges[cell + 1] - edges[cell])

    def pair(self, a: Any, b: Any) -> GridPairs:
        (cell, fraction), (cell_b, fraction_b) = self.locate(a), self.locate(b)
        return GridPairs(cell, cell_b, cell * (self.cells + 1) + cell_b, fraction, fraction_b)

    def tabulate(self) -> EverettTable:
        return everett_table(self.weights)

    def everett(self, table: EverettTable, pairs: GridPairs) -> Float[Array, "*pairs"]:
        both, of_a, of_b = everett_terms(table, pairs)
        return both + of_a + of_b

    def mass(self, table: EverettTable) -> Float[Array, ""]:
        return table.node[-1, 0]


def even_place(u: Any, low: float, high: float, cells: int) -> tuple[Any, Any]:
    """`GridDensity.locate` for cells of one width."""
    xp = jnp if isinstance(u, jax.Array) else np
    position = (u - low) * (cells / (high - low))
    cell = xp.clip(xp.floor(position), 0, cells - 1)
    return cell.astype(np.int32), position - cell


def check_weights(weights: Any, signed: bool = False) -> None:
    """Raise `InputError` unless (n, n) finite numbers, none of those used negative unless `signed`."""
    if weights.ndim != 2 or weights.shape[0] != weights.shape[1]:
        said = f"the weights have shape {weights.shape}."
        mend = "give an (n, n) table; row i is the alpha cell, column j <= i the beta cell."
        raise InputError("wrong-shape", said, fix=mend)
    if not is_concrete(weights):
        return
    used = np.tril(np.asarray(weights))
    if not np.isfinite(used).all():
        raise InputError("not-finite", "some weights are NaN or infinite.")
    if used.min() < 0 and not signed:
        i, j = np.unravel_index(used.argmin(), used.shape)
        raise InputError(
            "parameter-out-of-bounds",
            f"the weight of cell ({i}, {j}) is {used.min():g}.",
            cause="a loop that leads its input was described as one that lags it.",
            fix="use Preisach(..., leading=True), or GridDensity(..., signed=True) if meant.",
        )


# The sum of densities.


@register
class SumDensity(AbstractDensity[tuple[Any, ...], tuple[Any, ...]]):
    """The sum of several densities, each on its own triangle: E(a, b) = sum of E_k(a, b).

    **Arguments:**

    - `parts`: the densities. [low, high] encloses all of theirs; beyond its own a part is saturated.

    Raises `InputError` where there is no part.

    **Example:**

        >>> parts = [hysteresis.preisach.GridDensity(0.0, high, np.tri(2)) for high in (5.0, 10.0)]
        >>> density = hysteresis.internal.SumDensity(parts)
        >>> hysteresis.Preisach(density).simulate(None, np.array([0.0, 5.0, 10.0, 5.0])).tolist()
        [-6.0, 2.0, 6.0, 4.0]
    """

    parts: tuple[AbstractDensity, ...]

    def __init__(self, parts: Any):
        self.parts = tuple(parts)

    def __check_init__(self) -> None:
        if not self.parts:
            raise InputError("bad-parts", "there is no density to add up.", fix="give one or more.")

    @property
    def low(self) -> float:
        """The least input of any part."""
        return min(part.low for part in self.parts)

    @property
    def high(self) -> float:
        """The greatest input of any part."""
        return max(part.high for part in self.parts)

    def pair(self, a: Any, b: Any) -> tuple[Any, ...]:
        xp = jnp if isinstance(a, jax.Array) or isinstance(b, jax.Array) else np
        return tuple(
            part.pair(*(xp.clip(u, part.low, part.high) for u in (a, b))) for part in self.parts
        )

    def tabulate(self) -> tuple[Any, ...]:
        return tuple(part.tabulate() for part in self.parts)

    def everett(self, table: tuple[Any, ...], pairs: tuple[Any, ...]) -> Float[Array, "*pairs"]:
        parts = zip(self.parts, table, pairs, strict=True)
        return reduce(add, (part.everett(own, at) for part, own, at in parts))

    def mass(self, table: tuple[Any, ...]) -> Float[Array, ""]:
        parts = zip(self.parts, table, strict=True)
        return reduce(add, (part.mass(own) for part, own in parts))
