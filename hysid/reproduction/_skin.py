"""Three experiments of Kim and Park (2018) on one virtual skin, by the paper's methods and by ours:
(A) the force of one contact, (B) which place is pressed, (C) which places are pressed at once."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float

from compensate.microchannel import (
    ChannelSensor,
    Confusion,
    Decision,
    ForceEstimator,
    Localizer,
    LogicTable,
    MotionFilter,
    MultiContactEstimator,
)
from hysteresis.rigs import ChannelRecord, MicrochannelRig, ResistiveReadout

from ._skin_networks import Learnt, train_staircase

SESSIONS, LENGTH = 28, 2025
"""56,700 readings in records that begin with the sensor at rest, as the loops to be judged on do."""

READING: Final = {"thresholds": (0.1, 0.2, 0.4, 0.8), "lags": (0.03, 0.06, 0.12, 0.25, 1.0, 5.0)}
FORCE: Final = {
    "thresholds": (0.1, 0.2, 0.35, 0.6, 1.0, 1.6, 2.6),
    "lags": (0.02, 0.2, 1.0, 8.0),
}
"""What each network sees: half widths of plays in V or N, delays in s; chosen on another seed's sensor."""

HIGH_N, NOISE_V, DELAY = 8.5, 0.0205, 10
STEADY: Final = {"acceleration": 0.3, "turn": 10.0, "turns": 0.8, "delay": DELAY, "ways": 16}
"""How a machine's forces move, for the filter; chosen on another seed's sensor."""

PLACES = "ABCDE"
LEVELS_OF_THREE = ((3.0, 2.0, 1.0), (1.0, 2.0, 3.0))
FINGER_FORCE = 4.0
"""N, of the presses of several places."""

Series = Float[np.ndarray, " _"]


class Records(NamedTuple):
    """Presses of one location: one array for each record."""

    time: list[Series]
    force: list[Series]
    reading: list[Series]


class Followed(NamedTuple):
    """A filter's estimates of records' forces, N."""

    now: list[Series]
    """as the readings come"""
    late: list[Series]
    """of the force `DELAY` readings before"""
    deviation: list[Series]
    """of `now`"""


