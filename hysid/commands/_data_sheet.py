"""`hysid datasheet`: the runs of a sensor in files, and its data sheet as a page."""

from collections.abc import Mapping

import numpy as np

import identify
from hysteresis import InputError, Record
from hysteresis.records._excitation import suspicions
from hysteresis.records._loop_cut import loop_rows
from hysteresis.records._loop_table import left_out

from ..intake._selection import Selection
from ..reporting._report import write_data_sheet
from ._asked_more import Datasheet
from ._console import Done, warnings

SUFFIXES = (".html", ".pdf")


def run(asked: Datasheet) -> Done:
    """Read the runs, write both pages, and print the lines."""
    selection = Selection(**asked.selection).without_hold_out()
    selection.check_columns()
    first = asked.files[0]
    page = asked.out or first.with_name(f"{first.stem}-datasheet")
    if page.suffix.lower() in SUFFIXES:
        page = page.with_suffix("")
    places = [page.with_name(f"{page.name}{suffix}") for suffix in SUFFIXES]
    for place in places:
        identify.internal.check_free(place.parent, asked.overwrite, place.name)
    runs: dict[str, Record] = {}
    for file in asked.files:
        runs[str(file)] = selection.records(selection.read(file))[0][""][0]
    record = _joined(runs)
    sheet = identify.data_sheet(record)
    for place in places:
        write_data_sheet(sheet, place)
    said = [f"{name}: {note.text}" for name, run in runs.items() for note in suspicions(run)]
    if left := len(loop_rows(record).first) - len(sheet.rising):
        said.append(left_out(left))
    return Done(
        sheet.document() | {"files": [str(place) for place in places], "warnings": said},
        [*str(sheet).split("\n"), *warnings(said), f"Pages: {', '.join(map(str, places))}"],
    )


def _joined(runs: Mapping[str, Record]) -> Record:
    """The runs of several files as one record. Raises `InputError` `wrong-unit` where they differ."""
    records = [*runs.values()]
    one = records[0]
    if len(records) == 1:
        return one
    same = ("time_unit", "input_name", "output_name", "input_unit", "output_unit")
    for name, other in runs.items():
        alike = [getattr(one, k) == getattr(other, k) for k in same if k.endswith("unit")]
        alike.append((one.time is None) == (other.time is None))
        if not all(alike) or dict(one.conditions) != dict(other.conditions):
            raise InputError(
                "wrong-unit", f"{name} has other units, or another clock, than {next(iter(runs))}."
            )

    def whole(name: str) -> np.ndarray:
        return np.concatenate([getattr(r, name) for r in records])

    labels = [f"{name} {label}" for name, r in runs.items() for label in r.labels]
    lengths = [rows.stop - rows.start for r in records for _, rows in r.sequences()]
    return Record.from_arrays(
        whole("input"), whole("output"), None if one.time is None else whole("time"),
        np.repeat(labels, lengths), mask=whole("mask"), source=f"{len(records)} files",
        columns={n: np.concatenate([r.columns[n] for r in records]) for n in one.conditions},
        conditions=one.conditions, **{k: getattr(one, k) for k in same},
    )  # fmt: skip
