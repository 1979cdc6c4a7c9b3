"""Filter of several contacts' forces: one text for `compensate.microchannel` and for plain Python, see
`_arithmetic`."""

from itertools import product
from math import inf
from typing import NamedTuple

from ._arithmetic import Arithmetic, Items, Numbers, Real, State, Test

ITERATIONS = 2
"""Of Gauss-Newton: a branch's slope jumps where the force turns. A third changes nothing to be seen."""

LOST, PATIENCE = 25.0, 3
"""Squared surprise of a channel from which on a reading is none that the hypotheses expect; how many such
readings in turn say that all of them are lost."""

SOUGHT = 128
"""Forces that a lost filter tries at most, evenly over their range."""


class Way(NamedTuple):
    """A hypothesis of what has happened.

    - `x`: forces, then rates, then the forces of the last `delay` readings, latest first; `covariance`.
    - `log_weight`; `sensor`: its state of the sensor.
    - `surprise`: squared distance of its last reading from what it expected, in its variance.
    """

    x: Numbers
    covariance: Items
    log_weight: Real
    sensor: State
    surprise: Real


class Setting(NamedTuple):
    """What all functions here need: the arithmetic `o`; a `MotionFilter`, or its numbers; what it looks
    through; when and how long after the reading before, what was read, and the variances of that."""

    o: Arithmetic
    motion: State
    sensor: State
    t: Real
    dt: Real
    z: Numbers
    noise: Numbers


def updated(s: Setting, ways: Items, lost: Real) -> tuple[Items, Real, Real]:
    """All ways after a reading, how many readings in turn have surprised all of them, and the least squared
    surprise, per channel."""
    o, f = s.o, s.motion
    astray = lost >= PATIENCE
    ways = o.rarely(astray, lambda: found_again(s, ways), lambda: ways)
    gap = s.dt >= f.gap_s
    s = s._replace(dt=o.where(gap, f.gap_s, s.dt))
    # The likeliest way turns, in the place of the least likely one; after a gap they all do.
    best, least = ends_of(o, ways)
    born = o.at(ways, best)._replace(log_weight=o.log(-o.expm1(-f.turns * s.dt)))

    def aged(way: Way) -> Way:
        return way._replace(log_weight=way.log_weight - f.turns * s.dt)

    ways = o.each(lambda way: ahead(s, aged(way), gap), ways)
    ways = o.each(lambda way: corrected(s, way), o.put(ways, least, ahead(s, born, True)))
    top = o.most(o.each(lambda way: way.log_weight, ways))
    whole = top + o.log(o.total(o.each(lambda way: o.exp(way.log_weight - top), ways)))
    surprise = -o.most(o.each(lambda way: -way.surprise, ways)) / len(s.noise)
    lost = o.where(surprise > LOST, o.where(astray, 0, lost) + 1, 0)
    ways = o.each(lambda way: way._replace(log_weight=way.log_weight - whole), ways)
    return ways, lost, surprise


def ends_of(o: Arithmetic, ways: Items) -> tuple[Real, Real]:
    """Which way is the likeliest, and which the least likely."""
    return (
        o.place_of_most(o.each(lambda way: way.log_weight, ways)),
        o.place_of_most(o.each(lambda way: -way.log_weight, ways)),
    )


def found_again(s: Setting, ways: Items) -> Items:
    """The least likely way begins anew, at the forces that best explain the reading.

    Where a sensor's model is flat, a reading says nothing about the forces, and no Gauss-Newton step
    leads back from there. So forces all over their range are tried, with the memory of the likeliest
    way, and with that of a sensor that was never pressed: what the lost ways remember never happened.
    """
    o, f, n = s.o, s.motion, s.sensor.contacts
    count = max(3, round(SOUGHT ** (1 / n)))
    tried = o.vector(list(product([f.high * k / (count - 1) for k in range(count)], repeat=n)))

    def off(memory: State, force: Numbers) -> Real:
        y, _ = s.sensor.look(memory, s.t, force)
        return sum((s.z[k] - y[k]) ** 2 / s.noise[k] for k in range(len(s.noise)))

    def closest(memory: State) -> tuple[Real, Numbers, State]:
        force = o.first_of_least(tried, lambda force: off(memory, force), lambda force: 0.0)
        return off(memory, force), force, memory

    best, least = ends_of(o, ways)
    kept, virgin = closest(o.at(ways, best).sensor), closest(s.sensor.init())
    _, force, memory = o.where(kept[0] <= virgin[0], kept, virgin)
    x = [*force, *[0.0] * n, *[F for _ in range(f.delay) for F in force]]
    step = f.high / (count - 1)
    spread = [f.turn**2 if n <= k < 2 * n else step**2 for k in range(len(x))]
    P = o.vector([[v if j == k else 0.0 for k in range(len(x))] for j, v in enumerate(spread)])
    even = -o.log(2.0 * f.ways)
    ways = o.each(lambda way: way._replace(log_weight=even), ways)
    return o.put(ways, least, Way(o.vector(x), P, o.log(0.5), memory, 0.0))