@dataclass(frozen=True, eq=False)
class Skin:
    """One virtual laboratory with a sensor of its own.

    `epochs`: of the networks of (A). `sessions`: how often the four test loops are pressed.
    """

    seed: int
    epochs: int = 1000
    sessions: int = 1

    @cached_property
    def rig(self) -> MicrochannelRig:
        """The sensor, its presses and its noise."""
        return MicrochannelRig(seed=self.seed)

    # (A) One contact

    @cached_property
    def taught(self) -> Records:
        """A machine's presses of A, to learn from."""
        return records([self.rig.cnc_loops(LENGTH, session=100 + k) for k in range(SESSIONS)])

    @cached_property
    def loops(self) -> Records:
        """Fig 6: loops that no network has seen."""
        every = (self.rig.test_loops(session=session) for session in range(self.sessions))
        return records([loop for four in every for loop in four])

    @cached_property
    def timeless(self) -> Learnt:
        """The paper's network: it sees the Preisach transform of the readings, which has no time."""
        t, F, z = self.taught
        return train_staircase(
            t, z, F, epochs=self.epochs, thresholds=READING["thresholds"], lags=()
        )

    @cached_property
    def network(self) -> Learnt:
        """Ours: the same with delayed readings beside the transform."""
        t, F, z = self.taught
        return train_staircase(t, z, F, epochs=self.epochs, **READING)

    @cached_property
    def filter(self) -> MultiContactEstimator:
        """Ours, where there is time: a network from force to reading, run backwards."""
        t, F, z = self.taught
        found = train_staircase(t, F, z, epochs=self.epochs, rate=3e-3, **FORCE)
        sensor = ChannelSensor([found.model])
        return MultiContactEstimator(
            sensor, max(found.off, NOISE_V), MotionFilter(HIGH_N, **STEADY)
        )

    @cached_property
    def by_timeless(self) -> list[Series]:
        """Forces of the loops by the paper's network, N."""
        return self.by(self.timeless)

    @cached_property
    def by_network(self) -> list[Series]:
        """The same by ours."""
        return self.by(self.network)

    @cached_property
    def by_filter(self) -> Followed:
        """The same by the filter."""
        whole = (_padded(self.loops.time), _padded(self.loops.reading))
        found = [self.filter.simulate(t, z[:, None]) for t, z in zip(*whole, strict=True)]
        lengths = [len(t) for t in self.loops.time]

        def each(values: list[Any]) -> list[Series]:
            return [np.asarray(v)[:n, 0] for v, n in zip(values, lengths, strict=True)]

        return Followed(
            each([one.value for one in found]),
            each([one.late for one in found]),
            each([one.deviation for one in found]),
        )

    def by(self, learnt: Learnt) -> list[Series]:
        """Forces of the loops by a network from reading to force, N."""
        estimator = ForceEstimator(learnt.model, learnt.off, HIGH_N)
        whole = zip(
            _padded(self.loops.time), _padded(self.loops.reading), self.loops.time, strict=True
        )
        return [np.asarray(estimator.simulate(t, z).value)[: len(own)] for t, z, own in whole]

    def rms(self, found: Sequence[Series]) -> float:
        """Error of the loops' forces, N."""
        return rms([a - b for a, b in zip(found, self.loops.force, strict=True)])

    @property
    def rms_late(self) -> float:
        """Of ours of the forces `DELAY` readings before, N."""
        pairs = zip(self.by_filter.late, self.loops.force, strict=True)
        return rms([late[DELAY:] - force[:-DELAY] for late, force in pairs])

    # (B) Which place

    @cached_property
    def votes(self) -> Confusion:
        """Table II: twenty presses of each place by five nearest neighbours among 1,592."""
        return self._confusion("neighbours")

    @cached_property
    def likeliest(self) -> Confusion:
        """The same presses by ours."""
        return self._confusion("gaussian")

    def _confusion(self, method: str) -> Confusion:
        known, asked = self.rig.finger_presses(), self.rig.finger_presses(20, session=1)
        localizer = Localizer.train(
            known.reading, known.location, method=method, noise=self.rig.readout.noise
        )
        counts = localizer.confusion(asked.reading, asked.location).counts
        return Confusion(tuple(PLACES), counts)

    # (C) Which places at once

    @cached_property
    def logic(self) -> LogicTable:
        """Table I, with the reading of one level known."""
        return LogicTable(
            LEVELS_OF_THREE, "ACE", unit=level(FINGER_FORCE), noise=self.rig.readout.noise
        )

    @cached_property
    def decisions(self) -> list[tuple[frozenset[Hashable], Decision]]:
        """Table III: three presses of each of seven combinations, and what the table says of each."""
        pressed = [places for places in self.logic.combinations for _ in range(3)]
        readings = self.rig.press_together(
            [[FINGER_FORCE * (name in places) for name in PLACES] for places in pressed]
        )
        found = [self.logic.decide(reading) for reading in readings]
        return list(zip(pressed, found, strict=True))


def records(found: Sequence[ChannelRecord]) -> Records:
    """Of location A in layer 1."""
    return Records(
        [one.time for one in found],
        [one.force[:, 0] for one in found],
        [one.reading[:, 0] for one in found],
    )


def level(force: float) -> float:
    """V of one level: location E in layer 1 at the end of a centred press."""
    centred = MicrochannelRig(
        placement_common=0.0, placement_differential=0.0, readout=ResistiveReadout(noise=0.0)
    )
    return float(centred.press_together([[0, 0, 0, 0, force]])[0, 0])


def rms(errors: Sequence[np.ndarray]) -> float:
    """Of all of them together."""
    return float(np.sqrt(np.mean(np.concatenate([e.ravel() for e in errors]) ** 2)))


def _padded(series: Sequence[Series]) -> list[Series]:
    """Repeated at the end, so that one length is compiled."""
    longest = max(map(len, series))
    return [np.pad(one, (0, longest - len(one)), mode="edge") for one in series]
