"""A line above a threshold: the linear sponge.

Source: Tsuji 2014, equation (8).
"""

from ._codes import BELOW_THRESHOLD, OK


class Parameters:
    """y = K u + b from the threshold on, else 0."""

    K: float
    b: float
    threshold: float
    least: float


class State:
    """A line has no memory."""

    status: int


def look(p: Parameters, s: State, u: float) -> float:
    return p.K * u + p.b if u >= p.threshold else 0.0


def move(p: Parameters, s: State, u: float) -> float:
    return look(p, s, u)


def find(p: Parameters, s: State, y: float) -> float:
    u = (y - p.b) / p.K
    # `least` is the threshold but for rounding.
    if u >= p.least:
        s.status = OK
        return u if u > p.threshold else p.threshold
    s.status = BELOW_THRESHOLD
    return 0.0 if p.threshold > 0.0 else p.threshold - 1.0
