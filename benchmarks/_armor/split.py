"""The split of the gain: what each addition to the published method brings, on rigs of two physics."""

import numpy as np

from compensate.armor import Armor, Box, ContactSolver, Cover, WristSensor
from hysid.armor._calibration import CalibratedArmor, calibrate_armor
from hysid.reproduction._armor import (
    METHODS,
    OURS,
    Method,
    Rig,
    body_errors,
    foam,
    following,
    twenty_presses,
)
from hysteresis import AbstractModel

from .._measure import Row, judged, noted


def _calibrated(rig: Rig, model: AbstractModel) -> CalibratedArmor:
    """Without what slips and sags: a matrix, and a factor of a cover's model."""
    armor = Armor(WristSensor(), ContactSolver(Box(*rig.soft.size), Cover(model, factor=1.0)))
    return calibrate_armor(armor, twenty_presses(rig.soft), seed=rig.seed)


STEPS = {
    "the published method, approximation 2": METHODS["b"],
    "with twenty presses: a 6 x 6 matrix, a factor of the line": Method(
        "calibrated line", True, following(lambda rig: _calibrated(rig, rig.lines["2"]))
    ),
    "and memory of the foam": Method(
        "foam with memory", True, following(lambda rig: _calibrated(rig, foam(rig.soft.cover)))
    ),
    "and everything: hysteresis of the sensor, sag of the frame": METHODS[OURS],
}
"""From the published method to ours, one addition at a time."""


def split_rows(quick: bool) -> list[Row]:
    """Mean error in mm at the 45 points after each of `STEPS`."""
    count, rows, found = 3 if quick else 20, [], {}
    for where in ("outside", "inside"):
        rigs = [Rig(seed, inside=where == "inside") for seed in range(count)]
        means = [np.mean([body_errors(rig, method) for rig in rigs]) for method in STEPS.values()]
        first, *_, last = found[where] = [float(mean) for mean in means]
        for step, mean in zip(STEPS, found[where], strict=True):
            gain = f"{100 * (first - mean) / (first - last):.0f} % of the gain"
            rows.append(noted(f"split, {where} our classes, {step}, mm", mean, reason=gain))
    _, line, *_, ours = found["outside"]
    what = f"45 points at 15 N, {count} rigs outside our classes"
    return [
        judged(f"{what}: ours over the calibrated line", ours / line, 0.6),
        judged(f"{what}: ours, mm", ours, 2.5),
        *rows,
    ]
