"""The root of a rising function."""

from collections.abc import Callable
from typing import Any


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
