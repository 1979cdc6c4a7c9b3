"""The table of a text that is more than a header and rows: notes, units, pieces, blanks, or no names."""

import csv
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ..._verdict import Note
from .._arrays import floats
from ._blocks import Block, blocks, headers, mostly, nameless, padded, period_of, sheet_of, worth_of
from ._notes import OTHER, Lines, dialect_of, is_numbered, maker_of
from ._sheet import Layout, Sheet, distinct, fault, is_number, trimmed

_LOOK = 400
"""Lines from which the separator and the dialect are found."""
_SETTINGS = 6
"""A table of fewer rows lists settings or results: no loop has so few."""


def arranged(
    path: Path,
    lines: Lines,
    decimal: str = ".",
    above: Sequence[str] = (),
    own: str | Path | None = None,
    table: int | None = None,
) -> Sheet | None:
    """The table of a text that does not begin with its header, or None where it does.

    `above`: the comments above the first line. `own`: a file of dialects. Tables side by side with the
    same names are put under one another as well.

    Raises `InputError` `no-rows` for what a dialect knows to hold no record, and as `dialect_of` and
    `sheet_of` do.
    """
    head = "\n".join(line for _, line in lines[:_LOOK])
    dialect = dialect_of(head, own)
    if dialect.refuse:
        problem = f"this is {dialect.name}: {dialect.refuse}."
        raise fault("no-rows", path, problem, "export the measured values.")
    if dialect.begins is not None:
        at = next((k for k, (_, line) in enumerate(lines) if dialect.begins.search(line)), -1)
        lines = lines[at + 1 :]
    if not lines:
        raise fault("no-rows", path, f"this is {dialect.name} with a header and no rows.")
    separator, split = splitter([line for _, line in lines[:_LOOK]])
    first = [(k, split(line)) for k, line in lines[:_LOOK]]
    first = first if separator else _under_names(first, lines)
    plain = not (
        dialect.sure or separator == "" or table or _begins_late(first) or period_of(first[0][1])
    )
    listed = is_numbered(lines[0][1]) and not headers(first)
    bare = bool(dialect.names) or _all_numbers(first[0][1]) or listed
    if plain and not bare:
        return None
    rows = [*first, *((k, split(line)) for k, line in lines[_LOOK:])]
    found = [] if bare else blocks(rows)
    found = found or nameless(rows, dialect, above, head)
    sheet = sheet_of(found, dialect, decimal, table)
    if sheet is not None and len(sheet.line) < _SETTINGS and maker_of(head):
        without_table(path, lines)
    if sheet is not None and "column 1" in found[0].header:
        sheet = _unnamed(sheet)
    if sheet is None and dialect.sure:
        raise fault("no-rows", path, f"this is {dialect.name} without a table of numbers.")
    if sheet is not None and len(found) == 1 and _goes_on(found[0], sheet, lines[-1][0]):
        sheet = replace(sheet, layout=Layout(separator, plain=False))
    return sheet


def _goes_on(block: Block, sheet: Sheet, last: int) -> bool:
    """Whether a text's only table takes up each cell, and all lines from its first row to its `last`."""
    whole = block.line[-1] - block.line[0] == len(block.line) - 1 and block.line[-1] == last
    return whole and not block.skipped and len(sheet.columns) == len(block.header)


def without_table(path: Path, lines: Lines) -> None:
    """Raise `InputError` `no-rows` for a text that names its maker and holds no table of a few rows."""
    maker = maker_of("\n".join(line for _, line in lines[:_LOOK]))
    if not maker:
        return
    _, split = splitter([line for _, line in lines[:_LOOK]])
    found = blocks([(k, split(s)) for k, s in lines])
    if max((len(block.rows) for block in found), default=0) < _SETTINGS:
        problem = (
            f"this is a file of {maker} without a table of numbers: settings or results alone."
        )
        raise fault("no-rows", path, problem, "export the measured values.")


