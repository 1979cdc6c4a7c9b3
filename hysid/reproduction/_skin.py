"""Three experiments of Kim and Park (2018) on one virtual skin, by the paper's methods and by ours:
(A) the force of one contact, (B) which place is pressed, (C) which places are pressed at once."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import jax
import numpy as np
import optax
from jaxtyping import Float

from compensate.internal import ForceEstimator, Readout
from compensate.microchannel import Localizer, LogicTable
from compensate.microchannel._localizer import Confusion
from hysteresis.internal import ChannelGeometryRig, ResistiveReadout, StaircaseNetwork
from hysteresis.rigs._skin_presses import AbstractSkinRig, ChannelRecord
from identify.internal import train
from identify.training._train import Trained

from ..soft_sensor._force_training import BATCH, decaying, staircase_squares
from ..soft_sensor._sensor import lengthened

SESSIONS, LENGTH = 28, 2025
"""56,700 readings in records that begin with the sensor at rest, as the loops to be judged on do."""

READING: Final = {"thresholds": (0.1, 0.2, 0.4, 0.8), "lags": (0.03, 0.06, 0.12, 0.25, 1.0, 5.0)}
FORCE: Final = {"thresholds": (0.1, 0.2, 0.35, 0.6, 1.0, 1.6, 2.6), "lags": (0.02, 0.2, 1.0, 8.0)}
"""What each network sees: half widths of plays in V or N, delays in s; chosen on another seed's sensor."""

HIGH_N, NOISE_V = 8.5, 0.0205

PLACES = "ABCDE"
LEVELS_OF_THREE = ((3.0, 2.0, 1.0), (1.0, 2.0, 3.0))
FINGER_FORCE = 4.0
"""N, of the presses of several places."""

Series = Float[np.ndarray, " _"]
Pressed = tuple[frozenset[Hashable], frozenset[Hashable]]
"""The places that are pressed at once, and those found."""


class Records(NamedTuple):
    """Presses of one location: one array for each record."""

    time: list[Series]
    force: list[Series]
    reading: list[Series]


def off_of(found: Trained) -> float:
    """RMSE of a network on the tenth of the rows that it did not learn from."""
    return float(np.sqrt(found.validation[found.best]))


@dataclass(frozen=True, eq=False)
class Skin:
    """One virtual laboratory with a sensor of its own.

    `epochs`: of the networks of (A). `sessions`: how often the four test loops are pressed.
    """

    seed: int
    epochs: int = 1000
    sessions: int = 1

    @cached_property
    def rig(self) -> AbstractSkinRig:
        """The sensor, its presses and its noise."""
        return ChannelGeometryRig(seed=self.seed)

    def volts(self, readings: Float[np.ndarray, "presses layers"]) -> Float[np.ndarray, "p l"]:
        """Through converter and `Readout`."""
        return converted(readings, self.rig.readout)

    def records(self, found: Sequence[ChannelRecord]) -> Records:
        """Of location A in layer 1."""
        parts = ([one.time, one.force[:, 0], self.volts(one.reading)[:, 0]] for one in found)
        return Records(*map(list, zip(*parts, strict=True)))

    # (A) One contact

    @cached_property
    def taught(self) -> Records:
        """A machine's presses of A, to learn from."""
        return self.records([self.rig.cnc_loops(LENGTH, session=100 + k) for k in range(SESSIONS)])

    @cached_property
    def loops(self) -> Records:
        """Fig 6: loops that no network has seen."""
        every = (self.rig.test_loops(session=session) for session in range(self.sessions))
        return self.records([loop for four in every for loop in four])

    @cached_property
    def paper(self) -> "Methods":
        """By the paper's methods."""
        return Methods(self, ours=False)

    @cached_property
    def ours(self) -> "Methods":
        """By ours."""
        return Methods(self, ours=True)

    def by(self, learnt: Trained, loops: Records | None = None) -> list[Series]:
        """Forces of the loops by a network from reading to force, N."""
        loops = loops or self.loops
        estimator = ForceEstimator(learnt.module, off_of(learnt), HIGH_N)
        pairs = zip(loops.time, loops.reading, strict=True)
        found = [estimator.simulate(lengthened(t), lengthened(z)) for t, z in pairs]
        return [np.asarray(f.value)[: len(t)] for f, t in zip(found, loops.time, strict=True)]

    def rms(self, found: Sequence[Series]) -> float:
        """Error of the loops' forces, N."""
        return rms([a - b for a, b in zip(found, self.loops.force, strict=True)])

    # (C) Which places at once

    @cached_property
    def logic(self) -> LogicTable:
        """Table I, with the reading of one level known, and the scatter of presses learnt."""
        common, differential = self.scatter
        return LogicTable(
            LEVELS_OF_THREE, "ACE", unit=level(self.rig, FINGER_FORCE), noise=self.rig.readout.noise,
            common=common, differential=differential,
        )  # fmt: skip

    @cached_property
    def scatter(self) -> tuple[float, float]:
        """Standard deviations of ln p, common to the layers and between them, of twenty taught presses
        on each of A, C and E whose force a gauge read."""
        made = self.rig.finger_presses((20, 0, 20, 0, 20), session=2)
        volts = np.maximum(self.volts(made.reading), self.rig.readout.noise)
        log = np.log(volts / made.force[:, None])
        left = []
        for place in (0, 2, 4):
            own, force = log[made.location == place], made.force[made.location == place]
            for layer in own.T:  # a section closes as the force grows
                left.append(layer - np.polyval(np.polyfit(force, layer, 2), force))
        off = np.reshape(left, (3, 2, -1))
        mean = off.mean(axis=1)
        return float(np.std(mean)), float(np.std((off[:, 0] - off[:, 1]) / 2))

    @cached_property
    def decisions(self) -> list[Pressed]:
        """Table III with all fingers pressing alike, and what the table says of each."""
        pressed = [places for places in self.logic.combinations for _ in range(3)]
        forces = np.array([[name in one for name in PLACES] for one in pressed]) * FINGER_FORCE
        volts = self.volts(self.rig.press_together(forces))
        return [(p, self.logic.decide(z).places) for p, z in zip(pressed, volts, strict=True)]


