"""The experiments of Kim and Park (2018) on sensors whose physics is close to our models.

They have stops and linear creep, all are one design, and their voltages are not converted.
"""

from functools import cached_property
from typing import Final

import numpy as np

from compensate.internal import ChannelSensor, MotionFilter, MultiContactEstimator
from hysid.reproduction._skin import (
    FORCE,
    HIGH_N,
    NOISE_V,
    Series,
    Skin,
    off_of,
    rms,
    train_staircase,
)
from hysid.reproduction._skin_paper import SkinPair
from hysid.soft_sensor._sensor import lengthened
from hysteresis.rigs import MicrochannelRig
from hysteresis.rigs._skin_presses import ChannelRecord

DELAY = 10
STEADY: Final = {"acceleration": 0.3, "turn": 10.0, "turns": 0.8, "delay": DELAY, "ways": 16}
"""How a machine's forces move, for the filter; chosen on another seed's sensor."""


class InsideSkin(Skin):
    """One sensor, and ours where there is time: a network from force to reading, run backwards."""

    @cached_property
    def rig(self) -> MicrochannelRig:
        """The sensor, its presses and its noise."""
        return MicrochannelRig(seed=self.seed)

    def volts(self, readings: np.ndarray) -> np.ndarray:
        """As they are."""
        return readings

    @cached_property
    def filter(self) -> MultiContactEstimator:
        """The network, and a filter of the forces through it."""
        t, F, z = self.taught
        found = train_staircase(t, F, z, epochs=self.epochs, rate=3e-3, **FORCE)
        noise = max(off_of(found), NOISE_V)
        return MultiContactEstimator(
            ChannelSensor([found.module]), noise, MotionFilter(HIGH_N, **STEADY)
        )

    @cached_property
    def by_filter(self) -> dict[str, list[Series]]:
        """Forces of the loops as the readings come (`value`), of the force `DELAY` readings before
        (`late`), and the `deviation` of the first."""
        pairs = zip(self.loops.time, self.loops.reading, strict=True)
        found = [
            (len(t), self.filter.simulate(lengthened(t), lengthened(z[:, None]))) for t, z in pairs
        ]
        parts = ("value", "late", "deviation")
        return {k: [np.asarray(getattr(f, k))[:n, 0] for n, f in found] for k in parts}

    @property
    def rms_late(self) -> float:
        """Of the forces `DELAY` readings before, N."""
        pairs = zip(self.by_filter["late"], self.loops.force, strict=True)
        return rms([late[DELAY:] - force[:-DELAY] for late, force in pairs])


class InsidePair(SkinPair):
    """Two locations of one sensor."""

    @cached_property
    def rig(self) -> MicrochannelRig:
        """The sensor."""
        return MicrochannelRig(seed=self.seed)

    def read(self, made: ChannelRecord) -> ChannelRecord:
        """As it is."""
        return made
