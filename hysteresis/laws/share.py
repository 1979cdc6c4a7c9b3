"""The share of a model of one value of a condition: 1 there, and straight to 0 at the next values.

y = share f[u], f the inner model
"""

from math import log


class Parameters:
    """The value and its neighbours on the axis of the condition: 0 the condition itself, 1 its logarithm, 2
    its reciprocal with the sign turned. The condition is taken between `low` and `high`."""

    axis: int
    low: float
    high: float
    before: float
    at: float
    after: float


class State:
    """The share at the last condition."""

    status: int
    share: float


def take(p: Parameters, s: State, condition: float) -> float:
    c = condition
    if c < p.low:
        c = p.low
    if c > p.high:
        c = p.high
    if p.axis == 1:
        c = log(c)
    if p.axis == 2:
        c = -1.0 / c
    s.share = 1.0
    if c < p.at:
        s.share = (c - p.before) / (p.at - p.before)
    if c > p.at:
        s.share = (p.after - c) / (p.after - p.at)
    if s.share < 0.0:
        s.share = 0.0
    return s.share


def weighted(s: State, y: float) -> float:
    return s.share * y
