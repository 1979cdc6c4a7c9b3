"""The normal equations of a Preisach model's unknowns, from sums over blocks of rows.

With the sparse design B in node space, the double cumulative sum S and z = P x of the unknowns, the normal
matrix is P'S'(B'B)S P, without ever forming the dense design. In a block of rows B = own + path[anchor], so

    B'B = own'own + own'path + path'own + path'n path

with the rows of each anchor summed in own'path, and n their number: the paths to the root, which are most
of B, cost as much as there are anchors, not rows.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int

from .._levels import AT_ONCE
from ._cross_validation import NormalEquations
from ._preisach_design_matrix import DesignBlock, NodeSpace


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
