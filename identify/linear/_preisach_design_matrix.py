"""The Preisach model as a linear map from its unknowns to its output, and its normal equations.

The output is linear in z = (offset, reversible increments, weights). In *node space*, where a
column is an entry of the Everett table, each sample touches few entries: the matrix B is sparse. The table
is a double cumulative sum S of the weights. B is made in blocks of rows, which bound the memory.
"""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int

from hysteresis.preisach import GridDensity, Preisach
from hysteresis.preisach._everett import GridPairs
from hysteresis.preisach._preisach import PreisachInput
from hysteresis.records._arrays import pieces

from .._levels import AT_ONCE
from ._cross_validation import NormalEquations


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


class DesignBlock(NamedTuple):
    """Rows of B in two factors, `own + path[anchor]`: samples of a branch share all but their last step.

    - `rows`: which samples they are. `own`: what each reads by itself, in node space.
    - `path` (anchors,): what the anchors read along their paths to the root. `anchor`: that of each row.
    """

    rows: slice | Int[np.ndarray, " rows"]
    own: Any
    path: Any
    anchor: Int[np.ndarray, " rows"]

    def product(self, nodes: Float[np.ndarray, "columns batch"]) -> np.ndarray:
        """B nodes."""
        return self.own @ nodes + (self.path @ nodes)[self.anchor]

    def transposed(self, values: Float[np.ndarray, "rows batch"]) -> np.ndarray:
        """B' values."""
        return self.own.T @ values + self.path.T @ (self.by_anchor() @ values)

    def by_anchor(self, taken: Any = slice(None)) -> Any:
        """(anchors, taken rows), sparse: sums the rows of each anchor."""
        anchor = self.anchor[taken]
        each = np.ones(len(anchor)), (anchor, np.arange(len(anchor)))
        return sparse.csr_matrix(each, shape=(self.path.shape[0], len(anchor)))

    @property
    def matrix(self) -> Any:
        """B, sparse."""
        return self.own + self.path[self.anchor]


def design_rows(model: Preisach, prepared: PreisachInput) -> Any:
    """B, sparse: one row per sample in node space, for a model with a `GridDensity`."""
    return sparse.vstack([block.matrix for block in design_blocks(model, prepared)]).tocsr()


def design_blocks(model: Preisach, prepared: PreisachInput) -> Iterator[DesignBlock]:
    """B in blocks of rows, for a model with a `GridDensity` and a reversible part."""
    prepared = jax.tree.map(np.asarray, prepared)
    for rows in pieces(len(prepared.sign)):
        yield design_block(model, prepared, rows)


def design_block(
    model: Preisach, prepared: PreisachInput, rows: slice | Int[np.ndarray, " rows"]
) -> DesignBlock:
    """Some rows of B; `prepared` has NumPy arrays."""
    assert isinstance(model.density, GridDensity)
    space = NodeSpace(model.density.cells, model.up is not None)
    anchors, anchor = np.unique(prepared.tree.anchor[rows], return_inverse=True)
    own = _everett_rows(space, _taken(prepared.sample, rows), prepared.sign[rows])
    path = _paths(space, prepared, anchors)
    if model.orientation < 0:
        own, path = -own, -path
    own = own + _memoryless_rows(space, prepared, rows, model.orientation)
    if space.occupancy:
        own = own + model.orientation * _occupancy_rows(space, _taken(prepared.unvisited, rows))
    return DesignBlock(rows, own.tocsr(), path, anchor)


def _paths(space: NodeSpace, prepared: PreisachInput, anchors: Int[np.ndarray, " some"]) -> Any:
    """The sums of the edges on the way of some anchors to the root, as rows in node space."""
    parent = prepared.tree.parent
    rows, on_way = [], []
    at, here = np.arange(len(anchors)), anchors
    while len(at):
        rows.append(at)
        on_way.append(here)
        at, here = at[here > 0], parent[here[here > 0]]
    used, column = np.unique(np.concatenate(on_way), return_inverse=True)
    each = np.ones(len(column)), (np.concatenate(rows), column)
    reached = sparse.csr_matrix(each, shape=(len(anchors), len(used)))
    # The change from an anchor's parent to the anchor is that of the sample at which the input turned.
    place, past = prepared.place[used], len(prepared.past_sign)
    before, place_past, place = (
        place < past,
        np.minimum(place, past - 1),
        np.maximum(place - past, 0),
    )
    pairs = jax.tree.map(
        lambda a, b: np.where(before, a[place_past], b[place]), prepared.past, prepared.sample
    )
    sign = np.where(before, prepared.past_sign[place_past], prepared.sign[place])
    found: Any = reached @ _everett_rows(space, pairs, sign)
    return found.tocsr()


