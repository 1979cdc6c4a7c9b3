"""Sums over rows from which the normal equations under AR(1) noise follow for any correlation."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class NeighbourSums(NamedTuple):
    """Sums over rows b_i that follow one another in sequences:

        same = sum of b_i b_i',      next = sum of b_i b_(i+1)' + b_(i+1) b_i',
        ends = sum of b b' over the first and the last row of each sequence.

    The inverse of the covariance V_ij = phi^|i - j| of AR(1) noise of unit variance is tridiagonal, so that

        B' V^-1 B = ((1 + phi^2) same - phi next - phi^2 ends) / (1 - phi^2),
        log det V = (rows - sequences) log(1 - phi^2).
    """

    same: Float[np.ndarray, "columns columns"]
    next: Float[np.ndarray, "columns columns"]
    ends: Float[np.ndarray, "columns columns"]
    rows: int
    sequences: int

    def under(self, phi: float) -> Float[np.ndarray, "columns columns"]:
        """B' V^-1 B."""
        found = (1 + phi**2) * self.same - phi * self.next - phi**2 * self.ends
        return found / (1 - phi**2)

    def moved(self, by: Float[np.ndarray, "moved _"]) -> "NeighbourSums":
        """Those of M b_i, b_i without its last column."""
        same, following, ends = (by @ one[:-1, :-1] @ by.T for one in self[:3])
        return NeighbourSums(same, following, ends, self.rows, self.sequences)

    def log_determinant(self, phi: float) -> float:
        """log det V."""
        return float((self.rows - self.sequences) * np.log1p(-(phi**2)))


def neighbour_sums(
    blocks: Iterable[Float[np.ndarray, "rows columns"]], sequences: Sequence[slice]
) -> NeighbourSums:
    """Those of rows that come in blocks, the `sequences` being slices of all of them."""
    rows = max((each.stop for each in sequences), default=0)
    first, last = np.zeros(rows, bool), np.zeros(rows, bool)
    first[[each.start for each in sequences]] = True
    last[[each.stop - 1 for each in sequences]] = True
    same, following, ends = 0.0, 0.0, 0.0
    begin, before = 0, None
    for block in blocks:
        here = slice(begin, begin + len(block))
        same = same + block.T @ block
        for at in (first[here], last[here]):
            ends = ends + block[at].T @ block[at]
        goes_on = ~first[here]
        joined = block if before is None else np.vstack([before, block])
        second = joined[-len(block) :][goes_on] if before is not None else block[goes_on]
        behind = joined[: len(block)][goes_on] if before is not None else block[:-1][goes_on[1:]]
        crossed = behind.T @ second
        following = following + crossed + crossed.T
        begin, before = here.stop, block[-1:]
    return NeighbourSums(
        np.asarray(same), np.asarray(following), np.asarray(ends), rows, len(sequences)
    )
