"""A drift with the path travelled, different from place to place.

Source: Diani, Fayolle and Gilormini, European Polymer Journal 45 (2009), for the logarithm of cycles.
"""

from math import fabs, log1p

from ._codes import Reals
from ._search import among, at_level


class Parameters:
    """y = offset + sum of h_k(u before) drift_k log(1 + clip(path - least, 0, most) / length).

    h_k are hat functions on `levels`.
    """

    count: int
    levels: Reals
    drift: Reals
    least: float
    most: float
    length: float
    offset: float


class State:
    """The input before, the path until then, and what rounding has added to it, as to the time in
    `time_drift`; `begun` is 0 before the first sample.
    """

    status: int
    begun: int
    u: float
    path: float
    gained: float


def look(p: Parameters, s: State, u: float) -> float:
    if not s.begun:
        return p.offset
    level = among(p.levels, p.count, s.u)
    slope = at_level(p.drift, 0, p.count, level)
    further = s.path - p.least
    if further < 0.0:
        further = 0.0
    if further > p.most:
        further = p.most
    return p.offset + slope * log1p(further / p.length)


def move(p: Parameters, s: State, u: float) -> float:
    y = look(p, s, u)
    if s.begun:  # as Kahan adds
        step = fabs(u - s.u) - s.gained
        path = s.path + step
        s.gained = path - s.path - step
        s.path = path
    s.begun = 1
    s.u = u
    return y