def _taken(pairs: GridPairs, rows: slice | Int[np.ndarray, " rows"]) -> GridPairs:
    return GridPairs(*(part[rows] for part in pairs))


def _memoryless_rows(
    space: NodeSpace,
    prepared: PreisachInput,
    rows: slice | Int[np.ndarray, " rows"],
    orientation: int,
) -> Any:
    """Offset, reversible part, and negative saturation, where all relays together give -mass."""
    assert prepared.cell is not None
    assert prepared.within is not None
    cell, within = prepared.cell[rows], prepared.within[rows]
    ones, samples = np.ones(len(cell)), np.arange(len(cell))
    mass = np.full(len(cell), space.everett + space.cells * space.nodes)
    values = np.concatenate([ones, 1 - within, within, -orientation * ones])
    columns = np.concatenate([0 * cell, 1 + cell, 2 + cell, mass])
    where = np.tile(samples, 4), columns
    return sparse.csr_matrix((values, where), shape=(len(cell), space.columns))


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


# The normal equations of a Preisach model's unknowns, from sums over blocks of rows.
#
# With the sparse design B in node space, the double cumulative sum S and z = P x of the unknowns, the
# normal matrix is P'S'(B'B)S P, without ever forming the dense design. In a block of rows B = own +
# path[anchor], so
#
#     B'B = own'own + own'path + path'own + path'n path
#
# with the rows of each anchor summed in own'path, and n their number: the paths to the root, which are most
# of B, cost as much as there are anchors, not rows.


class NodeSums:
    """B'B, B'y and y'y of rows that are added block by block."""

    def __init__(self, space: NodeSpace) -> None:
        self.space, self.gram = space, sparse.csr_matrix((space.columns,) * 2)
        self.right, self.yy, self.rows = np.zeros(space.columns), 0.0, 0

    def add(
        self,
        block: DesignBlock,
        y: Float[np.ndarray, " rows"],
        taken: slice | Int[np.ndarray, " rows"] = slice(None),
        weights: Float[np.ndarray, " rows"] | None = None,
    ) -> None:
        """Add the rows `taken` of a block, with their outputs, each times its weight."""
        own, sums = block.own[taken], block.by_anchor(taken)
        if weights is not None:
            by = sparse.diags(weights)
            own, sums, y = by @ own, sums @ by, weights * y
        crossed = (sums @ own).T @ block.path
        path = block.path.multiply(np.asarray(sums.multiply(sums).sum(1))).tocsr()
        self.gram = self.gram + own.T @ own + crossed + crossed.T + path.T @ block.path
        self.right += own.T @ y + block.path.T @ (sums @ y)
        self.yy += float(y @ y)
        self.rows += len(y)

    def equations(self, P: Any, scale: float = 1.0) -> NormalEquations:
        """P'S'(B'B)S P, P'S'B'y and y'y, with y in units of `scale`."""
        H = normal_matrix(self.space, self.gram.tocsc(), P)
        b = gathered(self.space, self.right[:, None], P)[:, 0]
        return NormalEquations(H, b / scale, self.yy / scale**2, self.rows)


def normal_equations(
    space: NodeSpace,
    blocks: Iterable[DesignBlock],
    y: Float[np.ndarray, " samples"],
    label: Int[np.ndarray, " samples"],
    P: Any,
    weights: Float[np.ndarray, " samples"] | None = None,
) -> Iterator[tuple[int, NormalEquations]]:
    """P'S'(B'B)S P, P'S'B'y and y'y of the rows of every label that is not negative, one by one."""
    sums = {p: NodeSums(space) for p in np.unique(label[label >= 0]).tolist()}
    for block in blocks:
        here = label[block.rows]
        for p in np.unique(here[here >= 0]).tolist():
            taken = np.flatnonzero(here == p)
            own = None if weights is None else weights[block.rows][taken]
            sums[p].add(block, y[block.rows][taken], taken, own)
    for p in tuple(sums):
        yield p, sums.pop(p).equations(P)


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
    found = []
    for k in range(0, columns.shape[1], AT_ONCE):
        some = columns[:, k : k + AT_ONCE]
        dense = some.toarray() if sparse.issparse(some) else np.ascontiguousarray(some)
        found.append(turned @ space.to_unknowns(dense))
    return np.hstack(found)
