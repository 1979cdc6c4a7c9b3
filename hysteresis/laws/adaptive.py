"""A sum of parts whose zero and weights are learnt, while it runs, from inputs that are known at times.

sign y = zero + drift t + sum of weight_k part_k + noise, where it is `floored` the sum not below 0

Source: Kulhavy 1987 (restricted exponential forgetting), Page 1954 and Lorden 1971 (the alarm).
"""

from collections.abc import Callable
from math import fabs, log, sqrt
from typing import Any

from ._codes import FLAT as FLAT
from ._codes import OK as OK
from ._codes import SATURATED, Reals
from .sum import is_there as is_there
from .sum import sought as sought


class Parameters:
    """`low` to `closest` as of a sum. Of each part: its least output (`centres`), its weight as fitted
    (`nominal`), the least one it may have, its rise and the width of its loop.

    - `zero`: as fitted. `noise`: variance of the fit's residuals, at most. `correlation`: samples until
      they are independent; references count as many as that once.
    - `memory`: references of which half an e-th is kept. `settling`: references after which a change is
      learnt, and of which a run is made. `threshold`: of the sum of log-likelihood ratios, above which
      something has changed.
    - `spread`: variances of zero, drift and weights after a change, at most. `error`: rms error of
      estimates.
    """

    low: float
    high: float
    rounding: float
    flat: float
    finest: float
    closest: float
    parts: int
    sign: float
    floored: int
    zero: float
    centres: Reals
    nominal: Reals
    least: Reals
    rises: Reals
    widths: Reals
    noise: float
    correlation: float
    memory: float
    settling: float
    threshold: float
    spread: Reals
    error: float


class State:
    """`reference`: the input, where it is `known`. `share`: how much of what was learnt is used; while it
    is 0, estimates are those of the model as it was fitted. `used`: zero, drift and weights behind the
    others; `theta`: as learnt; `covariance`: of them, the lower triangle row by row. `elapsed`, `idle`:
    time and samples since the last reference; `gained`: what rounding has added to that time.

    Each part has two memories. One follows the estimates, as that of the fit does; the other one, which
    teaches, the references, and between them the estimates.

    - `before`: `theta` before this run of references, of which `run` have come; `common`, `apart`: what it
      would have explained of the fit's errors at references, and its distance from the fit, squared.
    - `evidence`: of a change since; `excess`, `possible`: squared errors behind it, and what a change by
      `spread` makes. `settled`: references since the last change; `changes`: counted.
    - `loss`: mean square error of the estimates at this run of references; `residual`: that of the readings
      as they are explained now, over `noise`. `output`: of the parts that teach; `shown`: of those that
      estimate, at the reference; `along`, `work`: of the calculation.
    """

    status: int
    value: float
    slope: float
    reference: float
    known: int
    share: float
    elapsed: float
    gained: float
    idle: float
    used: Reals
    theta: Reals
    covariance: Reals
    before: Reals
    run: float
    common: float
    apart: float
    evidence: float
    excess: float
    possible: float
    settled: float
    loss: float
    residual: float
    changes: int
    output: Reals
    shown: Reals
    along: Reals
    work: Reals


def one(p: Parameters, s: State, k: int, output: float) -> float:
    """What a part adds to the output."""
    return s.used[k + 2] * (output - p.centres[k])


def taught(p: Parameters, s: State, k: int, output: float) -> None:
    """Keep what a part whose memory follows references gives."""
    s.output[k + 2] = output - p.centres[k]


def kept(p: Parameters, s: State, k: int, output: float) -> None:
    """Keep what a part whose memory follows estimates gives at a reference."""
    s.shown[k + 2] = output - p.centres[k]


def raised(p: Parameters, total: float) -> float:
    """What the parts add up to, on the floor or above."""
    return 0.0 if p.floored and total < 0.0 else total


