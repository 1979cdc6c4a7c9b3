"""What a vector of unknowns of a Preisach fit stands for: blocks of cells, slacks, a first state."""

from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int

from hysteresis import Record, Scaled
from hysteresis.preisach import GridDensity, Initial, Preisach

from ..records._new_record import located
from ._nnls import constrained_least_squares, nonnegative_least_squares
from ._preisach_design_matrix import NodeSpace, design_blocks
from ._unknown_vectors import in_units

SUMS = ("output.middle", "output.rise", "loop.width")
"""What a record determines, with low and high the ends of the input, from saturation to saturation:

- `output.middle`: mean of the outputs at low and at high, offset + rise / 2.
- `output.rise`: output at high less that at low, rise + 2 mass (lagging) or rise - 2 mass (leading).
- `loop.width`: mean distance of the two branches of the loop between low and high, which is twice the mean
  of (alpha - beta) / (high - low) over the mass.
"""

NOT_SEPARABLE = ("offset", "reversible.rise", "density.mass")
"""Constant, rise of the memoryless part, mass of the relays: relays whose thresholds are nearly equal act
as the memoryless part does, so a record leaves open how a sum is shared out among the three."""

NEAR = 2
"""Cells beside the diagonal, in which relays count as nearly equal thresholds."""


class _Fields(NamedTuple):
    """Those of `GridUnknowns`, which keeps what it computes."""

    cells: int
    low: float
    high: float
    leading: bool
    initial: Initial
    scale: float
    dead_band: float = 0.0
    centre: float = 0.0
    nodes: tuple[float, ...] | None = None
    blocks: Any = None


