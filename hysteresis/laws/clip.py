"""The input itself between two limits, and the nearer of them beyond.

y = min(max(u, low), high)
"""

from ._codes import FLAT, OK, SATURATED


class Parameters:
    """The limits."""

    low: float
    high: float


class State:
    """No memory."""

    status: int


def look(p: Parameters, s: State, u: float) -> float:
    if u < p.low:
        return p.low
    return p.high if u > p.high else u


def move(p: Parameters, s: State, u: float) -> float:
    return look(p, s, u)


def find(p: Parameters, s: State, y: float) -> float:
    if y < p.low or y > p.high:
        s.status = SATURATED
    else:
        # At an end every input beyond gives it.
        s.status = FLAT if y == p.low or y == p.high else OK
    return look(p, s, y)
