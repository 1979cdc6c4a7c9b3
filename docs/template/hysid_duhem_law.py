"""The Duhem model as a law: one step in plain numbers, which runs as it is and becomes C."""

from math import exp, fabs


class Parameters:
    """dy = alpha |du| (beta u - y) + gamma du."""

    alpha: float
    beta: float
    gamma: float


class State:
    """The last input and output."""

    status: int
    u: float
    y: float


def look(p: Parameters, s: State, u: float) -> float:
    gap = (p.gamma - p.beta) / p.alpha
    if u < s.u:
        gap = -gap
    return p.beta * u + gap + (s.y - p.beta * s.u - gap) * exp(-p.alpha * fabs(u - s.u))


def move(p: Parameters, s: State, u: float) -> float:
    y = look(p, s, u)
    s.u = u
    s.y = y
    return y
