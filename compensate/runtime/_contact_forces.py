"""Forces of several contacts from the readings of a soft sensor, reading by reading, in plain Python."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from math import inf, isfinite
from types import SimpleNamespace
from typing import Any, NamedTuple

from . import _arithmetic as plain
from ._arithmetic import Arithmetic, Items, Numbers, Real, State, Test
from ._file import LONGEST, READING_MISSING, Written
from ._network import Network
from ._status import Status

# Filter of several contacts' forces: one text for `compensate.microchannel` and for plain Python, see
# `_arithmetic`.

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


KIND = "hysid contact forces"

Matrix = list[list[float]]


class ContactForces(NamedTuple):
    """Forces of all contacts in N, the `Status` of the reading, and their standard deviations."""

    value: tuple[float, ...]
    status: Status
    deviation: tuple[float, ...]


class MultiContactEstimator:
    """Forces of several contacts, as `compensate.internal.MultiContactEstimator`, without JAX.

    - `title`; `channels`: name and unit of every reading; `contacts`: name and unit of every force.
    - `longest`, s: the longest time between two readings that the export saw; longer ones are taken for it.

    Its forces are those at once; those some readings late are JAX's alone. A step of two contacts takes
    some milliseconds.
    """

    def __init__(self, document: dict[str, Any]):
        self.title: str = document["title"]
        self.channels: list[dict[str, str]] = document["channels"]
        self.contacts: list[dict[str, str]] = document["contacts"]
        self.longest: float = document.get("longest") or LONGEST
        self._sensor = _Channels(document)
        self._noise = [float(sigma) ** 2 for sigma in document["reading_sigma"]]
        # As a `compensate.internal.MotionFilter`.
        self._motion = SimpleNamespace(delay=0, **document["motion"])
        if not all(map(isfinite, (*self._noise, *self._sensor.numbers()))):
            raise ValueError("a number is not finite")
        self.reset()

    def reset(self) -> None:
        """The state before the first reading."""
        count, virgin = self._sensor.contacts, self._sensor.init()
        none = [[0.0] * (2 * count) for _ in range(2 * count)]
        self._ways = [
            Way([0.0] * (2 * count), none, -inf if k else 0.0, virgin, 0.0)
            for k in range(self._motion.ways)
        ]
        self._begun, self._waited, self._lost = False, 0.0, 0
        self._last = (0.0,) * count, (0.0,) * count

    def step(self, dt: float, reading: Sequence[float] | None = None) -> ContactForces:
        """One reading in, a number for each channel; the forces of all contacts out.

        `dt`: time since the last call, s; the first one's does not matter. A reading of which a channel is
        NaN or infinite is INVALID: the last forces are held, and nothing else changes.

        Raises `TypeError` where `reading` is left out, `ValueError` for another number of channels.
        """
        if reading is None:
            raise TypeError(READING_MISSING)
        if len(reading) != len(self._noise):
            raise ValueError(f"{len(reading)} readings for {len(self._noise)} channels")
        if dt > 0.0:
            self._waited = min(self._waited + dt, self.longest)
        if not all(map(isfinite, reading)):
            return ContactForces(self._last[0], Status.INVALID, self._last[1])
        passed = self._waited if self._begun else 0.0
        dt = passed if self._begun else self._motion.gap_s
        now = Setting(plain, self._motion, self._sensor, passed, dt, reading, self._noise)
        self._ways, self._lost, surprise = updated(now, self._ways, self._lost)
        self._waited, self._begun = 0.0, True
        self._last = value, deviation = mean_of(plain, self._ways, range(self._sensor.contacts))
        status = Status.SATURATED if max(value) >= self._motion.high else Status.OK
        return ContactForces(value, Status.EXTRAPOLATED if surprise > LOST else status, deviation)


class _Channels:
    """A `compensate.internal.ChannelSensor` of networks."""

    def __init__(self, document: dict[str, Any]):
        self._networks = [Network(model) for model in document["models"]]
        # A lost filter tries each force of a contact with all those of the others.
        self._at = [lru_cache(4 * SOUGHT)(network.with_slope) for network in self._networks]
        self._gains: Matrix = document["gains"]
        self._zero: list[float] = document["zero"]
        self.contacts = len(self._networks)

    def numbers(self) -> list[float]:
        """Gains and zeros."""
        return [*self._zero, *(gain for row in self._gains for gain in row)]

    def init(self) -> Any:
        return tuple(network.virgin for network in self._networks)

    def look(self, state: Any, passed: float, force: Sequence[float]) -> tuple[list[float], Matrix]:
        """The next readings if these were the forces, and their derivatives."""
        seen = [at(held, passed, F) for at, held, F in zip(self._at, state, force, strict=True)]
        y = [
            zero + sum(g * value for g, (value, _) in zip(gains, seen, strict=True))
            for zero, gains in zip(self._zero, self._gains, strict=True)
        ]
        return y, [
            [g * slope for g, (_, slope) in zip(gains, seen, strict=True)] for gains in self._gains
        ]

    def follow(self, state: Any, passed: float, force: Sequence[float]) -> Any:
        """The state after these forces."""
        each = zip(self._networks, state, force, strict=True)
        return tuple(network.follow(held, passed, (F,)) for network, held, F in each)


def replay(document: Written) -> tuple[MultiContactEstimator, float]:
    """How far off; infinitely where a status differs."""
    estimator, golden, worst = MultiContactEstimator(document), document["golden"], 0.0
    rows = zip(
        golden["reading"], golden["dt"], golden["value"], golden["deviation"], golden["status"],
        strict=True,
    )  # fmt: skip
    for reading, dt, value, deviation, status in rows:
        found = estimator.step(dt, reading)
        pairs = zip((*found.value, *found.deviation), (*value, *deviation), strict=True)
        off = max(abs(a - b) for a, b in pairs)
        worst = max(worst, off if found.status == status else inf)
    return estimator, worst
