"""Whether a class of models can represent a rig: then data of the rig would prove nothing."""

from typing import Any

import numpy as np
import scipy

from hysteresis import InputError, Record
from hysteresis.internal import ChannelGeometryRig, FoamBlock, GaugeSensor, force_path
from hysteresis.rigs import ArmorRig
from identify import fit
from identify.fitting._candidates import names

from .._measure import Row, judged

LEAST = 1e-6
"""Of the range: a class that comes nearer contains the rig."""

TURNS = (0.0, 20.0, 0.0, 14.0, 5.0, 18.0, 2.0, 9.0, 0.0)
STEP_S = 2.0


def foam_record() -> Record:
    """Displacement over force, without noise."""
    force = force_path(TURNS, 1.0)
    return _record(force, FoamBlock().follow(force, dt=STEP_S), "N", "mm")


def skin_record() -> Record:
    """Volts of a layer over the force on one place, without noise."""
    force = 0.4 * force_path(TURNS, 1.0)
    placed = force[:, None] * (np.arange(5) == 1)
    return _record(force, ChannelGeometryRig(seed=3).follow(placed, dt=STEP_S)[:, 0], "N", "V")


def sensor_record() -> Record:
    """One axis of the sensor over its own load, without noise."""
    sensor = GaugeSensor(noise_n=1e-15, noise_nm=1e-15)
    specimen = sensor.specimen(np.random.default_rng(0))
    force = force_path(TURNS, 1.0)
    load = force[:, None] * (np.arange(6) == 2)
    shown = sensor.read(load[None], specimen, np.random.default_rng(0))[0, :, 2]
    return _record(force, shown, "N", "N")


RIGS = {"foam": foam_record, "skin": skin_record, "sensor": sensor_record}


def nearest(record: Record, name: str) -> float:
    """How far a class stays from a record at its own best fit, rms over the record's range."""
    model = fit(record, name, noise="gaussian", conditioning="keep").model
    left = np.asarray(model.simulate(record.time, record.input)) - record.output
    return float(np.sqrt(np.mean(left**2)) / np.ptp(record.output))


def nearest_bumps() -> float:
    """The same of a frame's compliance over a surface and a smooth bump in its middle."""
    rig = ArmorRig.of_foam(0)
    assert rig.frame is not None
    u = np.linspace(-0.24, 0.24, 13)
    at = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    found = rig.frame.compliance(at, np.full((169, 2), 0.25), np.zeros(169, bool))
    square = np.sum(at**2, axis=1)

    def left(x: Any) -> Any:
        return (x[0] + x[1] * np.exp(-square / (2 * x[2] ** 2)) - found / found.max()).ravel()

    best = scipy.optimize.least_squares(left, [0.0, 1.0, 0.1])
    return float(np.sqrt(np.mean(best.fun**2)))


def class_rows(quick: bool) -> list[Row]:
    """Every class that `fit` knows by name, on every rig."""
    rows = [judged("rig against class: frame, a bump, rms", nearest_bumps(), LEAST, at_least=True)]
    for rig, make in RIGS.items():
        record = make()
        for name in ("Preisach", "Composition") if quick else names():
            try:
                off = nearest(record, name)
            except InputError:
                continue  # a class that cannot take the record at all
            what = f"rig against class: {rig}, {name}, rms of the range"
            rows.append(judged(what, off, LEAST, at_least=True))
    return rows


def _record(x: np.ndarray, y: np.ndarray, x_unit: str, y_unit: str) -> Record:
    time = STEP_S * np.arange(len(x))
    return Record.from_arrays(x, y, time, input_unit=x_unit, output_unit=y_unit)
