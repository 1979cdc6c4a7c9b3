"""Reading a table: plain CSV here, other files by the importers; every fault has line and remedy."""

import csv
import hashlib
import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from mmap import mmap
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._errors import InputError
from .._verdict import Note
from ._arrays import check_room, floats, long_cell, parsed
from ._clock_columns import with_clocks
from ._compiled_rows import CompiledRows, OddRowsError
from ._table import Table, TextColumns, followed, headless, with_column
from ._units import are_units, bare_unit, kind_of, named_unit, spelled
from .importers._binary import binary
from .importers._notes import clock_in, noted_units, units_behind_blanks, without_settings
from .importers._sheet import Layout, Sheet, decode, fault, feet_of, file_bytes, mapped, trimmed
from .importers._text import MOST_COLUMNS, arranged, json_lines, labview, splitter, without_table

_RULED, _RULE = "-=+|_ ", re.compile(r"[\s|+:]*(-{3,}|={3,}|_{3,})[-=_\s|+:]*")
"""A line drawn below a header, and the characters that it begins with."""
_MINUS = re.compile(r"(?<![^\WeE])\u2212(?=[.,]?\d)")
"""A minus sign that is no hyphen, as Swedish and Norwegian programs write it before a number."""
MOST_NOTES = 200
"""Lines above a table that may tell of it."""
HEAD, LEAST_LINES = 2**18, 1000
"""Bytes and lines of a large text that are read carefully and say how its rows go on."""
TAIL = 2**16
"""Bytes at its end that are looked at for what a program says below its table."""


class _Asked(NamedTuple):
    """The file, and the options of `read_table`."""

    path: Path
    decimal: str
    separator: str | None
    units_row: int | None
    na_values: tuple[str, ...]
    dialects: str | Path | None
    table: int | None


def read_table(
    path: str | Path,
    *,
    decimal: str = ".",
    separator: str | None = None,
    units_row: int | None = None,
    na_values: Collection[str] = (),
    dialects: str | Path | None = None,
    table: int | None = None,
    most: int | None = None,
) -> Table:
    """Columns of a CSV file with one header, or of a file that a machine wrote
    (`hysteresis.records.importers`).

    Reads UTF-8, UTF-16 and Latin-1, with or without a byte-order mark, any line end, quoted
    cells, trailing separators, comment lines (#), separators `, ; tab |` found by themselves, and
    a row of units under the header, and JSON lines. Of LabVIEW, TDMS, Excel, MTS, TRIOS, Bluehill,
    testXpert and texture analyser files, and of others with notes above, the longest table.

    **Arguments:**

    - `decimal`: "." or ",".
    - `separator`: one character; found from the first lines if not given.
    - `units_row`: line of the row of units; found if not given, 0 for none.
    - `na_values`: texts that mean a missing value, besides the empty cell and NaN.
    - `dialects`: a TOML file of dialects, which go before those of `importers/dialects.toml`.
    - `table`: which of a file's tables with different headers, from 1; the longest if not given.
    - `most`: of a text 32 times larger, read so many bytes from its head, and half a megabyte in pieces of
      all the rest, if there is more.

    **Raises:** `InputError` `file-not-found`, `is-directory`, `permission-denied`, `empty-file`,
    `binary-file`, `no-rows`, `duplicate-column`, `no-header`, `ragged-line`, `decimal-comma`,
    `bad-units-row`, `bad-option`, `missing-extra`, `damaged-file`, `long-cell`, `too-many-columns`.

    **Example:**

        >>> table = hysteresis.read_table(datasets / "sponge-50mm-cycles.csv")
        >>> list(table.columns)
        ['time (s)', 'force (N)', 'displacement (mm)', 'cycle']
    """
    if decimal not in (".", ",") or (separator is not None and len(separator) != 1):
        problem = f"decimal={decimal!r}, separator={separator!r}: one character each."
        raise InputError("bad-option", problem, fix='decimal is "." or "," (--decimal).')
    path = Path(path)
    asked = _Asked(path, decimal, separator, units_row, tuple(na_values), dialects, table)
    large = mapped(path) if most is None else None
    if large and (found := _by_its_head(asked, large, len(large))):
        return found
    data, size = file_bytes(path, most)
    if (sheet := binary(path, data, table)) is None:
        if found := _by_its_head(asked, data, size):
            return found
        sheet = _sheet(asked, data)
    return _timed(_table(asked, data, size, sheet), sheet)


def _timed(table: Table, sheet: Sheet) -> Table:
    """The table with its clocks, and with the one that its header tells where it has none."""
    table = with_clocks(table)
    if sheet.clock is None or any(note.code == "joined" for note in table.notes):
        return table
    first, step, said = sheet.clock
    for name, x in table.columns.items():
        even = x.dtype.kind == "f" and np.allclose(np.diff(x), step, 0.01, 0)
        unit = named_unit(name, None, table.units.get(name))
        if even or kind_of(name, "1").name == "time" or unit in ("s", "ms", "us", "min", "h"):
            return table
    t = first + step * np.arange(len(table.line))
    note = Note("clock", f"Column 'time' counts the rows by what the header says: {said}.")
    return with_column(replace(table, notes=(*table.notes, note)), "time", t, "s")


