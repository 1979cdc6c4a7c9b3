"""`hysid distortion`: how much of each output of a periodic test is linear, distortion and noise."""

from typing import Any

import numpy as np

from hysteresis import InputError
from hysteresis._show import aligned
from hysteresis.internal import conversion
from hysteresis.records._table import Table, rows_read
from identify import distortion, periodic_test
from identify.dynamics._measured_motion import even_clock
from identify.internal import PeriodicTest

from ..intake._selection import Selection
from ._asked_more import Distortion
from ._console import Done

SHARES = ("linear", "changed", "even", "odd", "stochastic", "noise")


def run(asked: Distortion) -> Done:
    """A row for each level, output and band: shares of the output's root mean square, in per cent."""
    told: list[dict[str, Any]] = []
    rows = [["input rms", "output", "band (Hz)", "rms", *(f"{name} (%)" for name in SHARES)]]
    for one in distortion(_tests(asked), asked.bands):
        shares = {k: 100 * getattr(one, k) / one.total if one.total else np.nan for k in SHARES}
        output, (low, high) = asked.output[one.output], one.band
        told.append(
            {
                "level": one.level, "output": output, "band": one.band, "total": one.total, **shares,
                "smoothed": one.smoothed,
            }
        )  # fmt: skip
        cells = ("-" if np.isnan(share) else f"{share:.3g}" for share in shares.values())
        band = f"{low:.4g} to {high:.4g}"
        rows.append([f"{one.level:.4g}", output, band, f"{one.total:.4g}", *cells])
    lines = [
        "Linear is the best linear approximation of each level, changed how far it is from that of the",
        "smallest one. Even and odd are told in lines that no input excites. A straight drift over the",
        "periods of a test is left out.",
    ]
    if any(row["smoothed"] for row in told):
        lines += [
            "Some level has fewer than two realisations an input: what is not smooth over some lines, such",
            "as a sharp resonance, counts as stochastic. Measure more (other phases), told by --group.",
        ]
    return Done({"schema": 1, "rows": told}, [*aligned(rows), *lines])


def _tests(asked: Distortion) -> list[PeriodicTest]:
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
    rows = rows_read(table, record)
    u = np.column_stack([record.columns[name] for name in record.channels] or [record.input])
    y = np.column_stack([_whole(table, name, rows) for name in asked.output])
    found = []
    for _, part in record.sequences():
        t = None if record.time is None else record.time[part]
        dt = even_clock(t, record.line[part], unit) * (seconds or 1.0)
        found.append(periodic_test(u[part], y[part], dt, asked.period))
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
