"""The cell of a number between rising edges."""

from ._codes import Reals


def cell_of(edges: Reals, cells: int, x: float) -> int:
    """The last cell that begins at x or before; the first one where none does."""
    first = 0
    last = cells - 1
    while first < last:  # at most: log2(cells) + 1
        middle = (first + last + 1) // 2
        if edges[middle] <= x:
            first = middle
        else:
            last = middle - 1
    return first


def cell_before(edges: Reals, cells: int, x: float) -> int:
    """The last cell that begins before x; the first one where none does."""
    first = 0
    last = cells - 1
    while first < last:  # at most: log2(cells) + 1
        middle = (first + last + 1) // 2
        if edges[middle] < x:
            first = middle
        else:
            last = middle - 1
    return first
