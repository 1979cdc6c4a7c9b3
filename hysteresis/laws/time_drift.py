"""A drift with the time since the first sample, as of a zero that warms up.

Source: Doebelin, Measurement Systems (2003), for the response to a step of temperature.
"""

from math import exp

from ._codes import Reals


class Parameters:
    """y = offset + sum of ends_j (1 - exp(-rates_j min(time since the first sample, most)))."""

    count: int
    rates: Reals
    ends: Reals
    most: float
    offset: float


class State:
    """The time since the first sample, and what rounding has added to it: float steps of 1 ms alone would
    add up to 4.6 h at most. `begun` is 0 before the first sample.
    """

    status: int
    begun: int
    elapsed: float
    gained: float


def look(p: Parameters, s: State, dt: float, u: float) -> float:
    if not s.begun:
        return p.offset
    elapsed = s.elapsed + dt
    if elapsed > p.most:
        elapsed = p.most
    y = p.offset
    for j in range(p.count):
        y = y + p.ends[j] * (1.0 - exp(-p.rates[j] * elapsed))
    return y


def move(p: Parameters, s: State, dt: float, u: float) -> float:
    y = look(p, s, dt, u)
    if s.begun:  # as Kahan adds
        step = dt - s.gained
        elapsed = s.elapsed + step
        s.gained = elapsed - s.elapsed - step
        s.elapsed = elapsed
    s.begun = 1
    return y