def _by_its_head(asked: _Asked, data: bytes | mmap, size: int) -> Table | None:
    """A large text whose rows go on as they begin; None of any other file."""
    cut, length = 0, HEAD
    while data[:cut].count(b"\n") < LEAST_LINES:
        if len(data) <= length:
            return None
        cut, length = data.rfind(b"\n", 0, length) + 1, 2 * length
    try:
        sheet = _sheet(asked, data[:cut])
        if sheet.layout is None or data[:cut].count(b'"') % 2:  # a cell may go on below
            return None
        last = data[max(cut, len(data) - TAIL) :].decode("latin-1").splitlines()[1:]
        cells = [one.split(sheet.layout.separator or None) for one in last if one.strip()]
        if feet_of(cells, len(sheet.columns)):
            return None
        begun = _table(asked, data, size, sheet)
        lines = len(re.findall(rb"\r\n|\r|\n", data[:cut]))
        where = data, cut, lines + 1
        rows = CompiledRows(*where, sheet.layout, begun.decimal, asked.na_values)
        return _timed(followed(begun, rows), sheet)
    except (InputError, OddRowsError):  # which the careful reader words, if it is a fault at all
        return None


def _sheet(asked: _Asked, data: bytes) -> Sheet:
    """The columns of a text."""
    path = asked.path
    text, notes = decode(path, data)
    text = _MINUS.sub("-", text) if "\u2212" in text else text
    if sheet := labview(path, text) or json_lines(path, text):
        return replace(sheet, notes=(*notes, *sheet.notes))
    every = re.split(r"\r\n|\r|\n", text)
    numbered, told = without_settings(_numbered(every))
    if not numbered:
        raise fault("empty-file", path, "nothing but blank or comment lines.")
    sheet = None
    if asked.separator is None and asked.units_row is None:
        above = every[: numbered[0][0] - 1]
        sheet = arranged(path, numbered, asked.decimal, above, asked.dialects, asked.table)
    if sheet is None:
        try:
            sheet = _plain(asked, numbered)
        except InputError as error:
            if error.code in ("ragged-line", "decimal-comma", "duplicate-column", "no-rows"):
                without_table(path, numbered)
            raise
    above = every[: sheet.line[0] - 1][-MOST_NOTES:]
    bare = [name for name in sheet.columns if name not in sheet.units]
    units = units_behind_blanks(bare) | noted_units(above, bare)
    return replace(
        sheet,
        notes=(*notes, *sheet.notes),
        units={**sheet.units, **units},
        clock=clock_in([*told, *above]),
    )


def _numbered(lines: Sequence[str], first: int = 1) -> list[tuple[int, str]]:
    """The lines that are neither blank nor a comment nor a rule, each with its number."""
    return [
        (k, s) for k, s in enumerate(lines, first)
        if s and not s.isspace() and s[0] != "#" and not (s[0] in _RULED and _RULE.fullmatch(s))
    ]  # fmt: skip


def _rows(
    path: Path, numbered: Sequence[tuple[int, str]], separator: str
) -> tuple[list[list[str]], list[int]]:
    """Rows of cells, and the line on which each begins."""
    rows, line, start = [], [], 0
    reader = csv.reader((f"{s}\n" for _, s in numbered), delimiter=separator, skipinitialspace=True)
    try:
        for row in reader:  # a quoted cell may run over several lines
            rows.append(row)
            line.append(numbered[start][0])
            start = reader.line_num
    except csv.Error:  # of a cell beyond the module's limit, and of nothing else
        raise long_cell(path, numbered[start][0], csv.field_size_limit()) from None
    return rows, line


def _header(path: Path, cells: list[str]) -> list[str]:
    """The names of the columns. Raises `duplicate-column`, or `no-header` where they are numbers."""
    names = [" ".join(c.split()) if "\n" in c else c.strip() for c in trimmed(cells)]
    if len(names) > MOST_COLUMNS:
        problem = f"The header has {len(names):,} columns, and the limit is {MOST_COLUMNS:,}."
        mend = "write one row for each moment, not one column, or leave columns out."
        raise InputError("too-many-columns", problem, place=str(path), fix=mend)
    names = [name or f"column {k}" for k, name in enumerate(names, 1)]
    for k, name in enumerate(names):
        if (first := names.index(name)) < k:
            problem = f"Column {name!r} is there twice, as column {first + 1} and {k + 1}."
            cause, code, fix = headless(names), "duplicate-column", "rename one."
            if cause:
                code, fix = "no-header", "write a line above it that names each column."
            raise InputError(code, problem, place=str(path), cause=cause, fix=fix)
    return names


