"""Viscous and Coulomb friction that depend on the place, with a filtered velocity.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994), without the Stribeck fall.
"""

from math import exp, tanh

from ._codes import Reals
from ._search import among, at_level
from .maxwell import gain_of


class Parameters:
    """y = offset + sum of h_k(u before) (viscous_k v + weights_jk tanh(v / speeds_j)).

    v = q rate with q' = u' - q rate is a filtered velocity, h_k are hat functions on `levels`.
    """

    speeds_count: int
    count: int
    speeds: Reals
    levels: Reals
    weights: Reals
    viscous: Reals
    rate: float
    offset: float


class State:
    """The input before and q; `begun` is 0 before the first sample. The step over `dt`."""

    status: int
    begun: int
    u: float
    lead: float
    dt: float
    decay: float
    gain: float


def tabulate(p: Parameters, s: State, dt: float) -> None:
    s.dt = dt
    x = p.rate * dt
    s.decay = exp(-x)
    s.gain = gain_of(x, s.decay)


def look(p: Parameters, s: State, dt: float, u: float) -> float:
    if not s.begun:
        return p.offset
    if dt != s.dt:
        tabulate(p, s, dt)
    v = (s.decay * s.lead + s.gain * (u - s.u)) * p.rate
    level = among(p.levels, p.count, s.u)
    y = p.offset + at_level(p.viscous, 0, p.count, level) * v
    for j in range(p.speeds_count):
        felt = at_level(p.weights, j * p.count, p.count, level)
        y = y + felt * tanh(v / p.speeds[j])
    return y


def move(p: Parameters, s: State, dt: float, u: float) -> float:
    y = look(p, s, dt, u)
    if s.begun:
        s.lead = s.decay * s.lead + s.gain * (u - s.u)
    s.begun = 1
    s.u = u
    return y
