"""The Preisach model as a linear map from its unknowns to its output, and its normal equations.

The output is linear in z = (offset, reversible increments, weights). In *node space*, where a
column is an entry of the Everett table, each sample touches few entries: the matrix B is sparse. The table
is a double cumulative sum S of the weights, so the normal matrix in the unknowns is S'(B'B)S, without ever
forming the dense design matrix.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float

from hysteresis.preisach import GridDensity, GridPairs, Preisach, PreisachInput


class Normal(NamedTuple):
    """Normal equations of some rows: H = A'A, b = A'y, y'y, and how many rows."""

    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    yy: float
    rows: int

    def __add__(self, other: "Normal") -> "Normal":  # type: ignore[override]
        return Normal(
            self.H + other.H, self.b + other.b, self.yy + other.yy, self.rows + other.rows
        )

    def squared_error(self, z: Float[np.ndarray, " unknowns"]) -> float:
        """|A z - y|^2."""
        return float(max(z @ self.H @ z - 2 * self.b @ z + self.yy, 0.0))


class NodeSpace(NamedTuple):
    """Column layout in node space: offset, reversible nodes, Everett nodes, diagonal half cells."""

    cells: int

    @property
    def nodes(self) -> int:
        return self.cells + 1

    @property
    def reversible(self) -> int:
        return 1

    @property
    def everett(self) -> int:
        return 1 + self.nodes

    @property
    def diagonal(self) -> int:
        return 1 + self.nodes + self.nodes**2

    @property
    def columns(self) -> int:
        return self.diagonal + self.cells

    def to_unknowns(self, rows: Float[np.ndarray, "rows columns"]) -> np.ndarray:
        """rows @ S: from node space to (offset, n increments, n(n+1)/2 weights)."""
        n = self.cells
        hats = rows[:, self.reversible : self.everett]
        # R at node p is the sum of the increments before p.
        increments = hats[:, :0:-1].cumsum(1)[:, ::-1]
        table = rows[:, self.everett : self.diagonal].reshape(-1, n + 1, n + 1)
        # T[p, q] is the sum of w_ij over i < p and j >= q.
        mass = table[:, :0:-1, :].cumsum(1)[:, ::-1, :].cumsum(2)[:, :, :n]
        cell = np.arange(n)
        mass[:, cell, cell] += rows[:, self.diagonal :]
        i, j = np.tril_indices(n)
        return np.hstack([rows[:, :1], increments, mass[:, i, j]])

    def from_unknowns(self, z: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " columns"]:
        """S z: offset, the reversible part at its nodes, the Everett table, the half cells."""
        n = self.cells
        mass = np.zeros((n, n))
        mass[np.tril_indices(n)] = z[1 + n :]
        table = np.zeros((n + 1, n + 1))
        table[1:, :-1] = mass[:, ::-1].cumsum(1)[:, ::-1].cumsum(0)
        nodes = np.append(0.0, z[1 : 1 + n].cumsum())
        return np.concatenate([z[:1], nodes, np.tril(table, -1).ravel(), np.diagonal(mass)])


def design_rows(model: Preisach, prepared: PreisachInput) -> sparse.csr_matrix:
    """B: one row per sample in node space, for a model with a `GridDensity` and a reversible part."""
    p = prepared
    assert isinstance(model.density, GridDensity)
    space = NodeSpace(model.density.cells)
    own = _everett_rows(space, p.sample, np.asarray(p.sign))
    edge = _everett_rows(space, p.node, np.asarray(p.node_sign))

    # The level at an anchor is the sum of the edges on its way to the root: (I + P + P^2 + ...) edge.
    parent = np.asarray(p.tree.parent)
    anchors = len(parent)
    up = sparse.csr_matrix(
        (np.ones(anchors - 1), (np.arange(1, anchors), parent[1:])), shape=(anchors, anchors)
    )
    level: Any = edge
    step: Any = edge
    while step.nnz:
        step = up @ step
        level = level + step
    level.eliminate_zeros()
    relays = (own + level[np.asarray(p.tree.anchor)]).tocsr()

    samples = np.arange(len(p.sign))
    cell, within = np.asarray(p.cell), np.asarray(p.within)
    ones = np.ones(len(samples))
    memoryless = sparse.csr_matrix(
        (
            np.concatenate([ones, 1 - within, within]),
            (np.tile(samples, 3), np.concatenate([0 * cell, 1 + cell, 2 + cell])),
        ),
        shape=relays.shape,
    )
    mass = sparse.csr_matrix(
        (ones, (samples, np.full(len(samples), space.everett + space.cells * space.nodes))),
        shape=relays.shape,
    )
    return (memoryless + model.orientation * (relays - mass)).tocsr()


def normal_equations(
    space: NodeSpace, B: sparse.csr_matrix, y: Float[np.ndarray, " samples"]
) -> Normal:
    """S'(B'B)S, S'B'y and y'y."""
    gram = np.asarray((B.T @ B).todense())
    half = space.to_unknowns(gram)
    H = space.to_unknowns(np.ascontiguousarray(half.T))
    b = space.to_unknowns(np.asarray(B.T @ y)[None])[0]
    return Normal((H + H.T) / 2, b, float(y @ y), len(y))


def _everett_rows(space: NodeSpace, pairs: GridPairs, factor: np.ndarray) -> sparse.csr_matrix:
    """factor * E(a, b) as rows in node space."""
    corner, f, g = (np.asarray(a) for a in (pairs.corner, pairs.fraction, pairs.fraction_b))
    stride = space.nodes
    columns = [corner, corner + 1, corner + stride, corner + stride + 1]
    values = [(1 - f) * (1 - g), (1 - f) * g, f * (1 - g), f * g]
    # The table is symmetric and zero on its diagonal: fold every entry into p > q.
    p, q = np.divmod(np.concatenate(columns), stride)
    folded = space.everett + np.maximum(p, q) * stride + np.minimum(p, q)
    values = np.where(p == q, 0.0, np.concatenate(values))
    half = [np.asarray(c) + space.diagonal for c in (pairs.cell, pairs.cell_b)]
    rows = np.tile(np.arange(len(f)), 6)
    data = np.concatenate([values, f * (f - 1), g * (g - 1)]) * np.tile(factor, 6)
    keep = data != 0
    where = rows[keep], np.concatenate([folded, *half])[keep]
    return sparse.csr_matrix((data[keep], where), shape=(len(f), space.columns))
