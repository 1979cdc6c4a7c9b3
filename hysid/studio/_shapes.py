"""What a loop would look like with another stiffness, loop width or relaxation time.

The figures are those of `FitResult.characteristics`, which every model has: a composition's own numbers
mean little one by one. The model's output is taken apart into the middle line of its loops over the input,
m(u), and the distance from it. Of a record y = m(u) + d

    y' = m(0) + s (m(u) - m(0)) + w d,

with s the factor of the stiffness (its inverse where the output is the deformation) and w that of the loop
width. A relaxation time that is r times as long is a clock that runs r times as slowly.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import identify
from hysteresis import InputError, Record
from hysteresis.records._loads import kind_of_units

LEVELS = 60
"""Inputs at which the middle line is taken."""
MOVES = 1e-3
"""Of the output's range: a relaxation time that changes less than this is not in the model."""
SLOWER = 3.0
"""Factor by which a slider makes a stiffness or a time smaller or larger, and a loop wider."""
FAR = 1e3
"""No factor is larger, or smaller than its inverse."""

STIFFNESS, WIDTH, TIME = "stiffness", "loop width", "relaxation time"


def judged(fit: identify.FitResult) -> Record:
    """The record whose loop is shown: the held-out one, where there is one."""
    return fit.train if fit.test is None else fit.test


def handles_of(fit: identify.FitResult) -> list[dict[str, Any]]:
    """The sliders that a fit has: name, value, unit, ends, and whether the slider is logarithmic."""
    told = {one.name: (one.value, one.unit) for one in fit.characteristics if one.value is not None}
    slope = "slope" if "slope" in told else STIFFNESS
    found = []
    for name, label in ((STIFFNESS, slope), (WIDTH, WIDTH), (TIME, TIME)):
        if (name == TIME and not _relaxes(fit)) or (name == WIDTH and WIDTH not in told):
            continue
        value, unit = told.get(label, (100.0, "percent"))
        ends = sorted((value / SLOWER, value * SLOWER))
        found.append(
            {
                "name": name, "label": label, "value": value, "unit": unit,
                "low": 0.0 if name == WIDTH else ends[0], "high": ends[1],
                "logarithmic": name != WIDTH and value > 0,
            }
        )  # fmt: skip
    return found


def reshaped(fit: identify.FitResult, record: Record, factors: Mapping[str, float]) -> np.ndarray:
    """(n,) the model's output with figures of its loop that are so many times as large.

    Raises `InputError` `unknown-parameter` for a figure without a slider, or a factor far from its ends.
    """
    for name, by in factors.items():
        least = 0.0 if name == WIDTH else 1 / FAR
        if name not in (STIFFNESS, WIDTH, TIME) or not least <= by <= FAR:
            raise InputError(
                "unknown-parameter", f"There is no slider {name!r:.60} at {by:g} times."
            )
    y = np.asarray(fit.predict(_slower(record, factors.get(TIME, 1.0))), float)
    stiffness, width = factors.get(STIFFNESS, 1.0), factors.get(WIDTH, 1.0)
    if kind_of_units(record) == "creep":
        stiffness = 1 / stiffness
    levels, middle = _middle(record, y)
    here, first = np.interp(record.input, levels, middle), np.interp(0.0, levels, middle)
    return first + stiffness * (here - first) + width * (y - here)


def _middle(record: Record, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs, and the mean there of the outputs of both branches."""
    levels = np.linspace(record.input.min(), record.input.max(), LEVELS)
    cell = np.rint(np.interp(record.input, levels, np.arange(LEVELS))).astype(int)
    means = []
    for way in (1, -1):
        rows = (record.branch == way) & np.isfinite(y)
        count, total = (np.bincount(cell[rows], x, LEVELS) for x in (None, y[rows]))
        there = np.flatnonzero(count)
        if there.size:
            means.append(np.interp(np.arange(LEVELS), there, total[there] / count[there]))
    return levels, np.mean(means, axis=0) if means else np.zeros(LEVELS)


def _relaxes(fit: identify.FitResult) -> bool:
    record = judged(fit)
    if record.time is None:
        return False
    one, other = (np.asarray(fit.predict(_slower(record, by)), float) for by in (1.0, SLOWER))
    return bool(np.nanmax(np.abs(one - other)) > MOVES * np.ptp(record.output[record.mask]))


def _slower(record: Record, by: float) -> Record:
    if record.time is None or by == 1.0:
        return record
    return replace(record, time=record.time[0] + (record.time - record.time[0]) / by)
