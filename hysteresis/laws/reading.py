"""One reading in, one estimate out: what is around a tree, its error and its guard, see `_nodes.py`."""

from math import fabs

from ._codes import EXTRAPOLATED, FLAT, INVALID, OK


class Parameters:
    """Readings from `low` to `high` are known; where the model is `conditioned`, it is by conditions from
    `least` to `most`. Where `rates`, time counts, up to `longest` at once. A guard `hides` estimates that
    are beyond.
    """

    low: float
    high: float
    rates: int
    longest: float
    conditioned: int
    least: float
    most: float
    hides: int


class State:
    """The last estimate, what it is worth, and its deviation; time that was `waited` for a usable reading,
    where one has come; of that reading `passed`, the time before it, what was `seen` of it, and whether it
    is `beyond` what is known; how far `apart` estimates are that began elsewhere. `none`: not a number.
    """

    status: int
    value: float
    deviation: float
    waited: float
    begun: int
    passed: float
    seen: float
    beyond: int
    apart: float
    none: float


def wait(p: Parameters, s: State, dt: float) -> int:
    """Time goes on; a dt that is not a number is none."""
    if p.rates and dt > 0.0:
        s.waited = s.waited + dt
        if s.waited > p.longest:
            s.waited = p.longest
    return 0


def begin(s: State) -> float:
    """The time before a sample that is used; the first one's is 0."""
    s.passed = s.waited if s.begun else 0.0
    s.waited = 0.0
    s.begun = 1
    return s.passed


def usable(p: Parameters, s: State, dt: float, reading: float, beside: float) -> int:
    """Whether a reading is one, with the condition `beside` it. If not, the last estimate is held."""
    wait(p, s, dt)
    s.status = INVALID
    if not (reading - reading == 0.0 and beside - beside == 0.0):
        return 0
    begin(s)
    s.seen = reading
    if reading < p.low:
        s.seen = p.low
    if reading > p.high:
        s.seen = p.high
    s.beyond = 0
    if s.seen != reading or (p.rates and s.passed >= p.longest):
        s.beyond = 1
    if p.conditioned and (beside < p.least or beside > p.most):
        s.beyond = 1
    return 1


def worth(s: State, status: int) -> int:
    """The status without a guard."""
    told = status
    if s.beyond and status == OK:
        told = EXTRAPOLATED
    if s.beyond and status == FLAT:
        told = EXTRAPOLATED
    return told


def farther(s: State, other: float) -> int:
    """An estimate that began elsewhere."""
    away = fabs(other - s.value)
    if away > s.apart:
        s.apart = away
    return 0
