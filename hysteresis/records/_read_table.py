"""Reading a table: plain CSV here, other files by the importers; every fault has line and remedy."""

import csv
import hashlib
import re
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from .._errors import InputError
from .._note import Note
from ._cells import check_room, floats, long_cell, parsed
from ._dialect import header_of, made_square, separator_of, trimmed
from ._table import Table
from ._units import are_units, bare_unit, spelled
from .importers import (
    Sheet,
    arranged,
    binary,
    decode,
    fault,
    file_bytes,
    labview,
    without_table,
)


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
    a row of units under the header. Of LabVIEW, TDMS, Excel, MTS, TRIOS, Bluehill, testXpert and texture
    analyser files, and of others with notes above, the longest table.

    **Arguments:**

    - `decimal`: "." or ",".
    - `separator`: one character; found from the first lines if not given.
    - `units_row`: line of the row of units; found if not given, 0 for none.
    - `na_values`: texts that mean a missing value, besides the empty cell and NaN.
    - `dialects`: a TOML file of dialects, which go before those of `importers/dialects.toml`.
    - `table`: which of a file's tables with different headers, from 1; the longest if not given.
    - `most`: of a text 32 times larger, read so many bytes from its head, and pieces of all the rest.

    **Raises:** `InputError` `file-not-found`, `is-directory`, `permission-denied`, `empty-file`,
    `binary-file`, `no-rows`, `duplicate-column`, `no-header`, `ragged-line`, `decimal-comma`,
    `bad-units-row`, `bad-option`, `missing-extra`, `damaged-file`, `long-cell`, `too-many-columns`.

    **Example:**

        >>> table = hysteresis.read_table(datasets / "sponge-50mm-cycles.csv")
        >>> list(table.columns)
        ['time (s)', 'force (N)', 'displacement (mm)', 'cycle']
    """
    path = Path(path)
    if decimal not in (".", ",") or (separator is not None and len(separator) != 1):
        problem = f"decimal={decimal!r}, separator={separator!r}: one character each."
        raise InputError("bad-option", problem, fix='decimal is "." or "," (--decimal).')
    data, size = file_bytes(path, most)
    read_with = decimal, tuple(na_values), size
    if sheet := binary(path, data, table):
        return _table(path, data, sheet, *read_with)
    text, notes = decode(path, data)
    if sheet := labview(path, text):
        return _table(path, data, sheet, *read_with)
    every = re.split(r"\r\n|\r|\n", text)
    numbered = [(k, s) for k, s in enumerate(every, 1) if s and not s.isspace() and s[0] != "#"]
    if not numbered:
        raise fault("empty-file", path, "nothing but blank or comment lines.")
    if separator is None and units_row is None:
        above = every[numbered[0][0] - 2] if numbered[0][0] > 1 else ""
        if sheet := arranged(path, numbered, decimal, above, dialects, table):
            return _table(path, data, sheet, *read_with, notes)
    read = separator, decimal, units_row
    try:
        sheet = _plain(path, numbered, *read)
    except InputError as error:
        if error.code in ("ragged-line", "decimal-comma", "duplicate-column", "no-rows"):
            without_table(path, numbered)
        raise
    return _table(path, data, sheet, *read_with, notes)


def _plain(
    path: Path,
    numbered: Sequence[tuple[int, str]],
    separator: str | None,
    decimal: str,
    units_row: int | None,
) -> Sheet:
    """The columns of a text of a header, perhaps a row of units, and rows that are all as long."""
    notes: list[Note] = []
    lines = [s for _, s in numbered]
    sep = separator or separator_of(lines[:30])
    rows, line, start = [], [], 0
    reader = csv.reader((f"{s}\n" for s in lines), delimiter=sep, skipinitialspace=True)
    try:
        for row in reader:  # a quoted cell may run over several lines
            rows.append(row)
            line.append(numbered[start][0])
            start = reader.line_num
    except csv.Error:  # of a cell beyond the module's limit, and of nothing else
        raise long_cell(path, numbered[start][0], csv.field_size_limit()) from None
    header = header_of(path, rows[0])
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
    full = next((k for k in range(len(body), 0, -1) if trimmed(body[k - 1])), 0)
    if blank := len(body) - full:
        body, line = body[:full], line[: full + 1]
        notes.append(Note("skipped", f"Left out {blank} empty rows at the end."))
    if not body:
        raise fault("no-rows", path, "a header and no rows.")
    line = np.array(line[1:])
    made_square(path, body, line, len(header), sep)
    columns = dict(zip(header, zip(*body, strict=True), strict=False))
    return Sheet(columns, line, units, tuple(notes), decimal)


def _table(
    path: Path,
    data: bytes,
    sheet: Sheet,
    decimal: str,
    na_values: tuple[str, ...],
    size: int,
    notes: Sequence[Note] = (),
) -> Table:
    decimal = sheet.decimal if decimal == "." else decimal
    check_room(path, sheet.columns, sheet.line)
    text = {
        name: np.char.strip(np.array(cells).astype(str)) for name, cells in sheet.columns.items()
    }
    columns = {name: parsed(cells, decimal, na_values) for name, cells in text.items()}
    units = {name: unit and spelled(unit) for name, unit in sheet.units.items()}
    return Table(
        columns, text, sheet.line, units, str(path), hashlib.sha256(data).hexdigest(),
        (*notes, *sheet.notes), decimal, na_values, sheet.units, len(data) / size,
    )  # fmt: skip
