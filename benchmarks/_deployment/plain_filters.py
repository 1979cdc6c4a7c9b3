"""The filters of `docs/in-an-estimator.md` without JAX: an exported compensator whose error is a state.

The same presses as in `estimators`. The file says how large the error is (its deviation), which part of it
lasts, and how long; nothing else is learnt.
"""

import math
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from compensate import calibrated, export_runtime, invert
from compensate.runtime import load
from compensate.runtime._compensator import Compensator
from hysteresis import Record
from identify import FitResult

from .._measure import Row, judged, noted


class Filtered(NamedTuple):
    """Forces, their variances, and the innovations over their deviations."""

    force: np.ndarray
    variance: np.ndarray
    white: np.ndarray


def kalman(
    rows: Iterable[tuple[float, float, float, float]],
    start: float,
    lasting: dict[str, float],
    dt: float,
    walk: float,
) -> Filtered:
    """Of rows (change of the plan, estimate, its deviation, motor current), all in N.

    States are the force and beta, the part of the compensator's error that lasts, in deviations.
    """
    share, time = lasting["share"], lasting["time"]
    phi = math.exp(-dt / time) if time else 0.0
    F, b, found = start, 0.0, []
    FF, Fb, bb = 1.0, 0.0, share
    for rate, z, d, current in rows:
        F, b = F + rate, phi * b
        FF, Fb, bb = FF + walk**2 * dt, phi * Fb, phi**2 * bb + share * (1 - phi**2)
        white = []
        for seen, h, noise in ((z, d, (1 - share) * d**2), (current, 0.0, 1.0)):
            S = FF + 2 * h * Fb + h**2 * bb + noise
            K, L = (FF + h * Fb) / S, (Fb + h * bb) / S
            off = seen - F - h * b
            F, b = F + K * off, b + L * off
            FF, Fb, bb = FF - K**2 * S, Fb - K * L * S, bb - L**2 * S
            white.append(off / math.sqrt(S))
        found.append((F, FF, white))
    return Filtered(*(np.array(part) for part in zip(*found, strict=True)))


def plain_rows(
    fit: FitResult, before: Record, readings: np.ndarray, runs: tuple[np.ndarray, ...], lead: int,
    dt: float, walk: float,
) -> list[Row]:  # fmt: skip
    """NEES and innovations over new runs: true forces, plans, motor currents and first forces of each.

    `readings`: of all rows; the runs are the last ones, each after `lead` rows.
    """
    true, plan, current, start = runs
    count, each = true.shape
    error = calibrated(invert(fit.model), before)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "sensor.json"
        export_runtime(fit.model, file, before.output, times=before.time, error=error)
        sensor = load(file)
    assert isinstance(sensor, Compensator)
    assert sensor.lasting is not None
    estimates = [sensor.step(dt, float(y)) for y in readings][-count * (each + lead) :]
    value, deviation = (
        np.array([getattr(one, name) for one in estimates]).reshape(count, -1)[:, lead:]
        for name in ("value", "deviation")
    )
    rates = np.diff(plan, prepend=plan[:, :1])
    found = [
        kalman(zip(*(x[k].tolist() for x in (rates, value, deviation, current)), strict=True),
               float(start[k]), sensor.lasting, dt, walk)
        for k in range(count)
    ]  # fmt: skip
    F, variance, white = (np.stack(part) for part in zip(*found, strict=True))
    nees = float(((F - true) ** 2 / variance).mean())
    low, high = scipy.stats.chi2.ppf([0.025, 0.975], count) / count
    inside = 100 * float(((F - true) ** 2 / variance < scipy.stats.chi2.ppf(0.9, 1)).mean())
    next_ = np.mean(white[:, 1:] * white[:, :-1], axis=(0, 1)) / np.mean(white**2, axis=(0, 1))
    bound = 2.576 / math.sqrt(white[:, 1:, 0].size)
    what = f"the same without JAX, {count} seeds: "
    return [
        judged(f"{what}NEES", nees, float(high)),
        judged(f"{what}NEES", nees, float(low), at_least=True),
        judged(f"{what}forces in the 90 % band, off 90 %", abs(inside - 90), 3.0),
        *(
            judged(f"{what}correlation of {name} innovations, 99 % bound", abs(float(one)), bound)
            for name, one in zip(("compensator", "current"), next_, strict=True)
        ),
        noted(f"{what}share of the error that lasts", sensor.lasting["share"]),
        noted(f"{what}how long, s", sensor.lasting["time"]),
    ]
