"""Forces of several contacts from the readings of a soft sensor, reading by reading, in plain Python."""

from collections.abc import Sequence
from functools import lru_cache
from math import inf, isfinite
from types import SimpleNamespace
from typing import Any, NamedTuple

from . import _arithmetic as plain
from ._file import LONGEST, READING_MISSING, Written
from ._force_filter import LOST, SOUGHT, Setting, Way, mean_of, updated
from ._network import Network
from ._status import Status

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
