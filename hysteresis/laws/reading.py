"""One reading in, one estimate out: what is around a tree, its error and its guard, see `_nodes.py`."""

from math import fabs

from ._codes import EXTRAPOLATED, FLAT, OK


class Parameters:
    """Readings from `low` to `high` are known; where the model is `conditioned`, it is by conditions from
    `least` to `most`. Where `rates`, time counts, up to `longest` at once. A guard `hides` estimates that
    are beyond, by `none`, which is not a number.
    """

    low: float
    high: float
    rates: int
    longest: float
    conditioned: int
    least: float
    most: float
    hides: int
    none: float


class State:
    """The last estimate, what it is worth, and its deviation; the time `waited` for a reading, where
    one has come.
    """

    status: int
    value: float
    deviation: float
    waited: float
    begun: int


def wait(p: Parameters, s: State, dt: float) -> int:
    """Time goes on; a dt that is not a number is none."""
    if p.rates and dt > 0.0:
        s.waited = s.waited + dt
        if s.waited > p.longest:
            s.waited = p.longest
    return 0


def begin(s: State) -> float:
    """The time before a sample that is used; the first one's is 0."""
    passed = s.waited if s.begun else 0.0
    s.waited = 0.0
    s.begun = 1
    return passed


def clipped(p: Parameters, reading: float) -> float:
    """The reading that is known, nearest to one."""
    seen = reading
    if seen < p.low:
        seen = p.low
    if seen > p.high:
        seen = p.high
    return seen


def unknown(p: Parameters, passed: float, seen: float, reading: float, beside: float) -> int:
    """Whether a reading, the time before it, or the condition `beside` it, is beyond what is known."""
    if seen != reading or (p.rates and passed >= p.longest):
        return 1
    if p.conditioned and (beside < p.least or beside > p.most):
        return 1
    return 0


def worth(s: State, beyond: int, status: int) -> int:
    """The status without a guard."""
    told = status
    if beyond and status == OK:
        told = EXTRAPOLATED
    if beyond and status == FLAT:
        told = EXTRAPOLATED
    return told


def farther(p: Parameters, apart: float, one: float, other: float) -> float:
    """The greater one of a distance and of that between two estimates."""
    away = fabs(one - other)
    return away if away > apart else apart
