"""Tables within a text: notes above, a row of units below, several under or beside one another.

A table is a run of rows whose cells are mostly numbers; the row above is its header, or its units and
then its header. Those of one header are one table in pieces, told apart by a further column; of
different ones the one with most rows is meant, as a summary of results is shorter than the data.
"""

import csv
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..._note import Note
from ._dialects import Dialect, dialect_of
from ._sheet import Sheet, decimal_of, distinct, is_number, units_of

_LOOK = 400
"""Lines from which the separator is found."""


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


def arranged(numbered: Sequence[tuple[int, str]], decimal: str = ".") -> Sheet | None:
    """The table of a text that does not begin with its header, or None where it does.

    `numbered`: the line numbers and texts of the lines that are not blank. Tables side by side with the
    same names are put under one another as well.
    """
    text = "\n".join(line for _, line in numbered[:_LOOK])
    dialect = dialect_of(text)
    split = _splitter([line for _, line in numbered[:_LOOK]])
    head = [split(line) for _, line in numbered[:_LOOK]]
    if not (dialect.sure or _begins_late(head) or _period(head[0])):
        return None
    rows = [(k, split(line)) for k, line in numbered]
    return sheet_of(blocks(rows), dialect, decimal)


def sheet_of(found: list[Block], dialect: Dialect, decimal: str = ".") -> Sheet | None:
    """Blocks as one sheet; None without any."""
    found = [piece for block in found for piece in _beside(block)]
    families: dict[tuple, list[Block]] = {}
    for block in found:
        families.setdefault((block.header, block.units), []).append(block)
    if not families:
        return None
    chosen = max(families.values(), key=lambda f: sum(len(b.rows) for b in f))
    header, units = chosen[0].header, chosen[0].units
    cells = [row for block in chosen for row in block.rows]
    # Columns without any cell are an end of line in the export, not a measurement.
    kept = [k for k in range(len(header)) if any(row[k] for row in cells)]
    names = distinct([header[k] for k in kept])
    columns = {name: [row[k] for row in cells] for name, k in zip(names, kept, strict=True)}
    said = f"Read as {dialect.name}, its numbers from line {chosen[0].line[0]} on."
    notes = [Note("format", said)]
    if skipped := [k for block in chosen for k in block.skipped]:
        said = f"Left out {len(skipped)} lines that are no row, first line {skipped[0]}."
        notes.append(Note("skipped", said))
    if len(chosen) > 1:
        (name,) = distinct([dialect.column], names)
        labels = _labels(chosen, dialect)
        columns = {name: [x for x, b in zip(labels, chosen, strict=True) for _ in b.rows]} | columns
        said = f"Put {len(chosen)} tables under one another, told apart by {name!r}."
        notes.append(Note("joined", said))
    others = sum(len(b.rows) for b in found) - len(cells)
    if others:
        notes.append(Note("skipped", f"Left out {others} rows of other tables in the file."))
    sign = (
        decimal if decimal == "," else dialect.decimal or decimal_of([c for r in cells for c in r])
    )
    if sign != decimal:
        notes.append(Note("decimal-comma", "Numbers are written with a decimal comma."))
    by_name = {name: units[k] for name, k in zip(names, kept, strict=True) if units[k]}
    line = np.array([k for block in chosen for k in block.line])
    return Sheet(columns, line, by_name, tuple(notes), sign)


def blocks(rows: Sequence[tuple[int, list[str]]]) -> list[Block]:
    """The tables in rows of cells, each row with its line number.

    A line that is neither a row nor a header does not end a table: it is left out of it, and noted.
    """
    found: list[Block] = []
    above: list[tuple[int, list[str]]] = []
    k = 0
    while k < len(rows):
        cells = rows[k][1]
        begins = _is_data(cells) and k > 0 and _is_header(rows[k - 1][1], len(_trimmed(cells)))
        last = found[-1] if found else None
        if begins:
            width = len(_trimmed(cells))
            units = None
            if k > 1 and _is_header(rows[k - 2][1], width):
                units = units_of(_trimmed(rows[k - 1][1]))
            header = _trimmed(rows[k - 2 if units else k - 1][1])
            width = max(width, len(header))
            notes = [row for _, row in above[: len(above) - (2 if units else 1)]]
            names, symbols = _padded(header, width), _padded(units or [], width)
            found.append(Block(tuple(names), tuple(symbols), [], [], notes, []))
        elif last is None or not _belongs(cells, len(last.header)):
            above.append(rows[k])
            k += 1
            continue
        else:
            found[-1].skipped.extend(line for line, _ in above)
        above, block = [], found[-1]
        width = len(block.header)
        while k < len(rows) and _belongs(rows[k][1], width):
            block.rows.append(_padded(rows[k][1], width))
            block.line.append(rows[k][0])
            k += 1
    return found


