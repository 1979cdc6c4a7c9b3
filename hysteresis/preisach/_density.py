"""Preisach densities: how much relay there is at each pair of thresholds."""

import abc
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._parameter import is_concrete, parameter
from ._everett import EverettTable, GridPairs, everett_look_up, everett_table

Pairs = TypeVar("Pairs")
Table = TypeVar("Table")


class AbstractDensity(eqx.Module, Generic[Pairs, Table]):
    """A density mu(alpha, beta) on the triangle low <= beta <= alpha <= high.

    It is known to a Preisach model through its Everett function alone,

        E(a, b) = E(b, a) = integral of mu over {b <= beta <= alpha <= a}   for b <= a,

    split into what depends on the inputs (`pair`), on the parameters (`tabulate`) and on both.
    """

    low: eqx.AbstractVar[float]
    high: eqx.AbstractVar[float]

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


class GridDensity(AbstractDensity[GridPairs, EverettTable]):
    """A density that is constant on each cell of a uniform n x n grid on the triangle.

    **Arguments:**

    - `low`, `high`: the inputs where all relays are down, and up.
    - `weights`: (n, n); row i is the cell of the switch-up threshold alpha, column j that of the
      switch-down threshold beta; entries j <= i are used. Each is the *mass* of its cell; those on
      the diagonal are half cells.
    - `signed`: allow negative weights. The output then need not rise with the input, and the model
      has no inverse in general.

    Raises `InputError` for an empty range, a table that is not square, weights that are not finite,
    negative ones unless `signed`.
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    weights: Float[Array, "cells cells"] | np.ndarray = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="mass of each cell"
    )
    signed: bool = eqx.field(default=False, static=True, kw_only=True)

    def __check_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(
                "zero-range",
                f"the density reaches from {self.low:g} to {self.high:g}.",
                fix="give low < high, enclosing the inputs the model will see.",
            )
        if self.weights.ndim != 2 or self.weights.shape[0] != self.weights.shape[1]:
            raise InputError(
                "weights-not-square",
                f"the weights have shape {self.weights.shape}.",
                fix="give an (n, n) table; row i is the alpha cell, column j <= i the beta cell.",
            )
        if is_concrete(self.weights):
            used = np.tril(np.asarray(self.weights))
            if not np.isfinite(used).all():
                raise InputError("weights-not-finite", "some weights are NaN or infinite.")
            if used.min() < 0 and not self.signed:
                i, j = np.unravel_index(used.argmin(), used.shape)
                raise InputError(
                    "negative-weight",
                    f"the weight of cell ({i}, {j}) is {used.min():g}.",
                    cause="a loop that leads its input was described as one that lags it.",
                    fix="use Preisach(..., leading=True), or GridDensity(..., signed=True) if meant.",
                )

    @property
    def cells(self) -> int:
        """n, the number of cells along each threshold."""
        return self.weights.shape[0]

    def locate(self, u: Any) -> tuple[Any, Any]:
        """Cell (integer) and fraction within it of inputs in [low, high]."""
        xp = jnp if isinstance(u, jax.Array) else np
        position = (u - self.low) * (self.cells / (self.high - self.low))
        cell = xp.clip(xp.floor(position), 0, self.cells - 1)
        return cell.astype(np.int32), position - cell

    def pair(self, a: Any, b: Any) -> GridPairs:
        (cell, fraction), (cell_b, fraction_b) = self.locate(a), self.locate(b)
        return GridPairs(cell, cell_b, cell * (self.cells + 1) + cell_b, fraction, fraction_b)

    def tabulate(self) -> EverettTable:
        return everett_table(self.weights)

    def everett(self, table: EverettTable, pairs: GridPairs) -> Float[Array, "*pairs"]:
        return everett_look_up(table, pairs)

    def mass(self, table: EverettTable) -> Float[Array, ""]:
        return table.node[-1, 0]
