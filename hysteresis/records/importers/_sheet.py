"""What an importer hands on: named columns of cells or arrays, and what there is to say about them."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..._errors import InputError
from ..._note import Note
from .._cells import MISSING
from .._units import bare_unit, is_unit, spelled

MOST_FEET = 8
"""Lines below a table: a mean, a deviation, extremes."""

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|nan", re.IGNORECASE)


class Layout(NamedTuple):
    """How the rows of a text go on below the last one: cells between `separator`, "" for blanks.

    `plain`: they are those of a header and rows, so that empty cells and comments may come too.
    """

    separator: str
    plain: bool


@dataclass(frozen=True)
class Sheet:
    """The columns of a file before anything is made of them.

    **Arguments:**

    - `columns`: the cells of each, by name, all of one length n; numbers where the file has them.
    - `line`: (n,) the line of each row, from 1.
    - `units`: by column, where the file says them beside the header, as the file writes them; "" where it
      says that there is none.
    - `notes`: one for each thing that was done.
    - `decimal`: the sign its numbers are written with.
    - `layout`: how rows would go on, None where more than rows like these may follow.
    - `clock`: the time of the first row and from row to row, in seconds, and what says so.
    """

    columns: Mapping[str, Sequence[str] | np.ndarray]
    line: np.ndarray
    units: Mapping[str, str]
    notes: tuple[Note, ...]
    decimal: str = "."
    layout: Layout | None = None
    clock: tuple[float, float, str] | None = None


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with either decimal sign."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def trimmed(cells: Sequence[str]) -> list[str]:
    """A row without empty cells at its end."""
    end = len(cells)
    while end and not cells[end - 1].strip():
        end -= 1
    return list(cells[:end])


def feet_of(rows: Sequence[Sequence[str]], width: int) -> int:
    """How many of the last rows below a header of so many columns are none.

    Words alone, fewer than the columns: what a program says below its table. Or numbers behind a word, such
    as a mean or a maximum, in a column that holds numbers in all rows above.
    """
    first, labelled = len(rows), False
    while first and len(rows) - first <= MOST_FEET:
        cells = trimmed(rows[first - 1])
        numbers = sum(map(is_number, cells))
        label = cells[0] if numbers and not is_number(cells[0]) else ""
        if numbers and (label.lower() in MISSING or not re.search(r"[^\W\d_]", label)):
            break
        if not numbers and len(cells) >= min(width, 3):
            break
        first, labelled = first - 1, labelled or numbers > 0
    count = len(rows) - first
    # Words in the first column above are labels of rows, not of figures.
    words = labelled and not all(is_number(cell) for row in rows[:first] for cell in row[:1])
    return 0 if words or count > min(MOST_FEET, first) else count


def feet_left_out(lines: Sequence[int]) -> Note:
    """What is said of them."""
    said = f"Left out {len(lines)} lines at the end that are no rows, first line {lines[0]}."
    return Note("skipped", said)


def chosen_table(sizes: Sequence[int], table: int | None) -> int:
    """The place of the largest table, or of the one asked for, from 1. Raises `InputError` `bad-option`."""
    at = int(np.argmax(sizes)) if table is None else table - 1
    if not 0 <= at < len(sizes):
        problem = f"The file has {len(sizes)} tables, and table {table} is asked for."
        raise InputError("bad-option", problem, fix=f"--table 1 to {len(sizes)}.")
    return at


def units_of(cells: Sequence[str]) -> list[str] | None:
    """A row of units as written, one for each cell and "" for none, or None where it is no such row.

    Most of them are known, or all stand in brackets.
    """
    bare = [bare_unit(cell) for cell in cells]
    named = [unit for unit in bare if spelled(unit) != "1"]
    if not named or any(is_number(unit) for unit in named):
        return None
    known = sum(map(is_unit, named))
    bracketed = all(cell.strip()[:1] in "([" for cell in cells if cell.strip())
    return bare if 3 * known >= 2 * len(named) or (bracketed and len(named) > 1) else None


def distinct(names: Sequence[str], taken: Collection[str] = ()) -> list[str]:
    """Names of columns: numbered where empty, with a number behind where there twice."""
    found: list[str] = []
    for k, name in enumerate(names, 1):
        stem = " ".join(name.split()) or f"column {k}"
        other, n = stem, 1
        while other in found or other in taken:
            n += 1
            other = f"{stem} {n}"
        found.append(other)
    return found


def decimal_of(cells: Sequence[str]) -> str:
    """The decimal sign of these cells: a comma where some have one and none has a point."""
    commas = sum("," in cell for cell in cells if is_number(cell))
    return "," if commas and not any("." in cell for cell in cells if is_number(cell)) else "."


Group = Mapping[str, np.ndarray]
"""Arrays (n,) of numbers or words by name, of one length or of several."""


def sheet_of_arrays(
    groups: Mapping[str, Group],
    units: Mapping[str, str],
    said: str,
    column: str = "group",
    table: int | None = None,
) -> Sheet | None:
    """Groups of arrays as one sheet, None without an array of two values.

    The arrays of the commonest length are the columns of a group. Groups with the same columns are put
    under one another and told apart by `column`; of others the one with most rows is meant, or `table`.

    `units`: by the name of an array. `said`: the kind of file, for the notes.

    Raises `InputError` `bad-option` where there is no such table.
    """
    notes = [Note("format", f"Read as {said}.")]
    tables: dict[str, dict[str, np.ndarray]] = {}
    for name, arrays in groups.items():
        lengths = [len(x) for x in arrays.values() if len(x) > 1]
        if not lengths:
            continue
        rows = max(lengths, key=lambda n: (lengths.count(n), n))
        tables[name] = {key: x for key, x in arrays.items() if len(x) == rows}
        if other := {key: len(x) for key, x in arrays.items() if 1 < len(x) != rows}:
            left = ", ".join(f"{key!r} ({n})" for key, n in list(other.items())[:8])
            notes.append(Note("skipped", f"Left out arrays that have not {rows} values: {left}."))
    if not tables:
        return None
    families: dict[tuple[str, ...], list[str]] = {}
    for name, arrays in tables.items():
        families.setdefault(tuple(arrays), []).append(name)
    listed = list(families.items())
    sizes = [sum(len(tables[n][keys[0]]) for n in names) for keys, names in listed]
    at = chosen_table(sizes, table)
    keys, chosen = listed[at]
    names = distinct(keys)
    columns = {
        n: np.concatenate([tables[g][k] for g in chosen]) for n, k in zip(names, keys, strict=True)
    }
    if len(chosen) > 1:
        (label,) = distinct([column], names)
        runs = np.repeat(np.array(chosen), [len(tables[g][keys[0]]) for g in chosen])
        columns = {label: runs} | columns
        joined = f"Put {len(chosen)} groups under one another, told apart by {label!r}."
        notes.append(Note("joined", joined))
    if others := [name for name in tables if name not in chosen]:
        left = f"Left out groups with other channels: {', '.join(others)}. --table N reads one."
        notes.append(Note("skipped", left))
    written = {n: units[k] for n, k in zip(names, keys, strict=True) if units.get(k)}
    return Sheet(columns, np.arange(1, sizes[at] + 1), written, tuple(notes))
