"""The columns of a fit, and the same ones in another file."""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from hysteresis import InputError
from hysteresis._quantities import conversion
from hysteresis.records._table import Table
from hysteresis.records._units import named_unit

from ._constant_input import CONSTANT
from ._selection import Pair, Selection, all_of


def in_unit(table: Table, name: str, wanted: str) -> np.ndarray:
    """A column in a unit, unchanged if either unit is "1". Raises `InputError` `wrong-unit`."""
    unit = named_unit(name, None, table.units.get(name)) or "1"
    factor = 1.0 if "1" in (unit, wanted) else conversion(unit, wanted)
    if factor is None:
        said = f"Column {name!r} is in {unit}, not in a unit like {wanted}."
        raise InputError("wrong-unit", said, place=table.path, fix="Correct its header.")
    return factor * table.number(name)


def selection_of_fit(document: dict[str, Any]) -> Selection:
    """The columns a fit was made from; a fit saved from Python knows their names alone."""
    try:
        if "selection" in document:
            return Selection.from_json(document["selection"])
        words = document["records"]["train"]
        time = words["time_name"] if words["time_unit"] != "1" else None
        channels = "channels" in document
        names = tuple(document["channels"]["names"]) if channels else words["input_name"]
        return Selection(names, words["output_name"], time)
    except (KeyError, TypeError) as error:
        raise InputError(
            "damaged-file",
            f"fit.json does not say which columns were fitted: {type(error).__name__} {error}.",
            cause="fit.json was edited.",
            fix="Fit again.",
        ) from error


def for_new_file(
    selection: Selection, table: Table, inverse: bool
) -> tuple[Selection, bool, list[str]]:
    """The fit's selection on a file that may lack columns: (selection, comparable, what was said).

    Without the column that is predicted nothing is compared; conditions and groups of columns that
    are not there are let go, and so are excluded lines, which are those of the fitted file. The driving
    column, the clock and `each` have to be there.
    """
    driving, wanted = selection.input or CONSTANT, selection.output
    if inverse:
        driving, wanted = wanted, driving
    first = driving[0] if isinstance(driving, tuple) else driving
    columns = table.columns
    where = tuple(c for c in selection.where if c.partition("=")[0].strip() in columns)
    group = tuple(column for column in selection.group if column in columns)
    said = [
        f"The file has no column for {c!r}, so every row is used."
        for c in selection.where
        if c not in where
    ]
    if lost := [column for column in selection.group if column not in group]:
        said.append(
            f"The file has no column {', '.join(lost)}, so its sequences are not separated by it."
        )
    selection = replace(
        selection, where=where, group=group, exclude_lines=(), rezero=(), branch=None, range=(),
        turn=tuple(column for column in selection.turn if column in columns),
        known=selection.known if wanted in columns else None,
        sigma=selection.sigma if selection.sigma in columns else None,
    )  # fmt: skip
    if selection.is_step:
        if inverse or wanted in columns or selection.time is None:
            return selection, True, said
        return replace(selection, output=selection.time, output_unit=None), False, said
    if wanted in columns or first not in columns:
        return selection, True, said
    alone = replace(selection, input=driving, output=first, input_unit=None, output_unit=None)
    return alone, False, said


def known_records(selection: Selection, table: Table, folders: Collection[str]) -> dict[str, Pair]:
    """The records of a new file by those values of `each` that were fitted.

    Raises the fault of one of these, and `InputError` `no-match` where the file has none of them.
    """
    records, faults = selection.records(table)
    if faults := {value: error for value, error in faults.items() if value in folders}:
        raise all_of(faults)
    if known := {value: pair for value, pair in records.items() if value in folders}:
        return known
    raise InputError(
        "no-match",
        f"The file has no value of {selection.each or 'a specimen'} that was fitted: {', '.join(folders)}.",
        place=str(table.path),
        fix="" if selection.each else "Name the folder of one specimen, DIR/NAME.",
    )