def _labels(chosen: list[Block], dialect: Dialect) -> list[str]:
    found = [dialect.label_of(block.above) for block in chosen]
    good = all(found) and len(set(found)) == len(found)
    return found if good else [str(k) for k in range(1, len(chosen) + 1)]


def _beside(block: Block) -> list[Block]:
    """Tables side by side: a header that repeats itself."""
    period = _period(block.header)
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


def _period(header: Sequence[str]) -> int:
    """After how many columns a header begins again, 0 where it does not."""
    names = [" ".join(cell.lower().split()) for cell in _trimmed(list(header))]
    if any(is_number(name) for name in names):
        return 0
    for period in range(2, len(names) // 2 + 1):
        whole = len(names) % period == 0 and len(set(names[:period])) == period
        if whole and names == names[:period] * (len(names) // period):
            return period
    return 0


def _begins_late(rows: list[list[str]]) -> bool:
    """Whether more stands above the numbers than a header and a row of units as wide as they are."""
    first = next((k for k, row in enumerate(rows) if k and _is_data(row)), 0)
    if first < 2 or _is_data(rows[0]):
        return False
    width = len(_trimmed(rows[first]))
    if not _is_text(rows[first - 1]) or len(_trimmed(rows[first - 1])) < 2:
        return False
    return first > 2 or len(_trimmed(rows[0])) != width == len(_trimmed(rows[1]))


def _is_data(cells: list[str]) -> bool:
    return _mostly([is_number(cell) for cell in cells if cell])


def _mostly(numbers: list[bool]) -> bool:
    return sum(numbers) >= 2 and 2 * sum(numbers) >= len(numbers)


def _is_header(cells: list[str], width: int) -> bool:
    """Text enough to name so many columns, or most of them."""
    return _is_text(cells) and 2 * len(_trimmed(cells)) > width


def _is_text(cells: list[str]) -> bool:
    return any(cells) and not any(map(is_number, cells))


def _belongs(cells: list[str], width: int) -> bool:
    """A row of numbers, or one where some are missing or a word: an overload."""
    size = len(_trimmed(cells))
    return (_is_data(cells) and size <= width) or (size == width and any(map(is_number, cells)))


def _trimmed(cells: Sequence[str]) -> list[str]:
    found = list(cells)
    while found and not found[-1].strip():
        found.pop()
    return found


def _padded(cells: Sequence[str], width: int) -> list[str]:
    return [*cells[:width], *[""] * (width - len(cells))]


def _splitter(lines: list[str]):
    """A function from a line to its cells: the separator that leaves most rows all numbers."""

    def by(separator: str):
        def cells(line: str) -> list[str]:
            row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
            return [cell.strip() for cell in row]

        return cells

    def blanks(line: str) -> list[str]:
        wide = [cell for cell in line.split("  ") if cell.strip()]  # names may hold single blanks
        words = line.split()
        return words if all(map(is_number, words)) else [cell.strip() for cell in wide]

    def score(way: tuple[str, Callable[[str], list[str]]]) -> tuple[int, int]:
        # A line without the separator is one cell, and no row: most ways split nothing.
        rows = [[is_number(c) for c in way[1](line) if c] for line in lines if way[0] in line]
        full = [row for row in rows if _mostly(row)]
        return sum(map(all, full)), len(full)

    return max([*((s, by(s)) for s in "\t;,|"), ("", blanks)], key=score)[1]
