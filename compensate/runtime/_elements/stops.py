"""Stop operators whose stiffness depends on where the input was, or on the range it has covered."""

from ._codes import Reals
from ._search import among


class Parameters:
    """y = offset + sum of h_k(m) (springs_k (u - rest) + slopes_jk (s_j - s_(j-1))), s_0 = 0.

    s_j is a stop that slides at thresholds_j, h_k are hat functions on `levels` of m: the input before if
    `by_position`, else the range covered.
    """

    stops: int
    count: int
    thresholds: Reals
    levels: Reals
    slopes: Reals
    springs: Reals
    offset: float
    rest: float
    by_position: int


class State:
    """The input before, the least and the largest one so far, every stop's place u - s_j."""

    status: int
    u: float
    least: float
    largest: float
    z: Reals


def place(p: Parameters, s: State, j: int, u: float) -> float:
    z = s.z[j]
    if z < u - p.thresholds[j]:
        z = u - p.thresholds[j]
    if z > u + p.thresholds[j]:
        z = u + p.thresholds[j]
    return z


def look(p: Parameters, s: State, dt: float, u: float) -> float:
    level = among(p.levels, p.count, s.u if p.by_position else s.largest - s.least)
    k = int(level)
    above = k + 1 if k + 1 < p.count else k
    within = level - k
    y = p.offset + (p.springs[k] * (1.0 - within) + p.springs[above] * within) * (u - p.rest)
    strain = 0.0
    for j in range(p.stops):
        row = j * p.count
        slope = p.slopes[row + k] * (1.0 - within) + p.slopes[row + above] * within
        before = strain
        strain = u - place(p, s, j, u)
        y = y + slope * (strain - before)
    return y


def move(p: Parameters, s: State, dt: float, u: float) -> float:
    y = look(p, s, dt, u)
    for j in range(p.stops):
        s.z[j] = place(p, s, j, u)
    s.u = u
    if u < s.least:
        s.least = u
    if u > s.largest:
        s.largest = u
    return y