def _make_square(path: Path, rows: list[list[str]], line: np.ndarray, width: int, sep: str) -> None:
    """Make every row `width` cells long by dropping empty cells at its end, or name the line."""
    lengths = np.fromiter(map(len, rows), int, len(rows))
    for k in np.flatnonzero(lengths != width):
        row = rows[k]
        if lengths[k] > width and not any(c.strip() for c in row[width:]):
            del row[width:]
            continue
        problem = f"{lengths[k]} cells, the header has {width}."
        cause = f"a line cut short, another separator than {sep!r}, a stray one, or an open quote."
        code, fix = "ragged-line", "mend that line, or start it with # to leave it out."
        longer = sum(len(trimmed(r)) > width for r in rows)
        if sep == "," and (lengths[k] == 2 * width or 2 * longer > len(rows)):
            code, cause = "decimal-comma", "numbers written with a decimal comma."
            fix = 'separate the cells by ";" and give decimal="," (--decimal ,).'
        raise InputError(code, problem, place=f"{path}, line {line[k]}", cause=cause, fix=fix)


def _plain(asked: _Asked, numbered: Sequence[tuple[int, str]]) -> Sheet:
    """The columns of a text of a header, perhaps a row of units, and rows that are all as long."""
    path, decimal, separator, units_row, *_ = asked
    notes: list[Note] = []
    sep = separator or splitter([s for _, s in numbered[:30]])[0] or ","
    rows, line = _rows(path, numbered, sep)
    header = _header(path, rows[0])
    units, body, at = {}, rows[1:], (line[1:2] or [2])[0]
    if units_row and units_row != at:
        problem = f"Line {units_row} is not the row under the header."
        mend = f"--units-row {at}, or 0 for none."
        raise InputError("bad-units-row", problem, place=str(path), fix=mend)
    if body and (units_row or (units_row is None and are_units(body[0]))):
        cells = [bare_unit(c) for c in body[0]]
        if not np.isnan(floats(cells, decimal)[[bool(c) for c in cells]]).any():
            problem = f"Line {at} holds numbers, no units."
            mend = "leave --units-row away, or --units-row 0 for none."
            raise InputError("bad-units-row", problem, place=str(path), fix=mend)
        units, body, line = dict(zip(header, cells, strict=False)), body[1:], line[1:]
        confirm = "" if units_row else f" Confirm with units_row={at} (--units-row {at})."
        said = f"Row {at} is units ({', '.join(cells)}); using them.{confirm}"
        notes.append(Note("units-row", said))
    heads = rows[: len(rows) - len(body)]
    if again := [k for k, row in enumerate(body) if row in heads]:
        said = (
            f"Left out lines that repeat the header: {len(again)}, first line {line[again[0] + 1]}."
        )
        notes.append(Note("skipped", said))
        body, line = [row for row in body if row not in heads], np.delete(line, np.add(again, 1))
    full = next((k for k in range(len(body), 0, -1) if trimmed(body[k - 1])), 0)
    if blank := len(body) - full:
        body, line = body[:full], line[: full + 1]
        notes.append(Note("skipped", f"Left out {blank} empty rows at the end."))
    if feet := feet_of(body, len(header)):
        said = f"Left out {feet} lines at the end that are no rows, first line {line[-feet]}."
        notes.append(Note("skipped", said))
        body, line = body[:-feet], line[:-feet]
    if not body:
        raise fault("no-rows", path, "a header and no rows.")
    line = np.array(line[1:])
    _make_square(path, body, line, len(header), sep)
    columns = dict(zip(header, zip(*body, strict=True), strict=False))
    layout = None if blank or feet or again else Layout(sep, plain=True)
    return Sheet(columns, line, units, tuple(notes), decimal, layout)


def _table(asked: _Asked, data: bytes | mmap, size: int, sheet: Sheet) -> Table:
    path, na_values = asked.path, asked.na_values
    decimal = sheet.decimal if asked.decimal == "." else asked.decimal
    check_room(path, sheet.columns, sheet.line)

    def words(name: str) -> np.ndarray:
        return np.char.strip(np.asarray(sheet.columns[name]).astype(str, copy=False))

    # Text of numbers is made when it is asked for: of three million it takes ten seconds.
    held = {name: x for name, x in sheet.columns.items() if isinstance(x, np.ndarray)}
    held = {name: x for name, x in held.items() if x.dtype == float or x.dtype.kind in "iu"}
    held = {} if na_values else held
    text = {name: words(name) for name in sheet.columns if name not in held}
    columns = {
        name: held[name].astype(float) if name in held else parsed(text[name], decimal, na_values)
        for name in sheet.columns
    }
    units = {name: unit and spelled(unit) for name, unit in sheet.units.items()}
    digest = hashlib.sha256(data).hexdigest()
    return Table(
        columns, TextColumns(columns, words) if held else text, sheet.line, units, str(path), digest,
        sheet.notes, decimal, na_values, sheet.units, len(data) / size,
    )  # fmt: skip
