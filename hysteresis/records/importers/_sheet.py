"""What an importer hands on: named columns of cells or arrays, and what there is to say about them."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from ..._errors import InputError
from ..._note import Note
from .._arrays import times
from .._cells import MISSING
from .._units import bare_unit, is_unit, spelled, written_unit

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


class Piece(NamedTuple):
    """A table, or one of several with the same columns.

    Names of columns and their units ("" for none), cells or numbers of each, the line of each row, what
    it is called, the lines within it that are no row, and where it is, for messages.
    """

    header: tuple[str, ...]
    units: tuple[str, ...]
    columns: Sequence[Sequence[str] | np.ndarray]
    line: Sequence[int] | np.ndarray
    label: str = ""
    skipped: Sequence[int] = ()
    place: str = ""


def joined(
    pieces: Sequence[Piece], said: str, column: str, table: int | None = None
) -> Sheet | None:
    """Pieces as one sheet, None without any.

    Those with the same columns are put under one another and told apart by `column`, of others the ones
    with most rows are meant, or `table`. `said`: what they are read as.

    Raises `InputError` `bad-option` where there is no such table.
    """
    families: dict[tuple, list[Piece]] = {}
    for piece in pieces:
        families.setdefault((piece.header, piece.units), []).append(piece)
    # One row of numbers under a line of text is a note, where the file has a table.
    some = [f for f in families.values() if len(f) > 1 or len(f[0].line) > 1]
    listed = some or list(families.values())
    if not listed:
        return None
    sizes = [sum(len(piece.line) for piece in family) for family in listed]
    at = chosen_table(sizes, table)
    chosen = listed[at]
    notes = [Note("format", f"Read as {said.format(line=chosen[0].line[0])}.")]
    if skipped := [k for piece in chosen for k in piece.skipped]:
        left = f"Left out {len(skipped)} lines that are no row, first line {skipped[0]}."
        notes.append(Note("skipped", left))
    joint: list[Any] = [
        np.concatenate(parts) if isinstance(parts[0], np.ndarray) else [*chain(*parts)]
        for parts in zip(*(piece.columns for piece in chosen), strict=True)
    ]
    # Columns without any cell are an end of line in the export, not a measurement.
    kept = [k for k, x in enumerate(joint) if isinstance(x, np.ndarray) or any(x)]
    header, units = chosen[0].header, chosen[0].units
    names = distinct([header[k] for k in kept])
    columns = {name: joint[k] for name, k in zip(names, kept, strict=True)}
    if len(chosen) > 1:
        (name,) = distinct([column], names)
        labels = [piece.label for piece in chosen]
        good = all(labels) and len(set(labels)) == len(labels)
        labels = labels if good else [str(k) for k in range(1, len(labels) + 1)]
        rows = [len(piece.line) for piece in chosen]
        columns = {name: np.repeat(labels, rows)} | columns
        told = f"Put {len(chosen)} tables under one another, told apart by {name!r}."
        notes.append(Note("joined", told))
    if len(listed) > 1:
        others = ", ".join(
            f"{k} ({n} rows {family[0].place})"
            for k, (n, family) in enumerate(zip(sizes, listed, strict=True), 1) if k != at + 1
        )  # fmt: skip
        left = f"Left out {sum(sizes) - sizes[at]} rows of other tables in the file; this is table"
        notes.append(Note("skipped", f"{left} {at + 1}, others are {others}. --table N reads one."))
    # Where a row has units, words in brackets behind a name are not units.
    stated = any(units)
    written = {
        name: units[k] for name, k in zip(names, kept, strict=True)
        if units[k] or (stated and written_unit(header[k], None))
    }  # fmt: skip
    line = np.concatenate([np.asarray(piece.line) for piece in chosen])
    return Sheet(columns, line, written, tuple(notes))


def sheet_of_arrays(
    groups: Mapping[str, Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    said: str,
    table: int | None = None,
) -> Sheet | None:
    """Groups of arrays (n,) of numbers or words as one sheet, None without an array of two values.

    The arrays of the commonest length are the columns of a group; see `joined`. `units`: by the name of an
    array.
    """
    pieces, notes = [], []
    for name, arrays in groups.items():
        lengths = [len(x) for x in arrays.values() if len(x) > 1]
        if not lengths:
            continue
        rows = max(lengths, key=lambda n: (lengths.count(n), n))
        own = {key: x for key, x in arrays.items() if len(x) == rows}
        stamps = {key: times(x) for key, x in own.items() if x.dtype.kind == "M"}
        own |= stamps
        names = {key: units.get(key) or written_unit(key, None) or "" for key in own}
        known = tuple((names | dict.fromkeys(stamps, "s")).values())
        line, place = np.arange(1, rows + 1), f"of {name!r}"
        pieces.append(Piece(tuple(own), known, [*own.values()], line, name, (), place))
        if other := {key: len(x) for key, x in arrays.items() if 1 < len(x) != rows}:
            left = ", ".join(f"{key!r} ({n})" for key, n in list(other.items())[:8])
            notes.append(Note("skipped", f"Left out arrays that have not {rows} values: {left}."))
    sheet = joined(pieces, said, "group", table)
    if sheet is None:
        return None
    rows = np.arange(1, len(sheet.line) + 1)
    return replace(sheet, line=rows, notes=(*sheet.notes, *notes))