def nearest(
    look: Callable[[Any, float, float], float],
    p: Parameters, s: State, whole: Any, dt: float, y: float,
) -> float:  # fmt: skip
    """The input behind y. A reading beyond those that can be is taken for the nearest of them."""
    least = look(whole, dt, p.low)
    most = look(whole, dt, p.high)
    size = fabs(least)
    if size < fabs(most):
        size = fabs(most)
    margin = p.rounding * size
    wanted = y if y > least else least
    if wanted > most:
        wanted = most
    u = sought(look, p, s, whole, dt, wanted, margin)  # type: ignore[arg-type]
    if y + margin < least or y - margin > most:
        s.status = SATURATED
    return u


def driving(s: State, u: float) -> float:
    """What the memories that teach follow: the reference where there is one, else the estimate."""
    return s.reference if s.known else u


def zero_now(s: State) -> float:
    """The zero, which drifts."""
    return s.used[0] + s.used[1] * s.elapsed


def began(s: State, dt: float) -> None:
    """Count the time, and the sample."""
    step = dt - s.gained  # as Kahan adds: float steps of 1 ms would add up to 4.6 h at most
    elapsed = s.elapsed + step
    s.gained = elapsed - s.elapsed - step
    s.elapsed = elapsed
    s.idle = s.idle + 1.0


def drifted(p: Parameters, s: State) -> None:
    """Zeros and covariance from the last reference to now."""
    t = s.elapsed
    n = p.parts + 2
    s.used[0] = zero_now(s)
    s.theta[0] = s.theta[0] + s.theta[1] * t
    s.before[0] = s.before[0] + s.before[1] * t
    s.elapsed = 0.0
    s.gained = 0.0
    if not t > 0.0:
        return
    s.covariance[0] = s.covariance[0] + t * (2.0 * s.covariance[n] + t * s.covariance[n + 1])
    s.covariance[n] = s.covariance[n] + t * s.covariance[n + 1]
    for i in range(2, p.parts + 2):
        s.covariance[i * n] = s.covariance[i * n] + t * s.covariance[i * n + 1]


def shortest(p: Parameters, s: State) -> int:
    """The unknown whose weight is farthest below its least one and can still move; 0 where none is."""
    n = p.parts + 2
    worst = 0
    most = 0.0
    for k in range(p.parts):
        missing = p.least[k] - s.theta[k + 2]
        if missing > most and s.work[(k + 2) * n + k + 2] > 0.0:
            most = missing
            worst = k + 2
    return worst


def held_up(p: Parameters, s: State) -> None:
    """Weights below their least ones are put there, and the others to where they then are likeliest."""
    n = p.parts + 2
    for i in range(p.parts + 2):
        for j in range(i + 1):
            s.work[i * n + j] = s.covariance[i * n + j]
            s.work[j * n + i] = s.covariance[i * n + j]
    for _turn in range(p.parts):
        worst = shortest(p, s)
        if worst > 0:
            own = s.work[worst * n + worst]
            missing = p.least[worst - 2] - s.theta[worst]
            for j in range(p.parts + 2):
                s.along[j] = s.work[worst * n + j]
            for i in range(p.parts + 2):
                s.theta[i] = s.theta[i] + s.along[i] / own * missing
            for i in range(p.parts + 2):
                for j in range(p.parts + 2):
                    s.work[i * n + j] = s.work[i * n + j] - s.along[i] * s.along[j] / own
            for j in range(p.parts + 2):
                s.work[worst * n + j] = 0.0
                s.work[j * n + worst] = 0.0
    for k in range(p.parts):
        if s.theta[k + 2] < p.least[k]:
            s.theta[k + 2] = p.least[k]


