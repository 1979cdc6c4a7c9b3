"""Models side by side: the input behind their sum is looked for between two limits."""

from collections.abc import Callable
from typing import Any

from ._codes import FLAT, OK, SATURATED


class Parameters:
    """Outputs closer than `rounding` of the largest are one output; inputs farther apart than `flat` with
    one output are FLAT. Inputs are told apart down to `finest`."""

    low: float
    high: float
    rounding: float
    flat: float
    finest: float


class State:
    """The last estimate: where the sum is flat, the input nearest to it is taken."""

    status: int
    value: float


def reach(
    look: Callable[[Any, float, float], float],
    whole: Any, dt: float, wanted: float, low: float, high: float, finest: float,
) -> float:  # fmt: skip
    """The first input whose output is `wanted` or more: false position, halving where that is slow."""
    missing = wanted - look(whole, dt, low)
    over = look(whole, dt, high) - wanted
    if missing <= 0.0:
        return low
    if over < 0.0:
        return high
    k = 0
    while high - low > finest:  # at most: 168
        u = low + (high - low) * missing / (missing + over)
        if k % 3 == 2 or u <= low or u >= high:
            u = low + (high - low) / 2.0
        if u <= low or u >= high:
            return high
        gap = wanted - look(whole, dt, u)
        # The end that stays counts half, lest it stays for ever.
        if gap > 0.0:
            low = u
            missing = gap
            over = over / 2.0
        else:
            high = u
            over = -gap
            missing = missing / 2.0
        k = k + 1
    return high


def search(
    look: Callable[[Any, float, float], float],
    p: Parameters, s: State, whole: Any, dt: float, y: float,
) -> float:  # fmt: skip
    """The input behind y that is nearest to the last estimate."""
    least = look(whole, dt, p.low)
    most = look(whole, dt, p.high)
    largest = -least if -least > most else most
    if least > largest:
        largest = least
    if -most > largest:
        largest = -most
    margin = p.rounding * largest
    s.status = OK
    if y - margin > most:
        s.status = SATURATED
        s.value = p.high
        return p.high
    if y + margin < least:
        s.status = SATURATED
        s.value = p.low
        return p.low
    first = reach(look, whole, dt, y - margin, p.low, p.high, p.finest)
    last = first + p.flat
    if last >= p.high or look(whole, dt, last) < y + margin:
        last = reach(look, whole, dt, y + margin, first, p.high, p.finest)
        if last - first > p.flat:
            s.status = FLAT
    else:
        last = first
    u = s.value if s.value > first else first
    if u > last:
        u = last
    s.value = u
    return u
