"""(D) of Kim and Park (2018) on one virtual skin, the forces on B and D at once, and each one's alone; and
what is measured of all their experiments."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from compensate.internal import ForceNetwork, MotionFilter, MultiContactEstimator, SearchEstimator
from compensate.microchannel._multi import windows
from hysteresis.internal import ChannelGeometryRig
from hysteresis.rigs._skin_presses import AbstractSkinRig, ChannelRecord
from identify.internal import train
from identify.training._train import Trained

from ..soft_sensor._contacts import train_contacts
from ..soft_sensor._force_records import ForceRecord
from ..soft_sensor._force_training import BATCH, updates_of
from ._frame import Measure, Paper, Say, compared
from ._skin import FORCE, HIGH_N, NOISE_V, PLACES, Methods, Skin, converted, decaying_over, rms

OURS_FOR_ONE = 6
"""Epochs of our networks for each one of the paper's recurrent networks."""

PAIR, NAMES, SAMPLES, DT = (1, 3), "BD", (3960, 3651), 0.05
"""Locations, their names, readings to learn from, s between readings."""

PARTS = 10
"""Records the readings come in, each with the sensor at rest first."""

NEAR_S = 1.0
"""From a peak to its estimate, at most."""

Forces = Float[np.ndarray, "samples 2"]


class Peak(NamedTuple):
    """A true peak and its estimate: force in N, time and how late it is in s; NaN where none is."""

    location: str
    time: float
    force: float
    found: float
    late: float


@dataclass(frozen=True, eq=False)
class Pressed:
    """A record of two locations, and the forces that both methods find in it, N."""

    pair: "SkinPair"
    record: ChannelRecord

    @property
    def truth(self) -> Forces:
        """Of B and D."""
        return self.record.force[:, PAIR]

    @cached_property
    def paper(self) -> Forces:
        """By the search."""
        return np.asarray(self.pair.paper.simulate(self.record.time, self.record.reading))

    @cached_property
    def ours(self) -> Forces:
        """By ours, as the readings come."""
        return np.asarray(self.pair.ours.simulate(self.record.time, self.record.reading).value)


