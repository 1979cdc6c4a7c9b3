"""Tables within a text: notes above, a row of units below, several under or beside one another.

A table is a run of rows whose cells are mostly numbers; the row above is its header, or its units and
then its header. Those of one header are one table in pieces, told apart by a further column; of
different ones the one with most rows is meant, as a summary of results is shorter than the data.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ..._verdict import Note
from .._arrays import MISSING
from .._units import is_unit, written_unit
from ._notes import Dialect, is_numbered, listed_names
from ._sheet import Piece, Sheet, decimal_of, feet_of, is_number, joined, trimmed, units_of

Rows = Sequence[tuple[int, list[str]]]
"""Rows of cells, each with its line number."""


class Block(NamedTuple):
    """One table: names, units ("" for none), cells, the line of each row, and the rows of text above.

    `skipped`: lines within it that are no row of it.
    """

    header: tuple[str, ...]
    units: tuple[str, ...]
    rows: list[list[str]]
    line: list[int]
    above: list[list[str]]
    skipped: list[int]


class _Header(NamedTuple):
    """Where a header begins, the names, the units as written, and the index of the first row below."""

    start: int
    names: list[str]
    units: list[str]
    first: int


def sheet_of(
    found: list[Block], dialect: Dialect, decimal: str = ".", table: int | None = None
) -> Sheet | None:
    """Blocks as one sheet; None without any.

    `table`: which of the tables with different headers, from 1; the one with most rows if not given.

    Raises `InputError` `bad-option` where there is no such table.
    """
    if not dialect.joined:
        found = [piece for block in found for piece in _beside(block)]
    pieces = [
        Piece(
            block.header, block.units, [*zip(*block.rows, strict=True)], block.line,
            dialect.label_of(block.above), block.skipped, f"from line {block.line[0]}",
        )
        for block in found
    ]  # fmt: skip
    said = f"{dialect.name}, its numbers from line {{line}} on"
    sheet = joined(pieces, said, dialect.column, table)
    if sheet is None:
        return None
    cells = [cell for x in sheet.columns.values() for cell in x]
    sign = decimal if decimal == "," else dialect.decimal or decimal_of(cells)
    comma = Note("decimal-comma", "Numbers are written with a decimal comma.")
    return replace(sheet, decimal=sign, notes=(*sheet.notes, *[comma] * (sign != decimal)))


def blocks(rows: Rows) -> list[Block]:
    """The tables in rows of cells.

    A line that is neither a row nor a header does not end a table: it is left out of it, and noted.
    """
    heads = headers(rows)
    begins = {head.start: head for head in heads}
    titles = _titles(rows, heads)
    ends = {*begins, *titles}
    found: list[Block] = []
    above: list[tuple[int, list[str]]] = []
    k = 0
    while k < len(rows):
        if head := begins.get(k):
            width = max(len(trimmed(rows[head.first][1])), len(head.names))
            names, units = tuple(padded(head.names, width)), tuple(padded(head.units, width))
            found.append(Block(names, units, [], [], [row for _, row in above], []))
            k = head.first
        elif found and k not in titles and _belongs(rows[k][1], len(found[-1].header)):
            found[-1].skipped.extend(line for line, _ in above)
        else:
            above.append(rows[k])
            k += 1
            continue
        above, block = [], found[-1]
        width = len(block.header)
        while k < len(rows) and k not in ends and _belongs(rows[k][1], width):
            block.rows.append(padded(rows[k][1], width))
            block.line.append(rows[k][0])
            k += 1
    for block in found:
        if feet := feet_of(block.rows, len(block.header)):
            block.skipped.extend(block.line[-feet:])
            del block.rows[-feet:], block.line[-feet:]
    return [block for block in found if block.rows]


def headers(rows: Rows) -> list[_Header]:
    """Every header: a row of text as wide as the numbers below, or one above a row of units."""
    data = [_is_data(cells) for _, cells in rows]
    found: list[_Header] = []
    for k in range(1, len(rows)):
        # What comes after a row of numbers is no header unless a whole one stands between.
        if data[k] and not data[k - 1]:
            least = found[-1].first + 1 if found else 0
            head = _header(rows, k, least)
            found += [head] if head is not None else []
    return found


def _header(rows: Rows, k: int, least: int) -> _Header | None:
    """The header of the numbers that begin at row k, in the rows from `least` on."""
    width = len(trimmed(rows[k][1]))
    last = _as_wide(rows[k - 1][1], width)
    # The first row names the columns. To ask whether it is one of units loads pint, half a second.
    units = units_of(last) if k - 2 >= least else None
    for at in range(k - 3, max(least, k - 5) - 1, -1) if units is None else ():
        # Between units and numbers some loggers write where each column is connected.
        if len(_as_wide(rows[at + 2][1], width)) > width:
            break
        names, over = (_as_wide(rows[n][1], width) for n in (at, at + 1))
        stated = units_of(over) if 2 * len(names) > width else None
        if stated is not None and len(names) == len(over) and not any(map(is_number, names)):
            return _Header(at, names, stated, k)
    found = None
    if units is not None:
        stated = sum(map(bool, units))
        for at in range(k - 2, max(least, k - 4) - 1, -1):
            names = _as_wide(rows[at][1], width)
            filled = sum(map(bool, names))
            # A row that says more about few of the columns stands between names and units at times.
            if 2 * len(names) > width and 2 * filled > stated and not all(map(is_number, names)):
                if _is_data(names) and at - 1 >= 0 and _is_data(rows[at - 1][1]):
                    break  # numbers of the table above
                found = _Header(at, names, units, k)
                break
            if filled > 3:
                break
    if found is not None and len(set(found.names)) == len(found.names):
        return found
    words = any(last) and not any(map(is_number, last))
    if k > 1 and all(is_numbered("\t".join(rows[at][1])) for at in (k - 2, k - 1)):
        words = False  # the end of a list of names
    if found is None and words and 2 * len(last) > width:
        found = _Header(k - 1, last, [], k)
    # Names that hold units may stand above rows that say more about each column.
    lowest = found.start if found else k - 1
    for at in range(lowest - 1, max(least, lowest - 4) - 1, -1):
        names, below = trimmed(rows[at][1]), rows[at + 1][1]
        if rows[at + 1][0] - rows[at][0] > 1 or not (len(below) > 1 and _are_words(below, width)):
            break
        whole = len(names) == width and all(names) and not any(map(is_number, names))
        worth, least_worth = worth_of(names), worth_of(found.names) if found else (0, 0)
        if whole and (worth[0] > 1 or worth[1] > 2) and worth > least_worth:
            found = _Header(at, names, found.units if found else [], k)
    return found


def _are_words(cells: Sequence[str], width: int) -> bool:
    """Whether each cell of a row, which is no wider, holds a letter and is no number, however written."""
    filled = [cell for cell in trimmed(cells) if cell]
    words = [re.search(r"[^\W\d_eE]", cell) and cell.lower() not in MISSING for cell in filled]
    return len(trimmed(cells)) <= width and all(words)


def worth_of(names: Sequence[str]) -> tuple[int, int]:
    """How much a row says as names of columns: units behind them, and names that differ by more than a
    number."""
    units = [unit for name in names if (unit := written_unit(name, None)) and is_unit(unit)]
    return len(units), len({re.sub(r"\d+", "", name) for name in names})


def _titles(rows: Rows, heads: list[_Header]) -> set[int]:
    """The lines of text right above headers: they belong to the table below, whatever numbers they hold."""
    found: set[int] = set()
    for head in heads:
        at = head.start
        while at > 0 and rows[at - 1][0] == rows[at][0] - 1 and not _is_data(rows[at - 1][1]):
            at -= 1
            found.add(at)
    return found


def nameless(rows: Rows, dialect: Dialect, above: Sequence[str], text: str) -> list[Block]:
    """Rows of numbers alone, as blocks: those of the commonest width.

    The comments `above` the first row name the columns, or the dialect, or their place.
    An empty line ends a block where the dialect says so, or where each block has several rows.
    """
    runs: list[list[tuple[int, list[str]]]] = []
    for k, cells in rows:
        row = trimmed(cells)
        if not row or not all(map(is_number, row)):
            continue
        last = runs[-1][-1] if runs else (-2, [])
        if len(last[1]) == len(row) and k == last[0] + 1:
            runs[-1].append((k, row))
        else:
            runs.append([(k, row)])
    if not runs:
        return []
    sizes: dict[int, int] = {}
    for run in runs:
        sizes[len(run[0][1])] = sizes.get(len(run[0][1]), 0) + len(run)
    width = max(sizes, key=lambda n: sizes[n])
    runs = [run for run in runs if len(run[0][1]) == width]
    if dialect.joined or (not dialect.blank and any(len(run) < 3 for run in runs)):
        runs = [[row for run in runs for row in run]]
    names, over = (_as_wide([*above[at:][:1]], width) if width > 1 else [] for at in (-1, -2))
    units = list(next((own for said, own in dialect.units if said.search(text)), ()))
    if len(over) == len(names) == width and (stated := units_of(names)) is not None:
        names, units = over, stated
    first = next(k for k, (line, _) in enumerate(rows) if line == runs[0][0][0])
    head = _header(rows, first, 0) if first else None
    if head is not None and len(head.names) == width and not any("=" in n for n in head.names):
        names = head.names  # and no line such as NData = 12
        own = any(written_unit(name, None) for name in names)
        units = head.units or ([] if own else units)
    told = listed_names([*above, *text.split("\n")], width)
    if told[0]:
        names, units = told[0], told[1] or units
    if len(names) != width or not all(names) or any(map(is_number, names)):
        known = dialect.names[:width]
        names = [*known, *(f"column {k}" for k in range(len(known) + 1, width + 1))]
    units = padded(units, width)
    return [
        Block(tuple(names), tuple(units), [r for _, r in run], [k for k, _ in run], [], [])
        for run in runs
    ]


def _beside(block: Block) -> list[Block]:
    """Tables side by side: a header that repeats itself."""
    period = period_of(block.header)
    if not period:
        return [block]
    pieces = []
    for at in range(0, len(block.header), period):
        part = slice(at, at + period)
        rows = [(n, row[part]) for n, row in zip(block.line, block.rows, strict=True)]
        rows = [(n, row) for n, row in rows if any(row)]
        title = [[c for row in block.above for c in row[part] if c]]
        cells, line = [row for _, row in rows], [n for n, _ in rows]
        pieces.append(
            Block(block.header[part], block.units[part], cells, line, title, block.skipped)
        )
    return [piece for piece in pieces if piece.rows]


def period_of(header: Sequence[str]) -> int:
    """After how many columns a header begins again, 0 where it does not."""
    names = [" ".join(cell.lower().split()) for cell in trimmed(header)]
    if any(is_number(name) for name in names):
        return 0
    for period in range(2, len(names) // 2 + 1):
        whole = len(names) % period == 0 and len(set(names[:period])) == period
        if whole and names == names[:period] * (len(names) // period):
            return period
    return 0


def _is_data(cells: Sequence[str]) -> bool:
    return mostly([is_number(cell) for cell in cells if cell])


def mostly(numbers: list[bool]) -> bool:
    """Whether at least two are numbers, and at least half."""
    return sum(numbers) >= 2 and 2 * sum(numbers) >= len(numbers)


def _belongs(cells: list[str], width: int) -> bool:
    """A row of numbers, or one where some are missing or a word: an overload."""
    size = len(trimmed(cells))
    return (_is_data(cells) and size <= width) or (size == width and any(map(is_number, cells)))


def padded(cells: Sequence[str], width: int) -> list[str]:
    return [*cells[:width], *[""] * (width - len(cells))]


def _as_wide(cells: Sequence[str], width: int) -> list[str]:
    """A header row in as many cells as the numbers have, where blanks separate its names instead."""
    row = trimmed(cells)
    if len(row) != 1 or width < 2:
        return row
    bare = row[0].strip().lstrip("#%;").strip()
    bare = re.sub(r"(?i)^(columns?|fields|names|header)\s*[:=]\s*", "", bare)
    for parts in (re.split(r"\s{2,}|\t", bare), bare.split(), re.split(r"\s*[,;]\s*", bare)):
        if len(parts) == width:
            return parts
    return row
