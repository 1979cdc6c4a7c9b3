"""How far an estimate can be off, by its level, its branch, and how unlike the trained motions it came."""

from math import fabs, log, sqrt

from ._codes import Reals


class Parameters:
    """Standard deviations at `levels` estimates, on the way down and up, linear between them.

    A play of half width `width` behind the estimates, which are limited to `low` and `high` before, tells
    the branch and the reversals. The error was learnt at inputs from `least` to `most`, in strokes of mean
    speeds from `slow` to `fast`, and with `turns`: the least and the greatest of the last reversal, then of
    the one before it, on the way down, then up. Beyond, its variance grows by up to `growth`^2 and
    `hurry`^2, by half of that `near` from those inputs and reversals, and e^`factor` times beyond those
    speeds. A stroke that is longer than `timed` has a speed.
    """

    levels: int
    level: Reals
    falling: Reals
    rising: Reals
    width: float
    low: float
    high: float
    least: float
    most: float
    turns: Reals
    slow: float
    fast: float
    near: float
    factor: float
    timed: float
    growth: float
    hurry: float


class State:
    """The play, which way it went last, whether it moved; the reversals, the newest first, of which the
    last two are known by `known`; where the stroke began, how long ago, and its mean speed."""

    status: int
    begun: int
    follower: float
    up: int
    moved: int
    known: int
    last: float
    before: float
    earlier: float
    begin: float
    elapsed: float
    speed: float


ANY_MOTION: dict[str, float | list[float]] = {
    "low": -1e30, "high": 1e30, "least": -1e30, "most": 1e30, "turns": [-1e30, 1e30] * 4, "slow": 0.0,
    "fast": 1e30, "near": 1.0, "factor": 1.0, "timed": 1e30, "growth": 0.0, "hurry": 0.0,
}  # fmt: skip
"""Of files that do not know for which motions their error was learnt."""
UNMOVED: dict[str, float] = {
    "moved": 0, "known": 0, "last": 0.0, "before": 0.0, "earlier": 0.0, "begin": 0.0, "elapsed": 0.0,
    "speed": 0.0,
}  # fmt: skip


def follow(p: Parameters, s: State, dt: float, value: float) -> float:
    """The estimate, limited; the play behind it has followed."""
    seen = value
    if seen < p.low:
        seen = p.low
    if seen > p.high:
        seen = p.high
    if not s.begun:
        s.begun = 1
        s.follower = seen
        s.last = seen
        s.begin = seen
    else:
        s.elapsed = s.elapsed + dt
    old = s.follower
    if s.follower < seen - p.width:
        s.follower = seen - p.width
    if s.follower > seen + p.width:
        s.follower = seen + p.width
    up = s.up
    if s.follower > old:
        up = 1
    if s.follower < old:
        up = 0
    if up != s.up and s.moved:
        s.earlier = s.before
        s.before = s.last
        s.last = old - p.width
        if s.up:
            s.last = old + p.width
        s.begin = old
        s.elapsed = 0.0
        if s.known < 2:
            s.known = s.known + 1
    s.up = up
    if s.follower != old:
        s.moved = 1
    # A reversal that is passed again is forgotten, with the one after it.
    if s.known and ((up and seen > s.before) or (not up and seen < s.before)):
        if s.known > 1:
            s.last = s.earlier
        s.known = 0
    span = fabs(s.follower - s.begin)
    if span > p.timed and s.elapsed > 0.0:
        s.speed = span / s.elapsed
    return seen


def outside(at: float, low: float, high: float) -> float:
    if at < low:
        return low - at
    if at > high:
        return at - high
    return 0.0


def grown(p: Parameters, s: State, seen: float) -> float:
    """The variance beyond that on the motions seen."""
    way = 0
    if s.up:
        way = 4
    now = outside(seen, p.least, p.most)
    last = outside(s.last, p.turns[way], p.turns[way + 1])
    before = 0.0
    if s.known:
        before = outside(s.before, p.turns[way + 2], p.turns[way + 3])
    away = (now * now + last * last + before * before) / (p.near * p.near)
    off = 0.0
    if s.speed > p.fast:
        off = log(s.speed / p.fast) / p.factor
    if s.speed > 0.0 and s.speed < p.slow:
        off = log(p.slow / s.speed) / p.factor
    rate = off * off
    return p.growth * p.growth * away / (1.0 + away) + p.hurry * p.hurry * rate / (1.0 + rate)


def deviation(p: Parameters, s: State, dt: float, value: float) -> float:
    seen = follow(p, s, dt, value)
    last = p.levels - 1
    k = 0
    while k < last - 1 and value > p.level[k + 1]:  # at most: p.levels
        k = k + 1
    part = (value - p.level[k]) / (p.level[k + 1] - p.level[k])
    if part < 0.0:
        part = 0.0
    if part > 1.0:
        part = 1.0
    error = p.falling[k] * (1.0 - part) + p.falling[k + 1] * part
    if s.up:
        error = p.rising[k] * (1.0 - part) + p.rising[k + 1] * part
    return sqrt(error * error + grown(p, s, seen))
