"""The table of a text that is more than a header and rows: notes, units, pieces, blanks, or no names."""

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ..._note import Note
from ._blocks import (
    Block,
    blocks,
    headers,
    mostly,
    nameless,
    period_of,
    sheet_of,
    worth_of,
)
from ._dialects import dialect_of, maker_of
from ._file import fault
from ._notes import Lines, is_numbered
from ._sheet import Layout, Sheet, is_number, trimmed

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