def ahead(s: Setting, way: Way, turned: Test) -> Way:
    """Forces and rates predicted a time dt ahead: x <- A x, P <- A P A' + Q, alike for every contact."""
    o, f, n, dt = s.o, s.motion, s.sensor.contacts, s.dt
    turn = (1.0, 0.5 * dt, 0.0), f.turn**2, (dt**2 / 3, dt / 2, 1.0 + 0.0 * dt), dt**2 / 12
    steady = (1.0, dt, 1.0), f.acceleration**2, (dt**3 / 3, dt**2 / 2, dt), 0.0 * dt
    # Somewhere between the readings the old rate gave way to the new one.
    (a, b, c), size, (both, mixed, rate), unknown = o.where(turned, turn, steady)

    def shifted(v: Items) -> list[Numbers]:
        moved = [o.mixed(a, v[k], b, v[n + k]) for k in range(n)]
        rates = [o.mixed(c, v[n + k], 0.0, v[n + k]) for k in range(n)]
        past = [v[k] for k in (*range(n), *range(2 * n, len(v)))]
        return [*moved, *rates, *past[: f.delay * n]]

    x, P = way.x, o.vector(shifted(o.turned(o.vector(shifted(way.covariance)))))
    more = [
        entry
        for k in range(n)
        for entry in (
            (k, k, size * both + x[n + k] ** 2 * unknown), (k, n + k, size * mixed),
            (n + k, k, size * mixed), (n + k, n + k, size * rate),
        )
    ]  # fmt: skip
    x = shifted(x)
    x[:n] = [o.clip(force, 0.0, f.high) for force in x[:n]]
    return way._replace(x=o.vector(x), covariance=o.plus_at(P, more))


def corrected(s: Setting, way: Way) -> Way:
    """One way after the reading, weighed by how likely that is."""
    o, sensor, n, high = s.o, s.sensor, s.sensor.contacts, s.motion.high
    x, P = way.x, way.covariance
    force, likelihood, surprise = x[:n], 0.0, 0.0
    after, left = x, P
    for turn in range(ITERATIONS):
        y, H = sensor.look(way.sensor, s.t, force)
        after, left = x, P
        # Channel by channel, so that nothing has to be solved but numbers.
        for k, noise in enumerate(s.noise):
            h = H[k]
            off = s.z[k] - y[k] - sum(h[j] * (after[j] - force[j]) for j in range(n))
            column = o.times(left, h)
            variance = sum(h[j] * column[j] for j in range(n)) + noise
            after = o.mixed(1.0, after, off / variance, column)
            left = o.less(left, column, variance)
            if not turn:
                likelihood = likelihood - 0.5 * (off * off / variance + o.log(variance))
                surprise = surprise + off * off / variance
        force = o.vector([o.clip(after[k], 0.0, high) for k in range(n)])
    rates = [o.where((force[k] <= 0.0) & (after[n + k] < 0.0), 0.0, after[n + k]) for k in range(n)]
    past = [o.clip(after[k], 0.0, high) for k in range(2 * n, len(x))]
    memory = sensor.follow(way.sensor, s.t, force)
    weight = way.log_weight + likelihood
    return Way(o.vector([*force, *rates, *past]), left, weight, memory, surprise)


def mean_of(o: Arithmetic, ways: Items, places: Items) -> tuple[Numbers, Numbers]:
    """Mean and standard deviation of some states over all ways."""

    def over(k: int) -> tuple[Real, Real]:
        def spread(way: Way) -> Real:
            away = way.x[k] - mean
            return o.exp(way.log_weight) * (way.covariance[k][k] + away * away)

        mean = o.total(o.each(lambda way: o.exp(way.log_weight) * way.x[k], ways))
        return mean, o.sqrt(o.clip(o.total(o.each(spread, ways)), 0.0, inf))

    value, deviation = zip(*map(over, places), strict=True)
    return o.vector(value), o.vector(deviation)
