"""Duhem's operator: the slope of the output depends on the output and on the direction of the input.

Source: Duhem 1897; Macki, Nistri and Zecca 1993.
"""

from math import expm1, log1p

from ._codes import OK, Reals


class Parameters:
    """Slopes at even knots of the output from `low` on, `width` apart, and the input's `ways` from
    the first knot to each: `knots` of them while the input rises, then as many while it falls."""

    knots: int
    low: float
    width: float
    slopes: Reals
    ways: Reals


class State:
    """Input and output."""

    status: int
    u: float
    y: float


def way(p: Parameters, first: int, y: float) -> float:
    """The input's way from the first knot to y, along the slopes that begin at `first`: the integral of dy
    over the slope, which is constant beyond the knots."""
    last = p.knots - 1
    inside = y - p.low
    beyond = 0.0
    if inside < 0.0:
        beyond = inside / p.slopes[first]
        inside = 0.0
    if inside > p.width * last:
        beyond = (inside - p.width * last) / p.slopes[first + last]
        inside = p.width * last
    k = int(inside / p.width)
    if k > last - 1:
        k = last - 1
    inside = inside - k * p.width
    slope = p.slopes[first + k]
    bend = (p.slopes[first + k + 1] / slope - 1.0) * inside / p.width
    growth = log1p(bend) / bend if bend > 1e-8 or bend < -1e-8 else 1.0 - bend / 2.0
    return p.ways[first + k] + inside / slope * growth + beyond


def reached(p: Parameters, first: int, gone: float) -> float:
    """The output after a way from the first knot: the inverse of `way`."""
    last = p.knots - 1
    longest = p.ways[first + last]
    if gone < 0.0:
        return p.low + gone * p.slopes[first]
    if gone > longest:
        return p.low + p.width * last + (gone - longest) * p.slopes[first + last]
    k = 0
    for j in range(1, p.knots - 1):
        if gone >= p.ways[first + j]:
            k = j
    inside = gone - p.ways[first + k]
    slope = p.slopes[first + k]
    x = (p.slopes[first + k + 1] - slope) / p.width * inside
    growth = expm1(x) / x if x > 1e-8 or x < -1e-8 else 1.0 + x / 2.0
    return p.low + k * p.width + slope * inside * growth


def look(p: Parameters, s: State, u: float) -> float:
    if u == s.u:
        return s.y
    first = p.knots if u < s.u else 0
    return reached(p, first, way(p, first, s.y) + (u - s.u))


def move(p: Parameters, s: State, u: float) -> float:
    s.y = look(p, s, u)
    s.u = u
    return s.y


def find(p: Parameters, s: State, y: float) -> float:
    """Slopes are positive, so the output says in which direction the input went."""
    first = p.knots if y < s.y else 0
    s.u = s.u + (way(p, first, y) - way(p, first, s.y))
    s.y = y
    s.status = OK
    return s.u
