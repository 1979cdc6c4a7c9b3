"""Maxwell branches with non-linear springs: rate dependence that changes with the level."""

from math import exp

from ._codes import Reals


class Parameters:
    """y = offset + sum of Q_k[g_k(u)] + c_k(u) Q_k[v], with v = (u - low) scale / cells, Q_k relaxing in
    1 / rates_k; not `leading`, y = offset + sum of g_k(u) - Q_k[g_k(u)] - c_k(u) Q_k[v].

    `springs` (branches, cells + 1) are g_k at the nodes, `increments` (branches, cells) their rises,
    `above` and `below` (branches, cells + 1) the strengths c_k where Q_k > 0 and elsewhere.
    """

    branches: int
    cells: int
    low: float
    scale: float
    rates: Reals
    springs: Reals
    increments: Reals
    above: Reals
    below: Reals
    offset: float
    leading: int


class State:
    """The input, and every branch's memory, of its spring and of the input; the step over `dt`."""

    status: int
    u: float
    spring: Reals
    linear: Reals
    dt: float
    decay: Reals
    gain: Reals


def tabulate(p: Parameters, s: State, dt: float) -> None:
    s.dt = dt
    for k in range(p.branches):
        x = p.rates[k] * dt
        s.decay[k] = exp(-x)
        if x < 0.01:
            # (1 - exp(-x)) / x by its series: left out is x^6 / 5040.
            series = 1.0 - x / 5.0 * (1.0 - x / 6.0)
            series = 1.0 - x / 3.0 * (1.0 - x / 4.0 * series)
            s.gain[k] = 1.0 - x / 2.0 * series
        else:
            s.gain[k] = (1.0 - s.decay[k]) / x


def cell_at(p: Parameters, u: float) -> int:
    x = (u - p.low) * p.scale
    if not x > 0.0:
        return 0
    return p.cells - 1 if x >= p.cells else int(x)


def spring_of(p: Parameters, k: int, u: float) -> float:
    """g_k(u)."""
    cell = cell_at(p, u)
    within = (u - p.low) * p.scale - cell
    return p.springs[k * (p.cells + 1) + cell] + within * p.increments[k * p.cells + cell]


def look(p: Parameters, s: State, dt: float, u: float) -> float:
    if dt != s.dt:
        tabulate(p, s, dt)
    cell = cell_at(p, u)
    within = (u - p.low) * p.scale - cell
    if within < 0.0:
        within = 0.0
    if within > 1.0:
        within = 1.0
    y = p.offset
    for k in range(p.branches):
        g = spring_of(p, k, u)
        spring = s.decay[k] * s.spring[k] + s.gain[k] * (g - spring_of(p, k, s.u))
        linear = s.decay[k] * s.linear[k] + s.gain[k] * (u - s.u) * p.scale / p.cells
        node = k * (p.cells + 1) + cell
        if linear > 0.0:
            felt = p.above[node] * (1.0 - within) + p.above[node + 1] * within
        else:
            felt = p.below[node] * (1.0 - within) + p.below[node + 1] * within
        y = y + (spring + felt * linear if p.leading else g - spring - felt * linear)
    return y


def move(p: Parameters, s: State, dt: float, u: float) -> float:
    y = look(p, s, dt, u)
    for k in range(p.branches):
        rise = spring_of(p, k, u) - spring_of(p, k, s.u)
        s.spring[k] = s.decay[k] * s.spring[k] + s.gain[k] * rise
        s.linear[k] = s.decay[k] * s.linear[k] + s.gain[k] * (u - s.u) * p.scale / p.cells
    s.u = u
    return y
