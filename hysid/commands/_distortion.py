"""`hysid distortion`: how much of each output of a periodic test is linear, distortion and noise."""

from math import isfinite
from typing import Any

import numpy as np

from hysteresis import InputError, read_table
from hysteresis._quantities import conversion
from hysteresis._show import aligned
from hysteresis.records._table import Table, column_of
from hysteresis.records._units import named_unit
from identify import distortion, periodic_test
from identify.dynamics._measured_motion import even_clock
from identify.dynamics._periodic_tests import Distortion
from identify.internal import PeriodicTest

from ..intake._selection_options import OF_READING
from ._asked_more import Distortion as Asked
from ._console import Done

SHARES = ("linear", "changed", "even", "odd", "stochastic", "noise")


def run(asked: Asked) -> Done:
    """A row for each level, output and band: shares of the output's root mean square, in per cent."""
    selection = asked.selection
    table = read_table(asked.file, **{k: v for k, v in selection.items() if k in OF_READING})
    found = distortion(_tests(table, asked), asked.bands)
    document = {"schema": 1, "rows": [_told(one, asked.output[one.output]) for one in found]}
    head = ("input rms", "output", "band (Hz)", "rms", *(f"{name} (%)" for name in SHARES))
    rows: list[tuple[str, ...]] = [head]
    for one in document["rows"]:
        band = f"{one['band'][0]:.4g} to {one['band'][1]:.4g}"
        shares = ["-" if one[k] is None else f"{one[k]:.3g}" for k in SHARES]
        rows.append((f"{one['level']:.4g}", one["output"], band, f"{one['total']:.4g}", *shares))
    lines = [
        "Linear is the best linear approximation of each level, changed how far it is from that of the",
        "smallest one. Even and odd are told in lines that no input excites.",
    ]
    return Done(document, [*aligned(rows), *lines])


def _told(one: Distortion, output: str) -> dict[str, Any]:
    shares = {k: 100 * getattr(one, k) / one.total if one.total else np.nan for k in SHARES}
    known = {k: v if isfinite(v) else None for k, v in shares.items()}
    return {
        "level": one.level,
        "output": output,
        "band": list(one.band),
        "total": one.total,
        **known,
    }


def _tests(table: Table, asked: Asked) -> list[PeriodicTest]:
    """A test for each value of the grouping columns."""
    selection = asked.selection
    inputs = selection["input"] if isinstance(selection["input"], tuple) else (selection["input"],)
    if not asked.output:
        raise InputError("no-column", "no output column.", fix="name it (--output COL).")
    groups = selection.get("group") or ()
    for name in groups:
        column_of(table, name)  # which says what there is
    keys = np.array(["\t".join(row) for row in zip(*(table.text[g] for g in groups), strict=True)])
    keys = keys if len(groups) else np.zeros(len(table.line), str)
    found = []
    for key in dict.fromkeys(keys.tolist()):
        rows = np.flatnonzero(keys == key)
        u, y = (
            np.stack([_whole(table, name, rows) for name in names], 1)
            for names in (inputs, asked.output)
        )
        found.append(periodic_test(u, y, _step(table, asked, rows), asked.period, asked.settling))
    return found


def _step(table: Table, asked: Asked, rows: np.ndarray) -> float:
    """Seconds between rows."""
    dt, time = asked.selection.get("dt"), asked.selection.get("time")
    if dt is not None and not dt > 0:
        raise InputError("bad-option", f"--dt {dt:g}; a time between samples is above 0.")
    if dt is not None:
        return float(dt)
    if len(rows) < 2:
        raise InputError(
            "too-few-rows",
            "one row is not a period.",
            place=f"{table.path}, line {int(table.line[rows[0]])}",
            fix="name what tells one test from the next (--group COL), or leave this one out.",
        )
    t = None if time is None else _whole(table, time, rows)
    unit = "s" if time is None else named_unit(time, None, table.units.get(time)) or "s"
    seconds = conversion(unit, "s")
    if seconds is None:
        raise InputError(
            "wrong-unit",
            f"{time!r} is in {unit}, which is not a unit of time.",
            fix="name a column of times (--time COL), or give the step (--dt SECONDS).",
        )
    return even_clock(t, table.line[rows], unit) * seconds


def _whole(table: Table, name: str, rows: np.ndarray) -> np.ndarray:
    """A column without a gap."""
    x = table.number(name, rows)
    if np.isnan(x).any():
        line = int(table.line[rows][np.isnan(x)][0])
        raise InputError(
            "no-value",
            f"{name!r} has no number there.",
            place=f"{table.path}, line {line}",
            fix="a period needs every sample: measure it again, or leave this test out.",
        )
    return x
