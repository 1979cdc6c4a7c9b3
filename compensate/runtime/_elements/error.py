"""How far an estimate can be off, by its level and the branch it is on."""

from ._codes import Reals


class Parameters:
    """Standard deviations at `levels` estimates, on the way down and up, linear between them.

    A play of half width `width` behind the estimates tells the branch.
    """

    levels: int
    level: Reals
    falling: Reals
    rising: Reals
    width: float


class State:
    """The play, and which way it went last."""

    status: int
    begun: int
    follower: float
    up: int


def deviation(p: Parameters, s: State, value: float) -> float:
    before = s.follower if s.begun else value
    s.begun = 1
    after = before
    if after < value - p.width:
        after = value - p.width
    if after > value + p.width:
        after = value + p.width
    if after > before:
        s.up = 1
    if after < before:
        s.up = 0
    s.follower = after
    last = p.levels - 1
    k = 0
    while k < last - 1 and value > p.level[k + 1]:  # at most: p.levels
        k = k + 1
    part = (value - p.level[k]) / (p.level[k + 1] - p.level[k])
    if part < 0.0:
        part = 0.0
    if part > 1.0:
        part = 1.0
    if s.up:
        return p.rising[k] * (1.0 - part) + p.rising[k + 1] * part
    return p.falling[k] * (1.0 - part) + p.falling[k + 1] * part