def _unnamed(sheet: Sheet) -> Sheet:
    first = ", ".join(cells[0] for cells in list(sheet.columns.values())[:8])
    said = f"The file has no header (its first row is {first}): columns are named by their place."
    return replace(sheet, notes=(Note("no-header", said), *sheet.notes))


def _begins_late(rows: list[tuple[int, list[str]]]) -> bool:
    """Whether more stands above the numbers than a header and a row of units as wide as they are."""
    head = next(iter(headers(rows)), None)
    if head is None:
        return False
    if head.start == 0:
        return head.first > 1 + bool(head.units)
    if head.first == 2:  # a row of odd units is as wide as the header above it
        wide = len(trimmed(rows[0][1])) == len(trimmed(rows[2][1])) and len(head.names) > 1
        return not wide or worth_of(head.names)[0] > 1
    return True


def _under_names(rows: list[tuple[int, list[str]]], lines: Lines) -> list[tuple[int, list[str]]]:
    """Rows set with blanks, in which a row between names and numbers with fewer cells than these has its
    cells under the names that they stand under."""
    found = list(rows)
    for at in range(1, len(rows) - 1):
        width = len(rows[at + 1][1])
        if len(rows[at][1]) >= width or not _all_numbers(rows[at + 1][1]):
            continue
        spans = [_spans(lines[at - 1][1], form) for form in (r"\S+(?: \S+)*", r"\S+")]
        names = next((span for span in spans if len(span) == width), [])
        cells = _spans(lines[at][1], r"\S+")
        if not names:
            continue
        places = [
            min(range(width), key=lambda n: min(abs(a - names[n][0]), abs(b - names[n][1])))
            for a, b in cells
        ]
        if places == sorted(set(places)):
            row = [""] * width
            for place, (a, b) in zip(places, cells, strict=True):
                row[place] = lines[at][1][a:b]
            found[at] = (rows[at][0], row)
    return found


def _spans(line: str, form: str) -> list[tuple[int, int]]:
    return [found.span() for found in re.finditer(form, line)]


def _all_numbers(cells: list[str]) -> bool:
    row = trimmed(cells)
    return bool(row) and all(map(is_number, row))


def splitter(lines: list[str]) -> tuple[str, Callable[[str], list[str]]]:
    """The separator that leaves most rows all numbers, "" for blanks, and what makes cells of a line."""

    def by(separator: str):
        def cells(line: str) -> list[str]:
            if '"' not in line:
                return [cell.strip() for cell in line.split(separator)]
            try:
                row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
            except csv.Error:  # a cell beyond the module's limit: no row of a table
                row = [line]
            return [cell.strip() for cell in row]

        return cells

    def blanks(line: str) -> list[str]:
        wide = [cell for cell in line.split("  ") if cell.strip()]  # names may hold single blanks
        words = line.split()
        return words if all(map(is_number, words)) else [cell.strip() for cell in wide]

    def score(way: tuple[str, Callable[[str], list[str]]]) -> tuple[int, int, int]:
        # A line without the separator is one cell, and no row: most ways split nothing.
        rows = [[is_number(c) for c in way[1](line) if c] for line in lines if way[0] in line]
        full = [row for row in rows if mostly(row)]
        return sum(map(all, full)), len(full), len(rows) if way[0] else 0

    return max([*((s, by(s)) for s in "\t;,|"), ("", blanks)], key=score)


# JSON as loggers write it: an object for each row, line by line or in a list, or one of whole columns.
#
# Keys name the columns. What is nested gets the names of its keys, or its places, joined by points.

_BEGINS = re.compile(r"\s*(\[\s*)?\{\s*\"")
_BETWEEN = re.compile(r"[\s,]*")
MOST_COLUMNS, MOST_GAPS = 10_000, 20
"""Columns of a table, and cells for each value that is there."""


