"""Where a number lies among the nodes of hat functions."""

from ._codes import Reals


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
