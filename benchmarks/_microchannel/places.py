"""Virtual microchannel sensors: which place is pressed, and which are at once."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from compensate.internal import LogicStatus
from compensate.microchannel import Localizer, LogicTable
from hysid.reproduction._skin import LEVELS_OF_THREE, level
from hysteresis.internal import ResistiveReadout
from hysteresis.rigs import MicrochannelRig

from .._measure import Row, judged, least_seconds, noted
from .inside import InsideSkin

SENSORS, FEW = 20, 5
PRESSES = 10_000
"""Of each sensor, by which it is judged: 200,000 with 20."""

PAPER_ACCURACY, PAPER_SPREAD = 93.0, 2.4
"""%, of 100 presses; what 100 presses of the virtual sensor scatter by."""

LEVELS_OF_FIVE = [[3, 2.5, 2, 1.5, 1], [1, 1.5, 2, 2.5, 3]]


class Places(NamedTuple):
    """Of one sensor, trained by 1,592 presses, %."""

    neighbours: float
    """right of the paper's 100 presses, by five nearest neighbours"""
    second_to_third: float
    """presses of B taken for C, of 20"""
    fourth_to_fifth: float
    """presses of D taken for E, of 20"""
    gaussian: float
    """right of `PRESSES`"""
    bayes: float
    """right of the same by the law of the sensor itself"""
    calibration: float
    """mean difference of probabilities and frequencies, in ten bins"""
    rejected: float
    """of the same, taken for no known press"""


def place_rows(quick: bool) -> list[Row]:
    """Over sensors of the seeds 0, 1, ...: (B) one place at a time, (C) several."""
    count = FEW if quick else SENSORS
    return _single(count) + _several(count)


def _single(count: int) -> list[Row]:
    found = [of_sensor(seed) for seed in range(count)]
    mean, sd = (Places(*f(found, axis=0)) for f in (np.mean, np.std))
    what = f"{count} sensors"
    near = bool(abs(mean.neighbours - PAPER_ACCURACY) <= PAPER_SPREAD)
    return [
        Row(
            f"(B) five nearest neighbours, % of 100 presses right, the paper's 93 ({what})",
            mean.neighbours, PAPER_ACCURACY - PAPER_SPREAD, None, near, at_least=True,
        ),
        noted("    deviation from sensor to sensor, %", sd.neighbours),
        noted("    presses of B taken for C, of 20 (the paper: 2)", mean.second_to_third),
        noted("    presses of D taken for E, of 20 (the paper: 5)", mean.fourth_to_fifth),
        judged(
            f"(B) our localizer, points below the Bayes accuracy ({PRESSES * count} presses)",
            mean.bayes - mean.gaussian, 1.0,
        ),
        noted("    the Bayes accuracy, %", mean.bayes),
        noted("    our accuracy, %", mean.gaussian),
        noted("    our probabilities against frequencies, mean difference, %", mean.calibration),
        noted("    presses at known places rejected, %", mean.rejected),
        noted("    microseconds a press, in a batch", 1e6 * _seconds_a_press()),
    ]  # fmt: skip


