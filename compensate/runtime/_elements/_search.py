"""Where a number lies between rising edges, or among the nodes of hat functions."""

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


def among(levels: Reals, count: int, x: float) -> float:
    """Its cell and the part of that: 0 at or below the first level, count - 1 at or above the last."""
    last = count - 1
    if x <= levels[0]:
        return 0.0
    if x >= levels[last]:
        return 1.0 * last
    k = 0
    while x >= levels[k + 1]:  # at most: count
        k = k + 1
    return k + (x - levels[k]) / (levels[k + 1] - levels[k])