class GridUnknowns(_Fields):
    """A vector x of unknowns in units of `scale`: (offset, increments or slacks, masses of blocks).

    The offset is counted from `centre`, a mean of the output.

    The grid has `cells` x `cells` cells; `blocks` (weights,) says which block each of its weights, row
    by row, belongs to; None: each is one. A block's mass is spread evenly over its cells, so a fine grid
    needs no more unknowns than the data can tell apart.

    A leading model must not fall on any branch. Its increments are c_k = s_k + 2 (row k of the
    weights, its half cell twice), with slacks s_k >= 0 as unknowns; the same for the columns, s_k +
    2 (row k - column k) >= 0, are `constraints`.

    With `initial="fit"` each block has two masses, of relays that are down and of those that are up
    before the first sample. `leading`, `initial`, `dead_band` and the `nodes` between cells, None for cells
    of one width, are otherwise those of the model.
    """

    def words(self) -> dict[str, Any]:
        """All but the blocks, as plain data."""
        return {name: x for name, x in self._asdict().items() if name != "blocks"}

    @property
    def offsets(self) -> slice:
        """Which unknown is the offset."""
        return slice(1)

    @property
    def block(self) -> Int[np.ndarray, " weights"]:
        """The block of each weight."""
        count = self.cells * (self.cells + 1) // 2
        return np.arange(count) if self.blocks is None else self.blocks

    @property
    def edges(self) -> Float[np.ndarray, " nodes"]:
        """The inputs between which the cells lie."""
        even = np.linspace(self.low, self.high, self.cells + 1)
        return even if self.nodes is None else np.asarray(self.nodes)

    @property
    def space(self) -> NodeSpace:
        return NodeSpace(self.cells, self.initial == "fit")

    @property
    def count(self) -> int:
        return self.expansion.shape[1]

    @property
    def free(self) -> Bool[np.ndarray, " unknowns"]:
        """Which may be negative: the offset."""
        return np.arange(self.count) == 0

    @cached_property
    def spread(self) -> Any:
        """(weights, blocks), sparse: a block's mass over its cells, by area."""
        i, j = np.tril_indices(self.cells)
        area = np.where(i == j, 0.5, 1.0)
        share = area / np.bincount(self.block, area)[self.block]
        return sparse.csr_matrix((share, (np.arange(len(share)), self.block)))

    @cached_property
    def expansion(self) -> Any:
        """P, sparse: (offset, increments, weights and, if fitted, weights that are up) = P x."""
        weights = self.spread
        parts = [[weights]]
        if self.initial == "fit":
            parts = [[weights, weights], [None, weights]]
        relays: Any = sparse.bmat(parts, format="csr")
        ahead = 1 + self.cells
        swept = None
        if self.leading:
            # A half cell on the diagonal is swept twice as fast at its end: dE/df = 2 w f.
            i, j = np.tril_indices(self.cells)
            each = (np.where(i == j, 4.0, 2.0), (1 + i, np.arange(len(i))))
            swept = sparse.csr_matrix(each, shape=(ahead, len(i))) @ relays[: len(i)]
        return sparse.bmat([[sparse.eye(ahead), swept], [None, relays]], format="csr")

    @cached_property
    def constraints(self) -> Float[np.ndarray, "constraints unknowns"]:
        """C with C x >= 0, beyond the signs."""
        if not self.leading:
            return np.zeros((0, self.count))
        i, j = np.tril_indices(self.cells)
        at = np.flatnonzero(i != j)
        k, ones = np.arange(len(i))[at], np.full(len(at), 2.0)
        turned = sparse.csr_matrix(
            (np.concatenate([ones, -ones]), (np.concatenate([i[at], j[at]]), np.tile(k, 2))),
            shape=(self.cells, len(i)),
        )
        constraints = np.zeros((self.cells, self.count))
        constraints[:, 1 : 1 + self.cells] = np.eye(self.cells)
        expansion: Any = self.expansion
        relays = expansion[1 + self.cells : 1 + self.cells + len(i), 1 + self.cells :]
        swept: Any = turned @ relays
        constraints[:, 1 + self.cells :] = swept.toarray()
        return constraints

    @property
    def total_names(self) -> tuple[str, ...]:
        """What the rows of `totals` are called."""
        return SUMS

    @property
    def totals(self) -> Float[np.ndarray, "3 unknowns"]:
        """Rows that sum up the unknowns to `SUMS`, over `scale`."""
        offset, rise, mass = self.shares
        i, j = np.tril_indices(self.cells)
        edges = self.edges
        middle, wide = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
        # In a half cell thresholds are a third of a cell apart, in the mean.
        apart = 2 * np.where(i == j, wide[i] / 3, middle[i] - middle[j]) / (self.high - self.low)
        side = -1.0 if self.leading else 1.0
        width = np.sign(self.scale) * self._of_weights(apart)
        return np.stack([offset + rise / 2, rise + 2 * side * mass, width])

    @property
    def shares(self) -> Float[np.ndarray, "3 unknowns"]:
        """Rows that sum up the unknowns to `NOT_SEPARABLE`, over `scale`."""
        n, expansion = self.cells, self.expansion
        plain = np.zeros((2, expansion.shape[0]))
        plain[0, 0], plain[1, 1 : 1 + n] = 1.0, 1.0
        return np.vstack([plain @ expansion, self._of_weights(np.ones(len(self.block)))])

    @property
    def share_ranges(self) -> Float[np.ndarray, "2 3 unknowns"]:
        """Rows that sum up the unknowns to the ends between which `NOT_SEPARABLE` are open.

        The relays near the diagonal may as well be a memoryless part, and all of the memoryless part
        may as well be relays. A leading model has no such end: relays and a memoryless part
        with the same slope cancel, however large they are.
        """
        offset, rise, mass = self.shares
        i, j = np.tril_indices(self.cells)
        near = self._of_weights((i - j < NEAR).astype(float))
        if self.leading:
            nowhere = np.full_like(mass, np.nan)
            return np.stack(
                [[nowhere, rise - 2 * near, mass - near], [offset + near, nowhere, nowhere]]
            )
        return np.stack(
            [
                [offset - near, 0 * rise, mass - near],
                [offset + rise / 2, rise + 2 * near, mass + rise / 2],
            ]
        )

    @property
    def sums(self) -> Float[np.ndarray, "sums unknowns"]:
        """The rows of `totals`, and those of both ends of `share_ranges`."""
        return np.vstack([self.totals, *self.share_ranges])

    def _of_weights(self, factor: Float[np.ndarray, " weights"]) -> Float[np.ndarray, " unknowns"]:
        """The row that sums up the weights, times a factor each."""
        z = np.zeros(self.expansion.shape[0])
        z[1 + self.cells : 1 + self.cells + len(factor)] = factor
        return z @ self.expansion

    def minimum(
        self,
        H: Float[np.ndarray, "n n"],
        b: Float[np.ndarray, "*draws n"],
        start: Bool[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, "*draws n"]:
        """The unknowns that minimise x'Hx/2 - b'x among the models there can be."""
        if len(self.constraints):
            return constrained_least_squares(H, b, self.constraints, self.free, start)
        return nonnegative_least_squares(H, b, self.free, start)

    def masses(self, unknowns: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " weights"]:
        """The mass of every cell, over `scale`."""
        return (self.expansion @ unknowns)[1 + self.cells :][: len(self.block)]

    def model(self, unknowns: Float[np.ndarray, "*draws unknowns"]) -> Preisach | Scaled:
        """The model of a vector of unknowns; of many, one whose arrays have leading draw axes.

        Where `scale` is negative, the output falls: it is the negative of a model that rises.
        """
        if unknowns.ndim > 1:
            models = [self.model(draw) for draw in unknowns]
            return jax.tree.map(lambda *leaves: jnp.stack(leaves), *models)
        rising = self.rising(unknowns)
        return Scaled(rising, -1.0) if self.scale < 0 else rising

    def rising(self, unknowns: Float[np.ndarray, " unknowns"]) -> Preisach:
        """The model, or its negative where the output falls."""
        n, count = self.cells, len(self.block)
        z = np.sign(self.scale) * (self.expansion @ in_units(self, unknowns))
        reversible = np.maximum(z[1 : 1 + n], 0.0)
        weights = self._table(z[1 + n : 1 + n + count])
        fitted = self.initial == "fit"
        up = np.minimum(self._table(z[1 + n + count :]), weights) if fitted else None
        model = Preisach(
            GridDensity(self.low, self.high, weights, nodes=self.nodes), reversible, z[0], up,
            leading=self.leading, initial="negative" if fitted else self.initial,
            dead_band=self.dead_band,
        )  # fmt: skip
        if not self.leading:
            return model
        # Lift the increments by what rounding left the slopes below zero.
        width = np.diff(self.edges)
        lifted = reversible + np.maximum(-np.asarray(model.least_slope()) * width, 0.0)
        return replace(model, reversible=lifted)

    def outputs(
        self, record: Record, unknowns: Float[np.ndarray, " unknowns"]
    ) -> Float[np.ndarray, " samples"]:
        """The output of their model on a record, block by block."""
        model = self.rising(unknowns)
        nodes = self.space.from_unknowns(self.expansion @ unknowns)[:, None]
        blocks = design_blocks(model, located(model, record))
        found = np.concatenate([block.product(nodes)[:, 0] for block in blocks])
        return self.centre + self.scale * found

    def _table(self, weights: Float[np.ndarray, " weights"]) -> Float[np.ndarray, "cells cells"]:
        table = np.zeros((self.cells, self.cells))
        table[np.tril_indices(self.cells)] = np.maximum(weights, 0.0)
        return table


def refined(
    block: Int[np.ndarray, " weights"],
    masses: Float[np.ndarray, " weights"],
    share: float = 1e-3,
) -> Int[np.ndarray, " finer"]:
    """Blocks on a grid twice as fine: those with more than `share` of the mass are split in four.

    The output depends on how the mass lies inside a block by at most that mass.
    """
    cells = int(np.sqrt(2 * len(block)))
    heavy = np.bincount(block, masses) > share * masses.sum()
    coarse = np.zeros((cells, cells), int)
    coarse[np.tril_indices(cells)] = np.where(heavy[block], -1, block)
    i, j = np.tril_indices(2 * cells)
    kept = coarse[i // 2, j // 2]
    own = block.max() + 1 + np.arange(len(i))
    return np.unique(np.where(kept < 0, own, kept), return_inverse=True)[1]
