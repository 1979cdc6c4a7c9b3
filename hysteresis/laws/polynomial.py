"""A polynomial between two inputs, continued along its tangents."""

from ._codes import EXTRAPOLATED, OK, SATURATED, Reals
from ._search import newton


class Parameters:
    """y = sum of coefficients_i x^i, x = (2 u - low - high) / (high - low).

    `first`, `last`: outputs at low and high. Outputs closer than `margin` are one.
    """

    degree: int
    coefficients: Reals
    low: float
    high: float
    first: float
    last: float
    margin: float


class State:
    """No memory."""

    status: int


def scaled(p: Parameters, u: float) -> float:
    return (2.0 * u - p.low - p.high) / (p.high - p.low)


def clipped(x: float) -> float:
    if x < -1.0:
        return -1.0
    return x if x < 1.0 else 1.0


def slope(p: Parameters, u: float) -> float:
    """dy/du."""
    x = clipped(scaled(p, u))
    total = 0.0
    for i in range(p.degree):
        n = p.degree - i
        total = total * x + n * p.coefficients[n]
    return total * 2.0 / (p.high - p.low)


def curve(p: Parameters, u: float) -> float:
    x = scaled(p, u)
    inside = clipped(x)
    total = 0.0
    for i in range(p.degree + 1):
        total = total * inside + p.coefficients[p.degree - i]
    return total + slope(p, u) * (x - inside) * (p.high - p.low) / 2.0


def look(p: Parameters, s: State, u: float) -> float:
    return curve(p, u)


def move(p: Parameters, s: State, u: float) -> float:
    return curve(p, u)


def find(p: Parameters, s: State, y: float) -> float:
    inside = y if y > p.first else p.first
    if inside > p.last:
        inside = p.last
    u = newton(curve, slope, p, inside, p.low, p.high)
    s.status = OK
    if y - inside > p.margin or inside - y > p.margin:
        s.status = SATURATED
    if y != inside:
        steep = slope(p, p.low if y < inside else p.high)
        if steep > 0.0:
            u = u + (y - inside) / steep
            if s.status == SATURATED:
                s.status = EXTRAPOLATED
    return u
