"""`hysid loops`: the figures of every loop of a file, and the same as a table for other programs."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from hysteresis import InputError, LoopTable
from hysteresis._atomic_file import write_whole

from ..intake._selection import Selection, all_of
from ._asked_more import Loops
from ._console import Done


def run(asked: Loops) -> Done:
    """The table of each record of the file, with its summary first."""
    selection = Selection(**asked.selection).without_hold_out()
    selection.check_columns()
    records, faults = selection.records(selection.read(asked.file))
    if not records:
        raise all_of(faults)
    found = {value: record.loops(asked.kind) for value, (record, _) in records.items()}
    lines = [f"{selection.each} = {v} cannot be used: {e}" for v, e in faults.items()]
    for value, table in found.items():
        lines += [f"{selection.each} = {value}"] * bool(value) + [*table.lines()]
    if asked.csv is not None:
        _write(asked.csv, found, selection.each or "")
        lines.append(f"Table: {asked.csv}")
    each = {value: table.document() for value, table in found.items()}
    if "" in each:
        return Done(each[""], lines)
    return Done({"each": each, "failed": {v: str(e) for v, e in faults.items()}}, lines)


def _write(file: Path, found: Mapping[str, LoopTable], each: str) -> None:
    """One table of all records, a row a loop; raises `InputError` `cannot-write`."""
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    heads: list[str] = []
    for value, table in found.items():
        columns = table.columns()
        if [*columns] != heads:
            heads = [*columns]
            writer.writerow([each] * bool(value) + heads)
        writer.writerows(
            [value] * bool(value) + [*row] for row in zip(*columns.values(), strict=True)
        )
    try:
        write_whole(file, page.getvalue())
    except OSError as error:
        raise InputError(
            "cannot-write",
            f"{file.name} cannot be written: {error.strerror}.",
            place=str(file.parent),
        ) from error