def json_lines(path: Path, text: str) -> Sheet | None:
    """The table of such a text, None where it is no JSON.

    Raises `InputError` `damaged-file` where an object cannot be read, except for the last one, which a
    logger may not have ended; `no-rows` where there are no rows; `too-many-columns`.
    """
    if not _BEGINS.match(text):
        return None
    rows, line, last, notes = _objects(path, text)
    if len(rows) == 1 and (whole := _whole_columns(last)):
        length = len(next(iter(whole.values())))
        return Sheet(whole, np.arange(1, length + 1), {}, _notes(len(whole), length, notes))
    if len(rows) < 2:
        problem = "this is JSON, and no object of it is a row."
        raise fault("no-rows", path, problem, "write an object for each row.")
    names: dict[str, None] = {}
    for row in rows:
        names |= dict.fromkeys(row)
        few = len(names) * len(rows) > MOST_GAPS * (sum(map(len, rows)) + 1000)
        if len(names) > MOST_COLUMNS or (row is rows[-1] and few):
            problem = f"{len(rows):,} objects have {len(names):,} keys or more, and few of them in common."
            mend = f"write the same keys in each object, at most {MOST_COLUMNS:,}."
            raise fault("too-many-columns", path, problem, mend)
    columns = {
        unique: [row.get(name, "") for row in rows]
        for unique, name in zip(distinct([*names]), names, strict=True)
    }
    return Sheet(columns, np.array(line), {}, _notes(len(columns), len(rows), notes))


def _notes(columns: int, rows: int, notes: list[Note]) -> tuple[Note, ...]:
    return (Note("format", f"Read as JSON of {rows} rows and {columns} keys."), *notes)


def _objects(path: Path, text: str) -> tuple[list[dict[str, str]], list[int], Any, list[Note]]:
    """The named values of each object and the line on which it begins, and the last object as it is."""
    decode = json.JSONDecoder().raw_decode
    rows, line, now, last = [], [], 1, None
    before, at = 0, text.index("{")
    while at < len(text) and text[at] != "]":
        now += text.count("\n", before, at)
        before = at
        try:
            last, at = decode(text, at)
            rows.append(dict(islice(_named(last), MOST_COLUMNS + 1)))
        except (ValueError, RecursionError):
            if rows and "\n" not in text[at:].strip():
                said = f"Left out the last object, on line {now}: it does not end."
                return rows, line, None, [Note("skipped", said)]
            problem = f"this is JSON, and the object on line {now} cannot be read."
            raise fault("damaged-file", path, problem, "mend that line or leave it out.") from None
        line.append(now)
        found = _BETWEEN.match(text, at)
        at = found.end() if found else at
    return rows, line, last, []


