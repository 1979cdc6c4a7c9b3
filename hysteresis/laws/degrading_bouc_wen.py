"""The Bouc-Wen model that loses strength and stiffness and slips, in substeps along the input's path.

Source: Baber and Wen, J. Eng. Mech. Div. 107 (1981); pinching: Foliente, J. Struct. Eng. 121 (1995).
"""

from math import exp, expm1, fabs, log

from ._codes import OK, SATURATED, Reals


class Parameters:
    """y = offset + k (alpha u + (1 - alpha) yield_at w). On a way up, in parts of yield_at, w relaxes
    towards a limit, `substeps` times a sample, with the mean rate of four stages of Runge and Kutta:

        limit = (1 + strength_loss e)^(-1/n),    h / eta = factor of pinching / (1 + stiffness_loss e).

    `ahead`: of the way so far, at which each stage looks; `weights`: of the stages. `slip` to `widening`:
    of the pinching, none where `slip` is 0. `least`: slope of the output. `rounding`: of an output.
    """

    substeps: int
    ahead: Reals
    weights: Reals
    k: float
    alpha: float
    yield_at: float
    n: float
    descent: float
    offset: float
    strength_loss: float
    stiffness_loss: float
    slip: float
    onset: float
    level: float
    spread: float
    severity: float
    widening: float
    least: float
    rounding: float


class State:
    """The input, z in parts of yield_at, and the energy that went into it; rate and drive of the last
    stage."""

    status: int
    u: float
    w: float
    energy: float
    rate: float
    drive: float


def pulled(p: Parameters, s: State, w: float, energy: float) -> None:
    """Rate and drive, w' = drive - rate w, at a point of the way up."""
    spent = energy if energy > 0.0 else 0.0
    limit = 1.0
    if p.strength_loss > 0.0:
        limit = exp(-log(1.0 + p.strength_loss * spent) / p.n)
    h = 1.0
    if p.slip > 0.0:
        lost = -p.slip * expm1(-p.onset * spent)
        wide = (p.spread + p.widening * spent) * (p.severity + lost)
        away = (w - p.level * limit) / wide
        h = 1.0 - lost * exp(-away * away)
    if p.stiffness_loss > 0.0:
        h = h / (1.0 + p.stiffness_loss * spent)
    size = fabs(w / limit)
    power = log(size if size > 1e-30 else 1e-30)
    if w < 0.0:
        s.drive = h * (1.0 + p.descent * exp(p.n * power)) / (1.0 + size)
    elif power == 0.0:
        s.drive = h * p.n
    else:
        s.drive = h * expm1(p.n * power) / expm1(power)
    s.rate = s.drive / limit


def share(turns: float) -> float:
    """(1 - exp(-turns)) / turns."""
    return -expm1(-turns) / turns if turns > 1e-8 else 1.0 - turns / 2.0


def travel(p: Parameters, s: State, u: float) -> None:
    """Move to the input u. Up and down are mirror images, energy included."""
    sign = -1.0 if u < s.u else 1.0
    way = sign * (u - s.u) / (p.yield_at * p.substeps)
    w = sign * s.w
    energy = s.energy
    for _turn in range(p.substeps):
        at = w
        spent = energy
        rate = 0.0
        drive = 0.0
        power = 0.0
        for stage in range(4):
            pulled(p, s, at, spent)
            rate = rate + p.weights[stage] * s.rate
            drive = drive + p.weights[stage] * s.drive
            power = power + p.weights[stage] * at
            if stage < 3:
                ahead = p.ahead[stage] * way
                before = at
                at = w + (s.drive - s.rate * w) * ahead * share(s.rate * ahead)
                spent = energy + before * ahead
        w = w + (drive - rate * w) * way * share(rate * way)
        energy = energy + power * way
    s.u = u
    s.w = sign * w
    s.energy = energy


def output(p: Parameters, u: float, w: float) -> float:
    return p.offset + p.k * (p.alpha * u + (1.0 - p.alpha) * p.yield_at * w)


def move(p: Parameters, s: State, u: float) -> float:
    travel(p, s, u)
    return output(p, u, s.w)


def look(p: Parameters, s: State, u: float) -> float:
    before = s.u
    w = s.w
    energy = s.energy
    y = move(p, s, u)
    s.u = before
    s.w = w
    s.energy = energy
    return y


def find(p: Parameters, s: State, y: float) -> float:
    rise = y - output(p, s.u, s.w)
    sign = -1.0 if rise < 0.0 else 1.0
    margin = p.rounding * (fabs(y) + fabs(p.offset) + p.k * p.yield_at)
    low = 0.0
    missing = sign * rise
    high = missing / p.k
    gap = sign * (y - look(p, s, s.u + sign * high))
    # The output rises by no less than `least`, so that the doubled way passes it.
    farthest = missing / p.least
    k = 0
    while gap > 0.0 and high < farthest and k < 64:  # at most: 64
        low = high
        missing = gap
        high = 2.0 * high
        gap = sign * (y - look(p, s, s.u + sign * high))
        k = k + 1
    over = -gap
    way = high
    k = 0
    # False position, halving every third time; the end that stays counts half.
    while fabs(gap) > margin / 8.0 and k < 168:  # at most: 168
        way = low + (high - low) * missing / (missing + over)
        if k % 3 == 2 or way <= low or way >= high:
            way = low + (high - low) / 2.0
        gap = sign * (y - look(p, s, s.u + sign * way))
        if way <= low or way >= high:
            k = 168
        elif gap > 0.0:
            low = way
            missing = gap
            over = over / 2.0
        else:
            high = way
            over = -gap
            missing = missing / 2.0
        k = k + 1
    s.status = OK
    if fabs(gap) > margin:
        s.status = SATURATED
        return s.u
    u = s.u + sign * way
    move(p, s, u)
    return u