def share(p: Parameters, s: State, y: float, weight: float) -> float:
    """How much of what was learnt is used. The part of it that would have explained the fit's errors at
    later references best is above a half where it predicts better than the fit: all is used where that
    part less three of its standard errors is a half or more, nothing where it is 0."""
    fitted = p.zero
    tried = s.before[0]
    for k in range(p.parts):
        fitted = fitted + p.nominal[k] * s.shown[k + 2]
        tried = tried + s.before[k + 2] * s.shown[k + 2]
    kept = 1.0 - weight / p.memory
    apart = tried - fitted
    s.common = kept * s.common + weight * apart * (p.sign * y - fitted)
    s.apart = kept * s.apart + weight * apart * apart
    if s.common <= 0.0:
        return 0.0
    part = 2.0 * (s.common - 3.0 * sqrt(p.noise * s.apart)) / s.apart
    if part < 0.0:
        return 0.0
    return part if part < 1.0 else 1.0


def learn(p: Parameters, s: State, y: float) -> None:
    """One reference: `output` and `shown` hold what the parts gave at it, `value` what was estimated."""
    n = p.parts + 2
    weight = s.idle / p.correlation
    if weight > 1.0:
        weight = 1.0
    drifted(p, s)
    # What was learnt before a run of references is tried on it.
    if s.idle > p.correlation or s.run >= p.settling + 1.0:
        s.run = 0.0
        for i in range(p.parts + 2):
            s.before[i] = s.theta[i]
    s.run = s.run + weight
    s.idle = 0.0
    if p.floored:
        # There the reading says nothing of the parts.
        total = 0.0
        seen = 0.0
        for k in range(p.parts):
            total = total + s.used[k + 2] * s.output[k + 2]
            seen = seen + s.used[k + 2] * s.shown[k + 2]
        for k in range(p.parts):
            s.output[k + 2] = 0.0 if total <= 0.0 else s.output[k + 2]
            s.shown[k + 2] = 0.0 if seen <= 0.0 else s.shown[k + 2]
    s.output[0] = 1.0
    s.output[1] = 0.0
    error = s.value - s.reference
    s.loss = s.loss + weight / s.run * (error * error - s.loss)

    # The covariance along this regressor, which begins with 1 and 0: only its lower triangle is kept.
    missed = p.sign * y - s.theta[0]
    s.along[0] = s.covariance[0]
    s.along[1] = s.covariance[n]
    for i in range(2, p.parts + 2):
        own = s.output[i]
        missed = missed - s.theta[i] * own
        total = s.covariance[i * n]
        s.along[0] = s.along[0] + total * own
        s.along[1] = s.along[1] + s.covariance[i * n + 1] * own
        for j in range(2, i):
            both = s.covariance[i * n + j]
            total = total + both * s.output[j]
            s.along[j] = s.along[j] + both * own
        s.along[i] = total + s.covariance[i * n + i] * own
    seen = s.along[0]
    open_now = p.spread[0]
    for i in range(2, p.parts + 2):
        seen = seen + s.along[i] * s.output[i]
        open_now = open_now + p.spread[i] * s.output[i] * s.output[i]

    # The sum of log-likelihood ratios of twice the deviation, from 0 on: Page's test. With the threshold
    # log N it alarms by chance once in N references, or less often.
    square = missed * missed / (p.noise + seen)
    # One reference that is wrong is no change.
    if square > 25.0:
        square = 25.0
    s.evidence = s.evidence + weight * (0.375 * square - log(2.0))
    s.excess = s.excess + weight * missed * missed
    s.possible = s.possible + weight * open_now
    if not s.evidence > 0.0:
        s.evidence = 0.0
        s.excess = 0.0
        s.possible = 0.0
    s.settled = s.settled + weight
    if s.evidence > p.threshold:
        # Until it has settled, another alarm is of the same change.
        if s.changes == 0 or s.settled - weight >= p.settling:
            s.changes = s.changes + 1
        size = s.excess / s.possible
        if size > 1.0:
            size = 1.0
        for i in range(p.parts + 2):
            s.covariance[i * n + i] = s.covariance[i * n + i] + size * p.spread[i]
            s.along[i] = s.along[i] + size * p.spread[i] * s.output[i]
        seen = seen + size * open_now
        s.evidence = 0.0
        s.excess = 0.0
        s.possible = 0.0
        s.settled = 0.0

    # Least squares; what is older is forgotten only along this regressor, as Kulhavy does.
    total = p.noise / weight
    seen = seen / total
    low = 0
    if seen > 0.0:
        step = missed / (total * (1.0 + seen))
        kept = 1.0 - weight / p.memory
        less = (kept * seen - 1.0 + kept) / (kept * seen * (1.0 + seen) * total)
        for i in range(p.parts + 2):
            s.theta[i] = s.theta[i] + s.along[i] * step
            if i > 1 and s.theta[i] < p.least[i - 2]:
                low = 1
            shrunk = less * s.along[i]
            for j in range(i + 1):
                s.covariance[i * n + j] = s.covariance[i * n + j] - shrunk * s.along[j]
    if low:
        held_up(p, s)
    part = share(p, s, y, weight)
    s.share = part
    s.used[0] = p.zero + part * (s.theta[0] - p.zero)
    s.used[1] = part * s.theta[1]
    # What is used now leaves this of the reading. A third of a run forgets what was before.
    off = p.sign * y - s.used[0]
    for k in range(p.parts):
        s.used[k + 2] = p.nominal[k] + part * (s.theta[k + 2] - p.nominal[k])
        off = off - s.used[k + 2] * s.output[k + 2]
    square = off * off / p.noise
    if square > 25.0:
        square = 25.0
    part = 3.0 * weight / p.settling
    s.residual = s.residual + (part if part < 1.0 else 1.0) * (square - s.residual)


