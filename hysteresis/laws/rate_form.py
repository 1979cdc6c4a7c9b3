"""A force whose rate goes with the input's speed: by a table of the force, or Bouc-Wen's of mixed sign.

Source: Bouc 1967, Wen 1976; Duhem 1897. Steps: the classical Runge-Kutta method, of fourth order.
"""

from math import fabs, pow

from ._codes import Reals
from ._search import even_cell


class Parameters:
    """dz = f(z) du, another f while u falls. With `knots` it is straight between the values of `rate` at
    even ones about 0, `per` of them a unit, first while u rises, then while it falls. Without,

        f = alpha - (gamma sign(z) + delta) |z|^n,     gamma as -gamma while u falls

    A sample takes `steps`.
    """

    steps: int
    knots: int
    per: float
    rate: Reals
    alpha: float
    gamma: float
    delta: float
    n: float


class State:
    """The input and the force."""

    status: int
    u: float
    z: float


def slope(p: Parameters, z: float, falls: int) -> float:
    """f(z)."""
    if p.knots > 0:
        place = z * p.per + 0.5 * (p.knots - 1)
        k = even_cell(p.knots - 1, place)
        first = p.knots + k if falls else k
        return p.rate[first] + (p.rate[first + 1] - p.rate[first]) * (place - k)
    if z == 0.0:
        return p.alpha
    side = -p.gamma if (z < 0.0) != (falls != 0) else p.gamma
    return p.alpha - (side + p.delta) * pow(fabs(z), p.n)


def look(p: Parameters, s: State, u: float) -> float:
    h = (u - s.u) / p.steps
    falls = 1 if h < 0.0 else 0
    z = s.z
    for _k in range(p.steps):
        a = slope(p, z, falls)
        b = slope(p, z + 0.5 * h * a, falls)
        c = slope(p, z + 0.5 * h * b, falls)
        d = slope(p, z + h * c, falls)
        z = z + h * (a + 2.0 * b + 2.0 * c + d) / 6.0
    return z


def move(p: Parameters, s: State, u: float) -> float:
    s.z = look(p, s, u)
    s.u = u
    return s.z