def of_sensor(seed: int) -> Places:
    """Train one sensor and ask it."""
    skin = InsideSkin(seed)
    rig, table = skin.rig, skin.paper.places
    known, many = rig.finger_presses(), rig.finger_presses(PRESSES // 5, session=2)
    noise = rig.readout.noise
    ours = Localizer.train(known.reading, known.location, noise=noise).locate(many.reading)
    right = ours.probability.argmax(axis=1) == many.location
    return Places(
        neighbours=100 * table.accuracy,
        second_to_third=float(table.counts[1, 2]),
        fourth_to_fifth=float(table.counts[3, 4]),
        gaussian=100 * float(right.mean()),
        bayes=100
        * float(np.mean(bayes_places(MicrochannelRig(seed=seed), many.reading) == many.location)),
        calibration=100 * _calibration(ours.probability.max(axis=1), right),
        rejected=100 * float(np.mean(ours.place < 0)),
    )


def bayes_places(rig: MicrochannelRig, readings: Float[np.ndarray, "presses 2"]) -> np.ndarray:
    """The likeliest place of every press by the law that made it: no localizer is better.

    ln V = ln m_k(F) + placement + e/V, normal at every force F, which is even over 1.5 to 8 N and summed
    over 80 of them. A hundred and fifty neighbours among 200,000 presses agree with it to 0.1 %.
    """
    still = replace(
        rig, placement_common=0.0, placement_differential=0.0, readout=ResistiveReadout(noise=0.0)
    )
    force = np.linspace(1.5, 8.0, 80)
    V = np.maximum(readings, rig.readout.noise)
    common, between = rig.placement_common**2, rig.placement_differential**2
    spread = np.full((len(V), 2, 2), common) + between * np.array([[1.0, -1.0], [-1.0, 1.0]])
    spread += np.eye(2) * ((rig.readout.noise / V) ** 2)[:, None]
    metric = np.linalg.inv(spread)
    likelihood = []
    for place in range(5):
        centre = np.log(still.press_together(force[:, None] * np.eye(5)[place]))
        squared = np.zeros((len(V), len(force)))
        off = [np.log(V[:, [layer]]) - centre[:, layer] for layer in (0, 1)]
        for i in (0, 1):
            for j in (0, 1):
                squared += metric[:, i, j, None] * off[i] * off[j]
        likelihood.append(np.exp(-squared / 2).sum(axis=1))
    return np.argmax(likelihood, axis=0)


def _calibration(sure: np.ndarray, right: np.ndarray) -> float:
    which = np.minimum((10 * sure).astype(int), 9)
    return sum(
        float(abs(sure[which == n].sum() - right[which == n].sum())) for n in range(10)
    ) / len(sure)


def _seconds_a_press() -> float:
    rig = MicrochannelRig(seed=0)
    known = rig.finger_presses()
    ours = Localizer.train(known.reading, known.location, noise=rig.readout.noise)
    return least_seconds({"locate": lambda: ours.locate(known.reading).place}, 5)["locate"] / 1592


def _several(count: int) -> list[Row]:
    right = np.array([_of_21(seed) for seed in range(count)])
    return [
        judged(
            f"(C) presses of A, C, E and together, right of 21, the median of {count} sensors",
            float(np.median(right)), 21, at_least=True,
        ),
        noted("    the mean of the sensors", float(right.mean())),
        noted("    sensors without any fault, %", 100 * float(np.mean(right == 21))),
        noted("    at 1.5 to 8 N, force unknown: right, or told among what it may be, %", _unknown()),
        judged(
            "(C) combinations of five places decided or named as collisions, force known",
            _settled(1.0), 31, at_least=True,
        ),
        judged(
            "(C) combinations of five places decided or named as collisions, force unknown",
            _settled((0.1, 1.0)), 31, at_least=True,
        ),
        noted(
            "    changes found that leave no collision among A, C, E at unknown force",
            float(len(LogicTable(LEVELS_OF_THREE, "ACE", unit=(0.1, 1.0)).remedies())),
        ),
    ]  # fmt: skip


def _of_21(seed: int) -> int:
    """The paper's table III: three presses of each of seven combinations."""
    return sum(places == found for places, found in InsideSkin(seed).decisions)


def _unknown() -> float:
    """Of presses of A, C and E and together, each to another force that nobody tells."""
    rig, force = MicrochannelRig(seed=0), np.random.default_rng(0).uniform(1.5, 8.0, 700)
    table = LogicTable(
        LEVELS_OF_THREE, "ACE", unit=(level(rig, 1.5), level(rig, 8.0)), noise=rig.readout.noise
    )
    pressed = [places for places in table.combinations for _ in range(100)]
    readings = rig.press_together(
        force[:, None] * [[name in places for name in "ABCDE"] for places in pressed]
    )
    found = [table.decide(reading) for reading in readings]
    told = [p in (f.places, *f.alternatives) for p, f in zip(pressed, found, strict=True)]
    return 100 * float(np.mean(told))


def _settled(unit: float | tuple[float, float]) -> int:
    """Of the combinations read without scatter: found alone, or told as a collision that is named."""
    table = LogicTable(LEVELS_OF_FIVE, unit=unit, common=0.01, differential=0.01)
    named = {places for group in table.collisions() for places in group}
    settled = 0
    for places, levels in zip(table.combinations, table.sums, strict=True):
        found = table.decide(np.mean(unit) * levels)
        alone = found.places == places and found.status == LogicStatus.OK
        told = found.status == LogicStatus.COLLISION and places in named
        settled += alone or (told and places in (found.places, *found.alternatives))
    return settled