def gain(p: Parameters, s: State) -> float:
    """The rise of the output as learnt, over that of the fit."""
    now = 0.0
    fitted = 0.0
    for k in range(p.parts):
        now = now + s.theta[k + 2] * p.rises[k]
        fitted = fitted + p.nominal[k] * p.rises[k]
    return now / fitted


def loop(p: Parameters, s: State) -> float:
    """The width of the loop over the rise as learnt, over that of the fit; 1 where the fit has no loop."""
    now = 0.0
    fitted = 0.0
    for k in range(p.parts):
        now = now + s.theta[k + 2] * p.widths[k]
        fitted = fitted + p.nominal[k] * p.widths[k]
    return now / fitted / gain(p, s) if fitted > 0.0 else 1.0


def open_zero(p: Parameters, s: State) -> float:
    """The variance of the zero by now."""
    t = s.elapsed
    n = p.parts + 2
    return s.covariance[0] + 2.0 * t * s.covariance[n] + t * t * s.covariance[n + 1]


def advice(p: Parameters, s: State) -> int:
    """0, or why a calibration is needed now."""
    if s.changes > 0 and s.settled < p.settling:
        rise = 0.0
        wide = 0.0
        for k in range(p.parts):
            rise = rise + p.nominal[k] * p.rises[k]
            wide = wide + p.nominal[k] * p.widths[k]
        moved = s.theta[0] + s.theta[1] * s.elapsed - p.zero
        by_zero = moved if moved > 0.0 else -moved
        steeper = (gain(p, s) - 1.0) * rise / 2.0
        by_gain = steeper if steeper > 0.0 else -steeper
        wider = (loop(p, s) - 1.0) * wide / 2.0
        by_loop = wider if wider > 0.0 else -wider
        noise = sqrt(p.noise)
        if by_zero < noise and by_gain < noise and by_loop < noise:
            return 4
        if by_zero >= by_gain and by_zero >= by_loop:
            return 1
        return 2 if by_gain >= by_loop else 3
    if s.residual > 4.0:
        return 4
    return 5 if open_zero(p, s) > 3.0 * p.noise else 0


def lost(p: Parameters, s: State) -> float:
    """The rms error that estimates have beyond that of the fit, in the input's unit."""
    before = p.error * p.error
    more = s.loss - before
    unknown = before * open_zero(p, s) / p.noise
    if unknown > 3.0 * before and unknown > more:
        more = unknown
    return sqrt(more) if more > 0.0 else 0.0
