"""`hysid loops`: the figures of every loop of a file, and the same as a table for other programs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hysteresis._files import telling, write_table
from hysteresis._show import aligned
from hysteresis.records._excitation import suspicions
from hysteresis.records._loop_table import MAIN, NO_LOOP, LoopTable, left_out

from ..intake._selection import Selection
from ..reporting._specimens import FAR, FEW, deviations
from ._asked_more import Loops
from ._console import Done, warnings


def run(asked: Loops) -> Done:
    """The table of the file's record, or a row for each value of `each`."""
    selection = Selection(**asked.selection).without_hold_out()
    selection.check_columns()
    records, faults = selection.records(selection.read(asked.file))
    found = {value: record.loops(asked.kind) for value, (record, _) in records.items()}
    each, wrote = selection.each or "file", []
    if asked.csv is not None:
        _write(asked.csv, found, each)
        wrote = [f"Table: {asked.csv}"]
    said = {value: [note.text for note in suspicions(r)] for value, (r, _) in records.items()}
    if "" in found:
        document = found[""].document() | {"warnings": said[""]}
        return Done(document, [*found[""].lines(), *warnings(said[""]), *wrote])
    lines = [f"{each} = {v} cannot be used: {e}" for v, e in faults.items()]
    if left := int(sum((~table.full).sum() for table in found.values())):
        lines.append(left_out(left))
    document, rows = _specimens(found, each)
    document |= {"each": {value: table.document() for value, table in found.items()}}
    document |= {"failed": {value: str(error) for value, error in faults.items()}}
    lines += [one for v, own in said.items() for one in warnings(own, f"Warning, {each} = {v}")]
    if any(one["outliers"] for one in document["specimens"].values()):
        lines.append(f"* is further from the median than {FAR} robust standard deviations.")
    table = aligned(rows) if document["specimens"] else [NO_LOOP]
    return Done(document, [*table, *lines, *wrote])


def _specimens(
    found: Mapping[str, LoopTable], each: str
) -> tuple[dict[str, Any], list[tuple[str, ...]]]:
    """A row a specimen: its mean figures, with a star where one is apart; then their mean and spread."""
    columns, told = [(each, *found, "mean", "spread")], {}
    for name in MAIN:
        have = [{one.name: one for one in table.summary}.get(name) for table in found.values()]
        x = np.array([np.nan if one is None or one.value is None else one.value for one in have])
        known = x[np.isfinite(x)]
        if not len(known):
            continue
        apart = np.zeros(len(x), bool)
        if len(known) >= FEW:
            apart[np.isfinite(x)] = np.abs(deviations(known, np.zeros(len(known)))) > FAR
        mean, spread = known.mean(), np.std(known, ddof=1) if len(known) > 1 else np.nan
        unit = next(one.unit for one in have if one is not None)
        outliers = [value for value, is_apart in zip(found, apart, strict=True) if is_apart]
        told[name] = {"mean": mean, "spread": spread, "unit": unit, "outliers": outliers}
        cells = [
            f"{value:.4g}{' *' * bool(star)}" if np.isfinite(value) else "-"
            for value, star in zip(x, apart, strict=True)
        ]
        head = name if unit == "1" else f"{name} ({unit})"
        columns.append((head, *cells, f"{mean:.4g}", f"{spread:.2g}"))
    return {"specimens": told}, [*zip(*columns, strict=True)]


def _write(file: Path, found: Mapping[str, LoopTable], each: str) -> None:
    """One table of all records, a row a loop; raises `InputError` `cannot-write`."""
    columns = {value: table.columns() for value, table in found.items()}
    names = [each, *next(iter(columns.values()))]
    rows = (
        [value, *row] for value, own in columns.items() for row in zip(*own.values(), strict=True)
    )
    with telling(file):
        write_table(file, names, rows)
