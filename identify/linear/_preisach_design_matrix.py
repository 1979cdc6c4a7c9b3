"""The Preisach model as a linear map from its unknowns to its output, and its normal equations.

The output is linear in z = (offset, reversible increments, weights). In *node space*, where a
column is an entry of the Everett table, each sample touches few entries: the matrix B is sparse. The table
is a double cumulative sum S of the weights, and z = P x of the unknowns, so their normal matrix is
P'S'(B'B)S P, without ever forming the dense design matrix.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float

from hysteresis.preisach import GridDensity, GridPairs, Preisach, PreisachInput

from ._cross_validation import NormalEquations

CHUNK = 1024
"""Columns of the normal matrix worked on at once: bounds the memory."""


class NodeSpace(NamedTuple):
    """Column layout in node space: offset, reversible nodes, Everett nodes, diagonal half cells.

    With `occupancy` the nodes of the table that says which relays were up at first come last, and the
    masses `up` come last in z.
    """

    cells: int
    occupancy: bool = False

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
    def up(self) -> int:
        return self.diagonal + self.cells

    @property
    def columns(self) -> int:
        return self.up + self.occupancy * self.nodes**2

    def to_unknowns(self, columns: Float[np.ndarray, "columns batch"]) -> np.ndarray:
        """S' columns: from node space to z.

        The batch is the last axis: sums run over long contiguous rows, ten times as fast as the
        other way round.
        """
        n = self.cells
        hats = columns[self.reversible : self.everett]
        # R at node p is the sum of the increments before p.
        increments = hats[:0:-1].cumsum(0)[::-1]
        # T[p, q] is the sum of w_ij over i < p and j >= q.
        mass = columns[self.everett : self.diagonal].reshape(n + 1, n + 1, -1)[1:, :n].copy()
        for i in range(n - 2, -1, -1):
            mass[i] += mass[i + 1]
        for j in range(1, n):
            mass[:, j] += mass[:, j - 1]
        cell = np.arange(n)
        mass[cell, cell] += columns[self.diagonal : self.up]
        used = np.tril_indices(n)
        found = [columns[:1], increments, mass[used]]
        if self.occupancy:
            # S[p, q] is the sum of u_ij over i >= p and j < q, half cells twice.
            up = columns[self.up :].reshape(n + 1, n + 1, -1)[:n, 1:].copy()
            for i in range(1, n):
                up[i] += up[i - 1]
            for j in range(n - 2, -1, -1):
                up[:, j] += up[:, j + 1]
            up[cell, cell] *= 2
            found.append(up[used])
        return np.vstack(found)

    def from_unknowns(self, z: Float[np.ndarray, " z"]) -> Float[np.ndarray, " columns"]:
        """S z: offset, the reversible part at its nodes, the Everett table, the half cells."""
        n = self.cells
        used = np.tril_indices(n)
        mass, table, first = np.zeros((n, n)), np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
        mass[used] = z[1 + n : 1 + n + len(used[0])]
        table[1:, :-1] = mass[:, ::-1].cumsum(1)[:, ::-1].cumsum(0)
        nodes = np.append(0.0, z[1 : 1 + n].cumsum())
        found = [z[:1], nodes, np.tril(table, -1).ravel(), np.diagonal(mass)]
        if self.occupancy:
            up = np.zeros((n, n))
            up[used] = z[1 + n + len(used[0]) :]
            up += np.diag(np.diagonal(up))
            first[:-1, 1:] = up[::-1].cumsum(0)[::-1].cumsum(1)
            found.append(first.ravel())
        return np.concatenate(found)


def design_rows(model: Preisach, prepared: PreisachInput) -> sparse.csr_matrix:
    """B: one row per sample in node space, for a model with a `GridDensity` and a reversible part."""
    p = prepared
    assert isinstance(model.density, GridDensity)
    space = NodeSpace(model.density.cells, model.up is not None)
    own = _everett_rows(space, p.sample, np.asarray(p.sign))
    past = _everett_rows(space, p.past, np.asarray(p.past_sign))
    edge = sparse.vstack([past, own]).tocsr()[np.asarray(p.place)]

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
    relays = relays - mass
    if space.occupancy:
        relays = relays + _occupancy_rows(space, p.unvisited)
    return (memoryless + model.orientation * relays).tocsr()


def normal_equations(
    space: NodeSpace, B: sparse.csr_matrix, y: Float[np.ndarray, " samples"], P: Any
) -> NormalEquations:
    """P'S'(B'B)S P, P'S'B'y and y'y."""
    H = normal_matrix(space, (B.T @ B).tocsc(), P)
    return NormalEquations(H, gathered(space, (B.T @ y)[:, None], P)[:, 0], float(y @ y), len(y))


def normal_matrix(space: NodeSpace, gram: Any, P: Any) -> Float[np.ndarray, "unknowns unknowns"]:
    """P'S' gram S P, of a symmetric matrix in node space, sparse by columns."""
    used = np.flatnonzero(np.diff(gram.indptr))
    half = np.zeros((space.columns, P.shape[1]))
    half[used] = gathered(space, gram[:, used], P).T
    H = gathered(space, half, P)
    return (H + H.T) / 2


def gathered(space: NodeSpace, columns: Any, P: Any) -> Float[np.ndarray, "unknowns batch"]:
    """P'S' of columns in node space."""
    turned = P.T.tocsr()
    chunks = (columns[:, k : k + CHUNK] for k in range(0, columns.shape[1], CHUNK))
    return np.hstack([turned @ space.to_unknowns(_dense(chunk)) for chunk in chunks])


def _dense(chunk: Any) -> np.ndarray:
    return chunk.toarray() if sparse.issparse(chunk) else np.ascontiguousarray(chunk)


def _occupancy_rows(space: NodeSpace, pairs: GridPairs) -> sparse.csr_matrix:
    """2 Q(M, m) as rows in node space: bilinear between the nodes of its table."""
    corner, f, g = (np.asarray(a) for a in (pairs.corner, pairs.fraction, pairs.fraction_b))
    columns = space.up + np.concatenate([corner + k for k in (0, 1, space.nodes, space.nodes + 1)])
    values = 2 * np.concatenate([(1 - f) * (1 - g), (1 - f) * g, f * (1 - g), f * g])
    rows = np.tile(np.arange(len(f)), 4)
    return sparse.csr_matrix((values, (rows, columns)), shape=(len(f), space.columns))


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
