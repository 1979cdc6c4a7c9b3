"""`hysid distortion`: how much of each output of a periodic test is linear, distortion and noise."""

from math import isfinite
from typing import Any

import numpy as np

from hysteresis import InputError
from hysteresis._show import aligned
from hysteresis.internal import conversion
from hysteresis.records._table import Table
from identify import distortion, periodic_test
from identify.dynamics._measured_motion import even_clock
from identify.dynamics._periodic_tests import Distortion
from identify.internal import PeriodicTest

from ..intake._selection import Selection
from ._asked_more import Distortion as Asked
from ._console import Done

SHARES = ("linear", "changed", "even", "odd", "stochastic", "noise")


def run(asked: Asked) -> Done:
    """A row for each level, output and band: shares of the output's root mean square, in per cent."""
    found = distortion(_tests(asked), asked.bands)
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


def _tests(asked: Asked) -> list[PeriodicTest]:
    """A test for each value of the grouping columns."""
    if not asked.output:
        raise InputError("no-column", "no output column.", fix="name it (--output COL).")
    selection = Selection(**asked.selection, output=asked.output[0])
    table = selection.read(asked.file)
    record = selection.records(table)[0][""][0]
    unit = record.time_unit if record.time_unit != "1" else "s"
    seconds = conversion(unit, "s")
    if seconds is None and record.time is not None:
        raise InputError(
            "wrong-unit",
            f"{record.time_name!r} is in {unit}, which is not a unit of time.",
            fix="name a column of times (--time COL), or give the step (--dt SECONDS).",
        )
    rows = np.searchsorted(table.line, record.line)
    u = np.column_stack([record.columns[name] for name in record.channels] or [record.input])
    y = np.column_stack([_whole(table, name, rows) for name in asked.output])
    found = []
    for _, part in record.sequences():
        t = None if record.time is None else record.time[part]
        dt = even_clock(t, record.line[part], unit) * (seconds or 1.0)
        found.append(periodic_test(u[part], y[part], dt, asked.period, asked.settling))
    return found


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
