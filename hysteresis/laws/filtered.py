"""An extended Kalman filter of the input around a tree: readings are noisy, the input walks at random.

u_k = u_(k-1) + N(0, step),     y_k = h(u_k) + N(0, noise),     h the next output from where the model is

Source: Jazwinski 1970 (the filter); what turns that were not seen and bends leave open is ours.
"""

from collections.abc import Callable
from math import fabs, sqrt
from typing import Any

from ._codes import Reals

KINK = 0.09084505690810466
"""1/4 - 1/(2 pi): what a line leaves of the variance of a corner, in parts of P times the jump of its slope
squared."""

FINEST = 1e-12
"""Part of the variance: within a millionth of the step a chord would be rounding."""


class Parameters:
    """`step`: variance of the input's step, per sample or, where it is `by_time`, per time. `noise`: of the
    readings."""

    step: float
    noise: float
    by_time: int


class State:
    """The last estimate and its variance; nothing is known of them where not `begun`. `kept`: what the
    model remembers, while inputs are tried."""

    status: int
    value: float
    variance: float
    begun: int
    kept: Reals


def remaining(variance: float, slope: float, noise: float) -> float:
    """The variance after a reading, 1 / (1 / P + H^2 / R)."""
    return variance * noise / (slope * slope * variance + noise)


def likeliest(
    look: Callable[[Any, float, float], float], back: Callable[[Any, float, float], float],
    p: Parameters, s: State, whole: Any, dt: float, found: float,
) -> float:  # fmt: skip
    """The input between the last one and the one found behind the reading. `back`: the output of the last
    one, on the way back to it from another."""
    before = s.value if s.begun else found
    noise = p.noise
    ahead = p.step
    if s.begun:
        ahead = s.variance + p.step * (dt if p.by_time else 1.0)
        reach = sqrt(s.variance)
        open_by = (back(whole, dt, before + reach) - back(whole, dt, before - reach)) / 2.0
        noise = noise + open_by * open_by
    reach = sqrt(ahead)
    slope = (look(whole, dt, before + reach) - look(whole, dt, before - reach)) / (2.0 * reach)
    u = found
    if s.begun:
        left = remaining(ahead, slope, noise)
        u = before + slope * slope * left / noise * (found - before)
        reach = sqrt(left if left > FINEST * ahead else FINEST * ahead)
    low = look(whole, dt, u - reach)
    high = look(whole, dt, u + reach)
    corner = high + low - 2.0 * look(whole, dt, u)
    again = (high - low) / (2.0 * reach)
    lesser = fabs(again) if fabs(again) < fabs(slope) else fabs(slope)
    s.value = u
    if s.begun:
        s.variance = remaining(ahead, lesser, noise + KINK * corner * corner)
    elif again != 0.0:  # of the first input no more is known than what the first reading says
        s.variance = noise / (again * again)
        s.begun = 1
    return u


def deviation(s: State) -> float:
    """Of the last estimate."""
    return sqrt(s.variance)