@dataclass(frozen=True, eq=False)
class Methods:
    """What the paper's methods, or ours, make of the readings of one skin: (A) the force, (B) the place."""

    skin: Skin
    ours: bool

    @cached_property
    def network(self) -> Trained:
        """From reading to force. The paper's sees the Preisach transform of the readings, which has no
        time; ours sees delayed readings beside it."""
        t, F, z = self.skin.taught
        lags = READING["lags"] if self.ours else ()
        seen = READING["thresholds"]
        return train_staircase(t, z, F, epochs=self.skin.epochs, thresholds=seen, lags=lags)

    @cached_property
    def forces(self) -> list[Series]:
        """Of the loops, N."""
        return self.skin.by(self.network)

    @cached_property
    def places(self) -> Confusion:
        """Table II: twenty presses of each place; in the paper by five nearest neighbours among 1,592."""
        rig, method = self.skin.rig, "gaussian" if self.ours else "neighbours"
        known, asked = rig.finger_presses(), rig.finger_presses(20, session=1)
        taught, judged = self.skin.volts(known.reading), self.skin.volts(asked.reading)
        noise = rig.readout.noise
        localizer = Localizer.train(taught, known.location, method=method, noise=noise)
        return Confusion(tuple(PLACES), localizer.confusion(judged, asked.location).counts)


def converted(
    volts: Float[np.ndarray, "samples channels"],
    electronics: ResistiveReadout,
    current: float | None = None,
) -> Float[np.ndarray, "samples channels"]:
    """What is left of volts after the converter and the way back through a `Readout` that knows them.

    `current`, A: what the `Readout` takes for theirs; all changes are off by the factor between the two.
    The changes of resistance are multiplied by the V_0 of the usual electronics, so that a network sees the
    same numbers whatever the current is.
    """
    back = Readout(
        volts.shape[1], resistance=electronics.resistance_ohm,
        current=electronics.current_a if current is None else current, gain=electronics.gain,
        low=electronics.low, high=electronics.high, bits=electronics.bits,
    )  # fmt: skip
    changes = back.simulate(np.arange(float(len(volts))), electronics.counts(volts)).value
    return ResistiveReadout().scale * np.asarray(changes)


def level(rig: AbstractSkinRig, force: float) -> float:
    """V of one level: location E in layer 1 at the end of a press in its middle, without noise."""
    rise = np.sin(np.linspace(0, np.pi / 2, 12))
    pressed = force * rise[:, None] * (np.arange(5) == 4)
    return float(rig.follow(pressed, 0.05)[-1, 0])


def rms(errors: Sequence[np.ndarray]) -> float:
    """Of all of them together."""
    return float(np.sqrt(np.mean(np.concatenate([e.ravel() for e in errors]) ** 2)))


def train_staircase(
    times: Sequence[Series],
    inputs: Sequence[Series],
    outputs: Sequence[Series],
    *,
    thresholds: Sequence[float],
    lags: Sequence[float],
    epochs: int = 1000,
    rate: float = 2e-3,
    every: int = 1,
) -> Trained:
    """`StaircaseNetwork` from inputs to outputs, one array for each record.

    `every`: it learns from every so many rows; its memory has seen them all.
    """
    start = StaircaseNetwork.random(
        inputs, outputs, times, jax.random.key(0), thresholds=thresholds, lags=lags
    )
    pairs = zip(times, inputs, strict=True)
    x = np.concatenate([np.asarray(start.prepare(t, u))[::every] for t, u in pairs])
    y = np.concatenate([one[::every] for one in outputs])
    return train(
        start, staircase_squares, (x, y), epochs=epochs, batch=BATCH, float32=True,
        optimizer=decaying_over(rate, epochs, len(y)),
    )  # fmt: skip


def decaying_over(
    rate: float, epochs: int, rows: int, batch: int = BATCH
) -> optax.GradientTransformation:
    """Adam over all epochs of the nine tenths of the rows that are not held out."""
    return decaying(epochs * (9 * rows // (10 * batch)), rate=rate)
