"""Columns of a spectrum: moduli over frequency, or over time in runs at several temperatures."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hysteresis._quantities import conversion
from hysteresis.records._column_quantity import OSCILLATION, words_of
from hysteresis.records._units import UNITS

from .._constant_input import RATIO, turns_back
from ._column_pairs import Column

if TYPE_CHECKING:
    from ._guess import Guess

LOSS = re.compile(r"loss|perte|verlust|viscous|^[EG](''|\"|″|2\b)", re.IGNORECASE)
WHOLE = re.compile(r"complex|\*|^\|", re.IGNORECASE)
SPAN = 3.0
"""The factor that a sweep's frequencies cover, at least: less does not tell a spectrum."""
STANDS = 0.5
"""Share of the rows with the frequency of the row before, up to which a sweep is one of frequencies."""
RANGE = 2.0
"""Kelvins by which a temperature has to differ to be a condition; within a run it differs by less."""
ROWS = 3
"""Of a run over time, at least."""
RESPONSES = ("modulus", "compliance")
"""Kinds of what a unit step gives, over time."""


def moduli_of(columns: Mapping[str, Column], given: Mapping[str, Any], out: "Guess") -> bool:
    """Notes the columns of a frequency sweep in `out`; whether the table holds one."""
    moduli = [c for c in columns.values() if c.kind.name == OSCILLATION]
    ratios = [c for c in moduli if RATIO.search(c.name)]
    parts = [c for c in moduli if c not in ratios and not WHOLE.search(c.name)]
    losses = [c for c in parts if LOSS.search(c.name)]
    storage = next((c for c in parts if c not in losses), None)
    if storage is None:
        return False
    # E'' belongs to E', and not to G'.
    alike = [c for c in losses if c.unit == storage.unit or conversion(c.unit, storage.unit)]
    loss = next(iter(sorted(alike, key=lambda c: c.name[:1] != storage.name[:1]) + ratios), None)
    there = np.isfinite(storage.x)
    sweeps = [c for c in columns.values() if _is_sweep(c, there)]
    if not sweeps:
        return False
    frequency = max(sweeps, key=lambda c: int((np.isfinite(c.x) & there).sum()))
    chosen = {"frequency": frequency, "output": storage} | ({} if loss is None else {"loss": loss})
    hot = next((c for c in columns.values() if _varies(c, there)), None)
    _noted(chosen, hot, given, out)
    return True


def runs_of(columns: Mapping[str, Column], given: Mapping[str, Any], out: "Guess") -> bool:
    """Notes the columns of creep or relaxation at several temperatures in `out`; whether there are such.

    Of each temperature there is a run: its times begin anew, upwards or downwards. Where a column names the
    runs and times rise, each is fitted alone.
    """
    for response in (c for c in columns.values() if c.kind.name in RESPONSES):
        there = np.isfinite(response.x)
        hot = next((c for c in columns.values() if _varies(c, there)), None)
        for clock in (c for c in columns.values() if c.kind.name == "time"):
            rows = there & np.isfinite(clock.x)
            t = clock.x[rows]
            if hot is None or len(t) < 2 * ROWS or t.max() < SPAN * max(t.min(), 0.0):
                continue
            cuts = 1 + np.flatnonzero(turns_back(t))
            runs = np.split(hot.x[rows], cuts)
            steady = [len(run) >= ROWS and np.ptp(run) <= RANGE for run in runs]
            if len(runs) > 1 and all(steady):
                rising = all((np.diff(run) > 0).all() for run in np.split(t, cuts))
                others = (c for c in columns.values() if c not in (response, hot, clock) and rising)
                named = next((c for c in others if _names(np.split(c.x[rows], cuts))), None)
                _noted({"time": clock, "output": response}, None if named else hot, given, out)
                if named is not None:
                    why = f"it names the runs; --condition '{hot.name}' shifts them to one curve instead"
                    out.selection["each"] = named.name
                    out.says("each", named.name, "likely", why)
                out.selection["step"] = given.get("step") or 1.0
                out.says("step", out.selection["step"], "likely", WHY["step"])
                return True
    return False


def _names(runs: list[np.ndarray]) -> bool:
    """Whether a column has one value in each run, and another one in every other."""
    return all(np.ptp(run) == 0 for run in runs) and len({run[0] for run in runs}) == len(runs)


def _noted(
    chosen: Mapping[str, Column], hot: Column | None, given: Mapping[str, Any], out: "Guess"
) -> None:
    """What the columns are, in `out`, in place of a clock and of groups."""
    for key in ("time", "group"):
        out.selection.pop(key, None)
    out.found = [one for one in out.found if one.what not in ("time", "group")]
    for key, column in chosen.items():
        out.selection[key] = given.get(key) or column.name
        unit = "no unit" if column.unit == "1" else column.unit
        why = WHY["step" if key == "output" and "time" in chosen else key]
        out.says(key, out.selection[key], "likely", f"{column.kind.name}, {unit}; {why}")
    if hot is not None:
        out.selection["condition"] = [hot.name]
        why = "it differs between the runs: their times are shifted"
        out.says("condition", hot.name, "likely", why)


WHY = {
    "frequency": "each row is the result of an oscillation at it",
    "output": "storage modulus",
    "time": "it begins anew in each run",
    "step": "the rows answer a unit step",
    "loss": "loss modulus, or its ratio to the storage modulus",
}


def _is_sweep(column: Column, there: np.ndarray) -> bool:
    named = {"frequency", "freq", "omega"} & {*words_of(column.name)}
    x = column.x[there & np.isfinite(column.x)]
    if not (named or column.unit in UNITS["frequency"]) or len(x) < 4 or x.min() <= 0:
        return False
    return bool(x.max() >= SPAN * x.min() and np.mean(np.diff(x) == 0) <= STANDS)


def _varies(column: Column, there: np.ndarray) -> bool:
    x = column.x[there & np.isfinite(column.x)]
    return column.kind.name == "temperature" and len(x) > 1 and float(np.ptp(x)) > RANGE