def _named(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """The values within an object as text, each with its name."""
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, part in pairs:
            yield from _named(part, f"{name}.{key}" if name else str(key))
    else:
        yield name, "" if value is None else str(value)


def _whole_columns(row: Any) -> dict[str, list[str]]:
    """The columns of an object of lists, all as long; none where it is no such object."""
    lists = [x for x in row.values() if isinstance(x, list)] if isinstance(row, dict) else []
    if not lists or len(lists) < len(row) or len({len(x) for x in lists}) > 1 or len(lists[0]) < 2:
        return {}
    return {name: ["" if v is None else str(v) for v in x] for name, x in row.items()}


# LabVIEW measurement files (.lvm): a header of keys, then segments, each with a header of its own.
#
# The file's header names the separator, the decimal sign and what stands for the clock: `X_Columns` No (a
# step `Delta_X` from `X0`), One (one column for all channels) or Multi (one for each). Segments that follow
# one another are put under one another and told apart by a column. Format: NI, "Specification for the
# LabVIEW Measurement File (.lvm)", tutorial 4139.

MARK, CLOCK = "LabVIEW Measurement", "X_Value"
_END = "***End_of_Header***"


def labview(path: Path, text: str) -> Sheet | None:
    """The table of a LabVIEW measurement file, or None where it is none.

    Raises `InputError` `damaged-file` where its headers do not end, `no-rows` without a row.
    """
    if not text.startswith(MARK):
        return None
    lines = re.split(r"\r\n|\r|\n", text)
    separator = "," if any(re.match(r"Separator,Comma\b", x) for x in lines[:20]) else "\t"
    rows = [(k, [c.strip() for c in line.split(separator)]) for k, line in enumerate(lines, 1)]
    rows = [(k, row) for k, row in rows if any(row)]
    ends = [at for at, (_, row) in enumerate(rows) if row[0] == _END]
    if not ends:
        raise fault("damaged-file", path, f"{_END} is missing.", "export the file again.")
    about = {row[0]: row[1:] for _, row in rows[: ends[0]]}
    decimal = "," if about.get("Decimal_Separator", [])[:1] == [","] else "."
    found: list[Block] = []
    begin = ends[0]
    for number, end in enumerate(ends[1:] or ends, 1):
        about |= {row[0]: row[1:] for _, row in rows[begin:end]}
        inside = range(end + 1, len(rows))
        begin = next((at for at in inside if rows[at][1][0] in ("Channels", _END)), len(rows))
        if block := _block(rows[end + 1 : begin], about, decimal, str(number)):
            found.append(block)
    dialect = OTHER._replace(name="a LabVIEW measurement file", column="segment", decimal=decimal)
    if (sheet := sheet_of(found, dialect, decimal)) is None:
        raise fault("no-rows", path, "headers and no rows.")
    return sheet


def _block(
    rows: list[tuple[int, list[str]]], about: dict[str, list[str]], decimal: str, number: str
) -> Block | None:
    """One segment, None where it has no rows; `about` holds its header, or that of the file."""
    width = max((len(row) for _, row in rows), default=0)
    names = [CLOCK, *(f"channel {k}" for k in range(1, width))]
    if rows and not any(map(is_number, rows[0][1])):
        (_, names), *rows = rows
    if not rows:
        return None
    clocks = [k for k, name in enumerate(names) if name == CLOCK]
    channels = [k for k, name in enumerate(names) if name not in (CLOCK, "Comment", "")]
    labels = [x for x in about.get("Y_Unit_Label", []) if x]
    labels = labels if len(labels) == len(channels) else [""] * len(channels)
    known = zip(channels, distinct([names[k] for k in channels]), labels, strict=True)
    cells = list(zip(*(padded(row, len(names)) for _, row in rows), strict=True))
    seconds = "s" if "Time" in about.get("X_Dimension", ["Time"]) else ""
    found: list[tuple[str, str, tuple[str, ...]]] = []  # name, unit and cells of each column
    if about.get("X_Columns", [])[:1] == ["No"] or not clocks or not any(cells[clocks[0]]):
        start, step = (_first(about.get(key, []), decimal) for key in ("X0", "Delta_X"))
        x = (start or 0.0) + (step or 1.0) * np.arange(len(rows))
        found.append((CLOCK, seconds, tuple(f"{v:.12g}".replace(".", decimal) for v in x)))
        clocks = []
    elif len({cells[k] for k in clocks}) == 1:
        found.append((CLOCK, seconds, cells[clocks[0]]))
        clocks = []
    for k, name, unit in known:
        # Of several clocks each channel has the one before it.
        found += [(f"{CLOCK} {name}", "s", cells[c]) for c in clocks if c < k][-1:]
        found.append((name, unit, cells[k]))
    header, units, columns = zip(*found, strict=True)
    table = [list(row) for row in zip(*columns, strict=True)]
    return Block(header, units, table, [k for k, _ in rows], [[number]], [])


def _first(cells: list[str], decimal: str) -> float | None:
    known = floats(cells, decimal) if cells else np.zeros(0)
    return next(iter(known[~np.isnan(known)].tolist()), None)
