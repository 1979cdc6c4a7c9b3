"""`hysid monitor`: the self-recalibrating compensator of a fit over a log."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import identify
from compensate import Status, adaptive
from compensate.recalibration._adaptive import AdaptiveCompensator, Advice, Recalibrated
from hysteresis import InputError, Record
from hysteresis._files import write_table
from hysteresis._format import number_of, quantity
from hysteresis.records._table import rows_read

from ..intake._selection import for_new_file, in_unit, selection_of_fit
from ._asked import Monitor
from ._console import Done, warnings

SAID = {
    Advice.NONE: "Nothing that was seen asks for a calibration now.",
    Advice.ZERO: "Recalibrate now: the zero has changed.",
    Advice.GAIN: "Recalibrate now: the gain has changed.",
    Advice.LOOP: "Recalibrate now: the width of the loop has changed.",
    Advice.SHAPE: "Measure and fit again: neither zero, gain nor width of the loop explains the errors.",
    Advice.STALE: "Recalibrate now: too much time has passed since the last reference.",
}
COLUMNS = ("status", "advice", "accuracy lost", "zero", "gain", "loop width")


def run(asked: Monitor) -> Done:
    """Run the self-recalibrating compensator of a fit over a log, and write what it finds beside the fit.

    References are the cells of a column, by default that of the fit's input; empty cells are none. `advice`
    is what holds at the end of the log, `found` each change with the line at which it was noticed.
    """
    folder, file, reference = asked.folder, asked.file, asked.reference
    document = identify.internal.read_document(folder)
    fitted_on = selection_of_fit(document)
    several = isinstance(fitted_on.input, tuple) or fitted_on.each or "condition" in document
    if fitted_on.is_step or several:
        said = "Only a fit of one input, without conditions or --each, can be monitored."
        fix = "Give the folder of one value's fit, or fit one input."
        raise InputError("bad-option", said, place=str(folder), fix=fix)
    selection = replace(fitted_on, **asked.selection).without_hold_out()
    source = selection.read(file)
    # The input is a reference here, and may have gaps: the readings stand for it in the record.
    selection = for_new_file(selection, source, inverse=True)[0]
    selection = replace(
        selection, input=selection.output if selection.output != fitted_on.input else fitted_on.output,
        output=fitted_on.output, input_unit=None,
    )  # fmt: skip
    record = selection.records(source)[0][""][0]
    fitted = identify.load(folder)
    identify.internal.check_units(fitted, record, "output")
    name, known = reference or str(fitted_on.input), np.full(len(record), np.nan)
    if reference is not None or name in source.columns:
        known = in_unit(source, name, fitted.train.input_unit)[rows_read(source, record)]
    own = adaptive(fitted.model, fitted.test or fitted.train, drift=asked.drift)
    parts, state = [], own.init()
    for _, rows in record.sequences():  # memories begin anew, and what was learnt stays
        t = None if record.time is None else record.time[rows]
        state, part = own.follow(t, record.output[rows], known[rows], own.restarted(state))
        parts.append(part)
    found: Recalibrated = jax.tree.map(lambda *each: jnp.concatenate(each), *parts)
    notes = []
    if not np.isfinite(known).any():
        notes.append("The log has no reference, so changes cannot be seen.")
    if lag := fitted.clocks.lag:
        notes.append(
            f"The fit removed a lag of {lag:.3g} {record.time_unit}; references are taken as they are."
        )
    target = folder / f"monitored-{file.stem}.csv"
    _write(target, record, known, found, str(fitted_on.input))
    document, lines = _summary(own, record, known, found, fitted.train)
    document |= {"notes": notes, "file": str(target)}
    return Done(document, [*warnings(notes, "Note"), *lines, str(target)])


def _summary(
    own: AdaptiveCompensator, record: Record, known: np.ndarray, found: Recalibrated, train: Record
) -> tuple[dict[str, Any], list[str]]:
    """The document, and lines for a reader."""
    unit, other = train.input_unit, train.output_unit
    error = (np.asarray(found.value) - known)[np.isfinite(known)]
    rmse = float(np.sqrt(np.mean(error**2))) if len(error) else None
    usual, last = float(own.settings["error"]), Advice(int(found.advice[-1]))
    lines = [SAID[last]]
    if rmse is not None:
        text = f"At {number_of(len(error), 'reference')} the error is {quantity(rmse, unit, 3)} rms"
        lines.append(f"{text}, and {quantity(usual, unit, 3)} of an unchanged sensor.")
    if last:
        lines.append(f"Accuracy lost until then: {quantity(float(found.lost[-1]), unit, 3)} rms.")
    events = list(_events(record, found))
    lines += [
        f"line {one['line']}: a change, most of it of the {one['reason'].lower()}; gain {one['gain']:.3g},"
        f" loop width {one['loop']:.3g} of the fit's, zero {quantity(one['zero'], other, 3)}, up to"
        f" {quantity(one['lost'], unit, 3)} rms lost"
        for one in events
    ]
    return {
        "advice": last.name, "lost": float(found.lost[-1]), "zero": float(found.zero[-1]),
        "gain": float(found.gain[-1]), "loop": float(found.loop[-1]), "found": events,
        "rows": len(record), "references": len(error),
        "rmse": rmse,
        "fit_error": usual,
        "flagged": int((np.asarray(found.status) != Status.OK).sum()),
    }, lines  # fmt: skip


def _events(record: Record, found: Recalibrated) -> Iterator[dict[str, Any]]:
    """Each change: where it was noticed, and what it was found to be by the end of learning."""
    count = np.asarray(found.changes)
    for k in np.flatnonzero(np.diff(count, prepend=0) > 0):
        after = np.arange(len(count)) >= k
        same = after & (count == count[k]) & np.isin(found.advice, (1, 2, 3, 4))
        stretch = np.flatnonzero(same)
        ends = np.flatnonzero(np.diff(stretch) > 1)
        stretch = stretch[: ends[0] + 1] if len(ends) else stretch
        end = stretch[-1] if len(stretch) else k
        yield {
            "line": int(record.line[k]),
            "time": None if record.time is None else float(record.time[k]),
            "reason": Advice(int(found.advice[end])).name,
            "lost": float(np.max(np.asarray(found.lost)[k : end + 1])),
            "zero": float(found.zero[end]), "gain": float(found.gain[end]), "loop": float(found.loop[end]),
        }  # fmt: skip


def _write(target: Path, record: Record, known: np.ndarray, found: Recalibrated, name: str) -> None:
    names = (record.time_name, record.output_name, f"known {name}", f"estimated {name}")
    keep = [True, record.time is not None, *(True,) * 9]
    words = [Status(int(s)).name for s in found.status], [Advice(int(a)).name for a in found.advice]
    cells = ["" if np.isnan(x) else x for x in known]
    time = known if record.time is None else record.time
    rows = zip(
        record.line, time, record.output, cells, found.value, *words,
        found.lost, found.zero, found.gain, found.loop, strict=True,
    )  # fmt: skip
    header, *shown = (list(compress(row, keep)) for row in [("line", *names, *COLUMNS), *rows])
    write_table(target, header, shown)
