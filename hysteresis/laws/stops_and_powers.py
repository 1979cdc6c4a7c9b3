"""Stops and powers of the input: what a hysteretic spring adds to a straight one.

Source: Iwan, J. Appl. Mech. 33 (1966).
"""

from ._codes import Reals


class Parameters:
    """y = sum of weights_j s_j + powers_0 u^2 + powers_1 u^3 + powers_2 u |u|, stop s_j within
    thresholds_j."""

    stops: int
    thresholds: Reals
    weights: Reals
    powers: Reals


class State:
    """The input, and the strain of every stop."""

    status: int
    u: float
    strain: Reals


def strained(p: Parameters, s: State, j: int, u: float) -> float:
    """Stop j, where the input takes it."""
    strain = s.strain[j] + (u - s.u)
    limit = p.thresholds[j]
    if strain > limit:
        strain = limit
    elif strain < -limit:
        strain = -limit
    return strain


def look(p: Parameters, s: State, u: float) -> float:
    y = (p.powers[0] + p.powers[1] * u + p.powers[2] * (1.0 if u > 0.0 else -1.0)) * u * u
    for j in range(p.stops):
        y = y + p.weights[j] * strained(p, s, j, u)
    return y


def move(p: Parameters, s: State, u: float) -> float:
    y = (p.powers[0] + p.powers[1] * u + p.powers[2] * (1.0 if u > 0.0 else -1.0)) * u * u
    for j in range(p.stops):
        s.strain[j] = strained(p, s, j, u)
        y = y + p.weights[j] * s.strain[j]
    s.u = u
    return y
