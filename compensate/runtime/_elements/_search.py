"""Searches: for the edges or nodes around a number, and for the root of a rising function."""

from collections.abc import Callable
from typing import Any

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
    if last == 0 or x <= levels[0]:
        return 0.0
    if x >= levels[last]:
        return 1.0 * last
    k = 0
    while x >= levels[k + 1]:  # at most: count
        k = k + 1
    return k + (x - levels[k]) / (levels[k + 1] - levels[k])


def newton(
    curve: Callable[[Any, float], float], slope: Callable[[Any, float], float],
    p: Any, y: float, low: float, high: float,
) -> float:  # fmt: skip
    """u with curve(u) = y between low and high: Newton's steps, halving where one leads out.

    Every fourth step halves the bounds: the end comes after four times as many as a number has bits.
    """
    u = low + (high - low) / 2.0
    for k in range(240):
        value = curve(p, u)
        if value == y:
            return u
        if value < y:
            low = u
        else:
            high = u
        steep = slope(p, u)
        before = u
        u = u + (y - value) / steep if steep > 0.0 else low
        if k % 4 == 0 or u <= low or u >= high:
            u = low + (high - low) / 2.0
        if u == before:
            return u
    return u
