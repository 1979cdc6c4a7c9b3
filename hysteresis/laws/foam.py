"""Force over compression of a foam: toe, linear part, plateau, densification.

Source: Gibson and Ashby, Cellular Solids (1997), for the stages; the rounded passages are ours.
"""

from math import asinh, sqrt

from ._codes import OK
from ._search import newton


class Parameters:
    """The slope is linear (toe (1 - S(u - u1)) + S(u - u1) - S(u - u2) + plateau S(u - u2) +
    densification r(u - u3)): r(x) = (x + sqrt(x^2 + rounding^2)) / 2 and S = r'. y(0) = offset.

    `least` is the smallest slope; `origin` is the integral at 0, which is taken off.
    """

    linear: float
    toe: float
    plateau: float
    u1: float
    u2: float
    u3: float
    rounding: float
    densification: float
    offset: float
    least: float
    origin: float


class State:
    """No memory."""

    status: int


def ramp(x: float, width: float) -> float:
    return (x + sqrt(x * x + width * width)) / 2.0


def ramp_slope(x: float, width: float) -> float:
    return (1.0 + x / sqrt(x * x + width * width)) / 2.0


def slope(p: Parameters, u: float) -> float:
    w = p.rounding
    first = ramp_slope(u - p.u1, w)
    second = ramp_slope(u - p.u2, w)
    rest = second * (p.plateau - 1.0) + p.densification * ramp(u - p.u3, w)
    return p.linear * (p.toe + (1.0 - p.toe) * first + rest)


def curve(p: Parameters, u: float) -> float:
    w = p.rounding
    x = u - p.u3
    dense = (x * x + x * sqrt(x * x + w * w) + w * w * asinh(x / w)) / 4.0
    total = p.toe * u + (1.0 - p.toe) * ramp(u - p.u1, w) + (p.plateau - 1.0) * ramp(u - p.u2, w)
    return p.offset + p.linear * (total + p.densification * dense - p.origin)


def look(p: Parameters, s: State, u: float) -> float:
    return curve(p, u)


def move(p: Parameters, s: State, u: float) -> float:
    return curve(p, u)


def find(p: Parameters, s: State, y: float) -> float:
    farthest = (y - p.offset) / p.least
    s.status = OK
    low = farthest if farthest < 0.0 else 0.0
    high = farthest if farthest > 0.0 else 0.0
    return newton(curve, slope, p, y, low, high)
