"""The Bouc-Wen model: a spring beside one that yields, integrated along the input's path."""

from math import exp, fabs, pow

from ._codes import OK, SATURATED, Reals


class Parameters:
    """y = offset + k (alpha u + (1 - alpha) yield_at w). On a way up, in parts of yield_at,

        dw = (1 - w^n) dx  from 0 up,     dw = (1 + descent |w|^n) dx  below 0.

    `powers`, `cubes`, `weights`: of quadrature nodes x in (0, 1), x^(3n), x^3 and 3 x^2 dx, in which
    s = size x^3 makes s^n smooth. Newton's method ends once a step is no more than `finest`.
    """

    nodes: int
    powers: Reals
    cubes: Reals
    weights: Reals
    k: float
    alpha: float
    yield_at: float
    n: float
    descent: float
    offset: float
    rounding: float
    finest: float


class State:
    """The input, and z in parts of yield_at."""

    status: int
    u: float
    w: float


def power(p: Parameters, size: float) -> float:
    return pow(size, p.n) if size > 0.0 else 0.0


def below(p: Parameters, size: float) -> float:
    """The way from -size up to 0."""
    high = p.descent * power(p, size)
    total = 0.0
    for i in range(p.nodes):
        total = total + p.weights[i] / (1.0 + high * p.powers[i])
    return size * total


def above(p: Parameters, size: float) -> float:
    """The way from 0 up to size, less -log(1 - size) / n."""
    high = power(p, size)
    total = 0.0
    for i in range(p.nodes):
        smooth = 1.0 / (1.0 - high * p.powers[i]) - 1.0 / (p.n * (1.0 - size * p.cubes[i]))
        total = total + p.weights[i] * smooth
    return size * total


def lower(p: Parameters, wanted: float, way: float, rise: float) -> float:
    """The size s at which way below(s) + rise s is wanted. It is concave: Newton's method stays below."""
    s = 0.0
    for _turn in range(100):
        step = wanted - way * below(p, s) - rise * s
        step = step / (way / (1.0 + p.descent * power(p, s)) + rise)
        s = s + step
        if fabs(step) <= p.finest:
            return s
    return s


def upper(p: Parameters, w: float, wanted: float, way: float, rise: float) -> float:
    """v with way (v / n + above(1 - gap e^-v) - above(w)) + rise gap (1 - e^-v) = wanted, gap = 1 - w.

    1 - gap e^-v is where w comes to. Concave, too."""
    gap = 1.0 - w
    begin = above(p, w)
    v = 0.0
    for _turn in range(100):
        left = gap * exp(-v)
        slope = way / p.n + rise * left
        if left > 1e-12:
            slope = way * left / (1.0 - power(p, 1.0 - left)) + rise * left
        if slope <= 0.0:
            return v
        step = wanted - way * (v / p.n + above(p, 1.0 - left) - begin) - rise * (gap - left)
        step = step / slope
        v = v + step
        if fabs(step) <= p.finest * (1.0 + v):
            return v
    return v


def output(p: Parameters, u: float, w: float) -> float:
    return p.offset + p.k * (p.alpha * u + (1.0 - p.alpha) * p.yield_at * w)


def go(p: Parameters, s: State, rising: int, wanted: float, way: float, rise: float) -> float:
    """Move w so that way dx + rise dw sum up to wanted; the way x, in parts of yield_at."""
    sign = 1.0 if rising else -1.0
    w = sign * s.w
    gone = 0.0
    if w < 0.0:
        gone = below(p, -w)
        to_zero = way * gone - rise * w
        if wanted < to_zero:
            size = lower(p, to_zero - wanted, way, rise)
            s.w = -sign * size
            return gone - below(p, size)
        wanted = wanted - to_zero
        w = 0.0
    v = upper(p, w, wanted, way, rise)
    begin = above(p, w)
    w = 1.0 - (1.0 - w) * exp(-v)
    s.w = sign * w
    return gone + v / p.n + above(p, w) - begin


def move(p: Parameters, s: State, u: float) -> float:
    if u > s.u:
        go(p, s, 1, (u - s.u) / p.yield_at, 1.0, 0.0)
    if u < s.u:
        go(p, s, 0, (s.u - u) / p.yield_at, 1.0, 0.0)
    s.u = u
    return output(p, u, s.w)


def look(p: Parameters, s: State, u: float) -> float:
    before = s.u
    w = s.w
    y = move(p, s, u)
    s.u = before
    s.w = w
    return y


def find(p: Parameters, s: State, y: float) -> float:
    rise = y - output(p, s.u, s.w)
    rising = 1 if rise > 0.0 else 0
    sign = 1.0 if rising else -1.0
    s.status = OK
    # Without a stiffness after yield, z is all there is, in parts of k yield_at.
    size = fabs(y) + fabs(p.offset) + p.k * p.yield_at
    left = p.k * p.yield_at * (1.0 - sign * s.w)
    if p.alpha == 0.0 and fabs(rise) > left + p.rounding * size:
        s.status = SATURATED
        return s.u
    if rise != 0.0:
        way = go(p, s, rising, fabs(rise) / (p.k * p.yield_at), p.alpha, 1.0 - p.alpha)
        s.u = s.u + sign * way * p.yield_at
    return s.u
