"""What a record holds and what it is fit for: summary, excitation, warnings."""

from typing import Any

import numpy as np

from .._errors import InputError
from .._format import number_of, quantity
from .._note import Note, warning
from ._abstract_record import AbstractRecord
from ._arrays import in_rows
from ._change import change_warnings
from ._cycles import default_dead_band, noise_level, turning_points
from ._data_warnings import clipped, correlation, loop_direction, once, suspicions


def check_identifiable(record: AbstractRecord, n_parameters: int | None = None) -> list[Note]:
    """Can these rows tell a model's parameters? Returns warnings, each with its `code`, in which it ends.

    **Raises:** `InputError` `too-few-rows`, `constant-input`, `constant-output`, `no-excitation`.

    **Example:**

        >>> hysteresis.check_identifiable(record, n_parameters=3)
        []
    """
    u, unit, place = record.input, record.input_unit, record.source
    turns = check_rows(record, n_parameters)
    span, noise = float(np.ptp(u)) if len(u) else 0.0, _spread(record, "input")["noise"]
    if span == 0:
        problem = f"Input {record.input_name!r} is {quantity(u[0], unit)} in every row."
        mend = "choose another column (--input COL), or drive the rig."
        raise InputError("constant-input", problem, place=place, fix=mend)
    (counted,) = in_rows(record.mask & np.isfinite(record.output), record.output)
    if not np.ptp(counted):
        at = quantity(counted[0], record.output_unit)
        problem = f"Output {record.output_name!r} is {at} in every row; nothing to identify."
        mend = "choose another column (--output COL), or look at the sensor."
        raise InputError("constant-output", problem, place=place, cause="a dead channel?", fix=mend)
    # Steps drawn anew at every row look like noise, but the output follows them.
    if span < 10 * noise and abs(correlation(record)) < 0.5:
        problem = f"Input range {quantity(span, unit)} is about the noise; nothing to identify."
        raise InputError("no-excitation", problem, place=place, fix="drive the rig further.")
    found = []
    if all(np.ptp(record.branch[s]) == 0 for _, s in record.sequences()) and turns <= 1:
        way, other = ("rises", "un") if record.branch[0] > 0 else ("falls", "")
        said = (
            f"Input only {way}: no {other}loading branch, so nothing tells hysteresis from a curve; "
            "measure the way back."
        )
        found.append(warning("one-way-input", said))
    others = suspicions(record)
    # A zero that jumps moves, too, and so does one that is read for a while; either is told first.
    zeros = [note for note in others if note.code in ("zero-jump", "lost-contact")]
    first = zeros or change_warnings(record)
    found = [*first, *found, *(note for note in others if note not in first)]
    single = [x for x, s in record.sequences() if s.stop - s.start < 2]
    if single:
        said = f"{number_of(len(single), 'sequence')} of one row, first {single[0]!r}."
        found.append(warning("short-sequence", said))
    return found


def check_rows(record: AbstractRecord, n_parameters: int | None = None) -> float:
    """Are there rows enough to tell so many parameters? Returns the number of cycles of the input.

    **Raises:** `InputError` `too-few-rows`.
    """
    rows, needed = int(record.mask.sum()), n_parameters or 2
    turns = sum(_turns(record.input[s]) for _, s in record.sequences())
    if rows < max(8, needed + 1) or (rows < 10 * needed and turns < 1):
        asked = f"{n_parameters} parameters, " if n_parameters else ""
        problem = f"{rows} samples, {asked}{turns:.1f} cycle; need at least one loop."
        raise InputError(
            "too-few-rows", problem, place=record.source, fix="use more rows, or fix parameters."
        )
    return turns


@once
def summary(record: AbstractRecord) -> dict[str, Any]:
    """Rows, sequences, cycles, ranges, noise, clock, saturation and loop direction."""
    return {
        "source": record.source,
        "sha256": record.sha256,
        "rows": len(record),
        "rows_used": int(record.mask.sum()),
        "sequences": len(record.labels),
        "cycles": record.n_cycles,
        "input": _spread(record, "input"),
        "output": _spread(record, "output") | {"saturated": _saturated(record)},
        "conditions": [
            {"name": name, "unit": unit, "min": float(x.min()), "max": float(x.max())}
            for name, unit in record.conditions.items()
            if (x := record.columns[name]).size
        ],
        "dt": _clock(record),
        "loop_direction": loop_direction(record),
    }


def turn_in_words(record: AbstractRecord) -> str:
    """Which way the loops of a record turn, and whether the output lags or leads its input."""
    way, falls = loop_direction(record), correlation(record) < 0
    turn = "counter-clockwise" if way > 0 else "clockwise"
    # Where the output falls with the input, lagging loops turn clockwise.
    return turn + (": the output lags" if (way > 0) != falls else ": the output leads")


def describe(record: AbstractRecord, loop: str | None = None) -> str:
    """The summary for a reader, and the record's history; `loop` replaces the line about the loops."""
    s = summary(record)
    way, turn = s["loop_direction"], turn_in_words(record)
    lines = [
        f"{s['source'] or 'arrays'}: {s['rows']} rows ({s['rows_used']} count), "
        f"{number_of(s['sequences'], 'sequence')}, {number_of(s['cycles'], 'complete cycle')}"
    ]
    for role in ("input", "output"):
        x, unit = s[role], s[role]["unit"]
        lines.append(
            f"{role:6} {x['name']}: {x['min']:.4g} to {quantity(x['max'], unit)}, "
            f"noise {quantity(x['noise'], unit)}"
        )
    for x in s["conditions"]:
        lines.append(f"condition {x['name']}: {x['min']:.4g} to {quantity(x['max'], x['unit'])}")
    if s["dt"]:
        low, mid, high = (f"{s['dt'][k]:.4g}" for k in ("min", "median", "max"))
        lines.append(f"dt     {low} to {high}, median {mid} {record.time_unit}")
    if s["output"]["saturated"]:
        lines.append(f"clipped: {s['output']['saturated']:.1%} of the output")
    if loop is None:
        loop = f"loop   {way:+.2f} ({turn})" if way else "loop   none wider than the noise"
    lines.append(loop)
    return "\n".join([*lines, *record.history])


def _turns(u: np.ndarray) -> float:
    """Path length over twice the range: 1 for one loop, 1/2 for one ramp."""
    path = np.abs(np.diff(u[turning_points(u, default_dead_band(u))])).sum()
    return float(path / (2 * np.ptp(u))) if path else 0.0


def _clock(record: AbstractRecord) -> dict[str, Any] | None:
    """The steps of time within sequences, None where there is none."""
    if record.time is None:
        return None
    steps = np.diff(record.time)
    if len(record.starts) > 1:
        steps = np.delete(steps, record.starts[1:] - 1)
    if not steps.size:
        return None
    low, mid, high = np.quantile(steps, [0, 0.5, 1], overwrite_input=True).tolist()
    return {"min": low, "median": mid, "max": high, "unit": record.time_unit}


def _spread(record: AbstractRecord, role: str) -> dict[str, Any]:
    x = getattr(record, role)
    good = np.isfinite(x)
    (known,) = in_rows(good, x)
    low, high = (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)
    noise = float(np.median([noise_level(*in_rows(good[s], x[s])) for _, s in record.sequences()]))
    names = {"name": getattr(record, f"{role}_name"), "unit": getattr(record, f"{role}_unit")}
    return names | {"min": low, "max": high, "noise": noise}


def _saturated(record: AbstractRecord) -> float:
    """Share of the output's rows stuck at a limit."""
    stuck = [len(found.rows) for found in clipped(record) if found.role == "output"]
    return sum(stuck) / max(len(record), 1)