@dataclass(frozen=True, eq=False)
class SkinPair:
    """Two locations of one virtual sensor. `epochs`: at most, of the paper's recurrent networks."""

    seed: int
    epochs: int = 100

    @cached_property
    def rig(self) -> AbstractSkinRig:
        """The sensor."""
        return ChannelGeometryRig(seed=self.seed)

    def read(self, made: ChannelRecord) -> ChannelRecord:
        """Through converter and `Readout`."""
        return made._replace(reading=converted(made.reading, self.rig.readout))

    @cached_property
    def taught(self) -> list[list[ForceRecord]]:
        """A machine's presses of B, and of D."""

        def press(place: int, count: int, k: int) -> ForceRecord:
            made = self.rig.cnc_loops(count, location=place, dt=DT, session=10 * place + k)
            one = self.read(made)
            return ForceRecord(one.time, one.reading, one.force[:, place])

        places = zip(PAIR, SAMPLES, strict=True)
        return [[press(place, n // PARTS, k) for k in range(PARTS)] for place, n in places]

    @cached_property
    def paper(self) -> SearchEstimator:
        """A recurrent network of each location, and the search among 81 pairs."""
        networks = [
            train_recurrent(found, epochs=self.epochs, seed=place).module
            for found, place in zip(self.taught, PAIR, strict=True)
        ]
        return SearchEstimator(networks)

    @cached_property
    def ours(self) -> MultiContactEstimator:
        """A small network of each location, and Gauss-Newton steps through both."""
        epochs = OURS_FOR_ONE * self.epochs
        return train_channels(self.taught, **FORCE, high_force=HIGH_N, noise=NOISE_V, epochs=epochs)

    @cached_property
    def alone(self) -> tuple[Pressed, Pressed]:
        """A finger on B alone, and on D alone."""
        b, d = ((place,) for place in PAIR)
        return self._found(locations=b, session=10), self._found(locations=d, session=11)

    @cached_property
    def together(self) -> Pressed:
        """Fig 8: a finger on each, at random times, eight presses each."""
        return self._found(locations=PAIR, session=0)

    @cached_property
    def placed(self) -> Pressed:
        """The same, but every press in the middle of its location, as those to learn from were."""
        return self._found(locations=PAIR, session=0, finger=False)

    @cached_property
    def paper_us(self) -> float:
        """Microseconds a reading by the paper's method."""
        return _us(self.paper, self.together.record)

    @cached_property
    def ours_us(self) -> float:
        """The same by ours."""
        return _us(self.ours, self.together.record)

    def _found(self, **presses: Any) -> Pressed:
        return Pressed(self, self.read(self.rig.simultaneous(**presses)))


def train_recurrent(records: Sequence[ForceRecord], *, epochs: int = 100, seed: int = 0) -> Trained:
    """The paper's `ForceNetwork` from the last forces on one location to all layers' readings."""
    forces = np.concatenate([windows(one.force) for one in records])
    readings = np.concatenate([one.reading for one in records])
    found = train(
        ForceNetwork.random(jax.random.key(seed)), _window_squares, (forces, readings),
        epochs=epochs, batch=BATCH, float32=True, patience=10,
        optimizer=decaying_over(2e-3, epochs, len(forces)),
    )  # fmt: skip
    return found._replace(module=eqx.nn.inference_mode(found.module))


def train_channels(
    places: Sequence[Sequence[ForceRecord]],
    *,
    thresholds: Sequence[float],
    lags: Sequence[float],
    high_force: float,
    noise: float,
    epochs: int = 600,
) -> MultiContactEstimator:
    """`train_contacts` of records of one location each, with thresholds in N."""
    rows = min(sum(len(one.time) for one in records) for records in places)
    learnt = train_contacts(
        {str(k): records for k, records in enumerate(places)},
        noise=noise, high_force=high_force, lags=lags,
        thresholds=[r / high_force for r in thresholds],
        motion=MotionFilter(high_force, acceleration=10.0, turn=10.0, turns=1.0),
        updates=updates_of(epochs, rows),
    )  # fmt: skip
    return learnt.estimator


def peaks(truth: Forces, found: Forces) -> list[Peak]:
    """True peaks, each with a peak of its own among the found: within a second, half to twice as high."""
    every = []
    for name, true, estimate in zip(NAMES, truth.T, found.T, strict=True):
        free, _ = scipy.signal.find_peaks(estimate, prominence=0.7)
        for k in scipy.signal.find_peaks(true, prominence=1.0)[0]:
            high_enough = np.abs(np.log2(estimate[free] / true[k])) < 1
            near = free[high_enough & (np.abs(free - k) <= NEAR_S / DT)]
            own = near[np.argmin(np.abs(near - k))] if len(near) else None
            free = free[free != own] if own is not None else free
            value, late = (np.nan, np.nan) if own is None else (estimate[own], DT * (own - k))
            every.append(Peak(name, DT * float(k + 1), float(true[k]), float(value), float(late)))
    return every


def of_pair(pressed: Pressed, ours: bool = False) -> list[Peak]:
    """True peaks beside the paper's estimates, or ours."""
    return peaks(pressed.truth, pressed.ours if ours else pressed.paper)


def found_peaks(pressed: Pressed, ours: bool = False) -> int:
    """How many of the true peaks have an estimate."""
    return int(sum(np.isfinite(peak.found) for peak in of_pair(pressed, ours)))


def error(pressed: Pressed, ours: bool = False) -> float:
    """Of the forces, N."""
    return rms([(pressed.ours if ours else pressed.paper) - pressed.truth])


def _us(estimator: SearchEstimator | MultiContactEstimator, record: ChannelRecord) -> float:
    """Of the fastest of three calls; the first compiles it."""
    spent = []
    for _ in range(3):
        begin = time.perf_counter()
        jax.block_until_ready(estimator.simulate(record.time, record.reading))
        spent.append(time.perf_counter() - begin)
    return 1e6 * min(spent) / len(record.time)


def _window_squares(network: ForceNetwork, rows: Any, key: Any) -> Array:
    return jnp.mean((network(rows[0], key) - rows[1]) ** 2)


EPOCHS, PAIRS = 1000, 3
"""Of the network of (A), a tenth of them of those of (D); sensors of which (D) is made."""
QUICK_EPOCHS, QUICK_PAIRS = 60, 1
"""The same in five minutes on two cores."""


class Laboratory(NamedTuple):
    """A virtual skin, and its experiments with two contacts where they are made."""

    skin: Skin
    pair: SkinPair | None


def _skin(measure: Callable[[Skin, bool], Any]) -> Measure:
    return lambda one, ours: float(measure(one.skin, ours))


def _pair(measure: Callable[[SkinPair, bool], Any]) -> Measure:
    return lambda one, ours: None if one.pair is None else float(measure(one.pair, ours))


def _by(skin: Skin, ours: bool) -> Methods:
    return skin.ours if ours else skin.paper


def _taken(place: str, other: str) -> Measure:
    at = PLACES.index(place), PLACES.index(other)
    return _skin(lambda skin, ours: _by(skin, ours).places.counts[at])


PAPER = Paper("kim2018", {
    "mse_start": _skin(lambda skin, _: np.mean(np.square(skin.taught.force))),
    "mse_end": _skin(lambda skin, ours: _by(skin, ours).network.train[-1]),
    "training": _skin(lambda skin, ours: _by(skin, ours).network.seconds),
    "loops": _skin(lambda skin, ours: skin.rms(_by(skin, ours).forces)),
    **{f"right_{place}": _taken(place, place) for place in PLACES},
    "accuracy": _skin(lambda skin, ours: 100 * _by(skin, ours).places.accuracy),
    "b_for_c": _taken("B", "C"),
    "d_for_e": _taken("D", "E"),
    "logic": _skin(lambda skin, _: sum(p == found for p, found in skin.decisions)),
    "peaks": _pair(lambda pair, ours: found_peaks(pair.together, ours)),
    "peaks_placed": _pair(lambda pair, ours: found_peaks(pair.placed, ours)),
    "alone": _pair(lambda pair, ours: np.mean([error(one, ours) for one in pair.alone])),
    "together": _pair(lambda pair, ours: error(pair.together, ours)),
    "placed": _pair(lambda pair, ours: error(pair.placed, ours)),
    "step": _pair(lambda pair, ours: pair.ours_us if ours else pair.paper_us),
})  # fmt: skip


def carry_out(
    rigs: int, *, seed: int, ours: bool, epochs: int | None, quick: bool, say: Say
) -> dict[str, Any]:
    """(A) to (C) over all sensors, (D) over three; tables of the first."""
    epochs = epochs or (QUICK_EPOCHS if quick else EPOCHS)
    pairs, of_two = QUICK_PAIRS if quick else PAIRS, max(1, epochs // 10)
    laboratories = [
        Laboratory(Skin(seed + n, epochs), SkinPair(seed + n, of_two) if n < pairs else None)
        for n in range(rigs)
    ]

    def progress(done: int) -> None:
        two = " with two contacts" if done <= pairs else ""
        say(f"sensor {done} of {rigs}{two}")

    trained = PAPER.said["trained"].format(epochs, of_two, OURS_FOR_ONE * of_two)
    rows = compared(PAPER.published, laboratories, ours, progress)
    first = laboratories[0].skin
    tables = {
        "Table I. Levels of each combination": str(first.logic),
        f"Table II. Five nearest neighbours, sensor {first.seed}": str(first.paper.places),
    }
    if ours:
        tables[f"Table II by ours, sensor {first.seed}"] = str(first.ours.places)
    return {
        "rig": f"{PAPER.said['rig']} {trained}", "epochs": epochs, "rows": rows,
        "findings": _findings(laboratories, ours), "tables": tables,
    }  # fmt: skip


def _findings(laboratories: Sequence[Laboratory], with_ours: bool) -> list[dict[str, Any]]:
    """What the paper says in words, and whether the sentence is true of all virtual sensors."""
    skins = [one.skin for one in laboratories]
    pairs = [one.pair for one in laboratories if one.pair is not None]
    network = float(np.mean([skin.rms(skin.paper.forces) for skin in skins]))
    curve = float(np.mean([_static_error(skin) for skin in skins]))
    wrong = np.array([20 - np.diag(skin.paper.places.counts[:, :5]) for skin in skins])
    missing = zip(PLACES, wrong.mean(axis=0), strict=True)
    sound = sum(all(p == found for p, found in skin.decisions) for skin in skins)
    late = np.array([peak.late for pair in pairs for peak in of_pair(pair.together)])
    missed, peaks, late = int(np.isnan(late).sum()), len(late), late[np.isfinite(late)]
    together = float(np.mean([error(pair.together) for pair in pairs]))
    numbers: dict[str, float] = {}
    if with_ours:
        for name in ("together", "placed"):
            both = [getattr(pair, name) for pair in pairs]
            numbers[f"ratio_{name}"] = float(np.mean([error(x, True) / error(x) for x in both]))
        steps = np.mean([(pair.paper_us, pair.ours_us) for pair in pairs], axis=0)
        numbers["steps"] = steps[0] / steps[1]
    true = {
        "network": network < 0.5 * curve,
        "places": not wrong[:, [0, 2, 4]].any() and wrong[:, [1, 3]].any(),
        "combinations": sound == len(skins),
        "peaks": not missed and late.min() < 0 < late.max(),
        "contacts": together > network,
    }
    return PAPER.findings(
        true, with_ours, network=network, curve=curve, sound=sound, count=len(skins),
        wrong=", ".join(f"{p} {n:.2g}" for p, n in missing), missed=missed, peaks=peaks,
        early=-1e3 * late.min(), latest=1e3 * late.max(), mean=1e3 * late.mean(), together=together,
        **numbers,
    )  # fmt: skip


def _static_error(skin: Skin) -> float:
    """Of a curve of the fifth order from reading to force, N."""
    z, F = (np.concatenate(part) for part in (skin.taught.reading, skin.taught.force))
    curve = np.polynomial.Polynomial.fit(z, F, 5)
    return skin.rms([curve(z) for z in skin.loops.reading])
