"""Reading a test rig's CSV: every fault is answered with its line, its column and its remedy."""

import csv
import hashlib
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import reduce
from pathlib import Path
from typing import Literal

import numpy as np

from .._errors import InputError
from .._note import Note
from ._cells import check_room, floats, long_cell, missing, parsed
from ._dialect import header_of, headless, made_square, separator_of, trimmed
from ._record import Record
from ._two_clocks import on_one_clock
from ._units import are_units, bare_unit, column_unit, spelled
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

_OVERLOAD = ("OVLD", "OVER", "OVERLOAD", "OVF", "OL", "SAT", "CLIP")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}([,.' ]\d{3})+([.,]\d+)?")
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True, eq=False)
class Table:
    """The columns of one file, before anything is made of them.

    **Arguments:**

    - `columns`: (n,) float64 where every cell is a number or missing (NaN), else (n,) str.
    - `text`: (n,) str, every column as it stands in the file, blanks stripped.
    - `line`: (n,) the line of each row, from 1.
    - `units`: from a row of units, by column; empty without one. `written_units`: as the file writes them.
    - `path`, `sha256`: the file; `notes`: a sentence for each thing that was not plain.
    - `decimal`, `na_values`: what the numbers were read with.

    **Example:**

        >>> table = hysteresis.read_table(datasets / "sponge-50mm-cycles.csv")
        >>> table.number("force (N)")[:3].tolist()
        [0.0, 2.0, 4.0]
    """

    columns: Mapping[str, np.ndarray]
    text: Mapping[str, np.ndarray]
    line: np.ndarray
    units: Mapping[str, str]
    path: str
    sha256: str
    notes: tuple[Note, ...]
    decimal: str = "."
    na_values: tuple[str, ...] = ()
    written_units: Mapping[str, str] = field(default_factory=dict)

    def number(self, name: str, rows: np.ndarray | None = None) -> np.ndarray:
        """A column, or those `rows` (n,) of it, as float64, NaN where missing.

        Only what is asked for has to be numbers. Raises `no-column`, or names the first cell that is
        none: `decimal-comma`, `thousands-separator`, `text-cell`, `not-finite`, `too-large`.
        """
        x, text, line = _column(self, name), self.text[name], self.line
        if rows is not None:
            x, text, line = x[rows], text[rows], line[rows]
            if x.dtype.kind != "f":
                x = parsed(text, self.decimal, self.na_values)
        if x.dtype.kind == "f":
            # 1e150 is no measurement, and its square, summed over rows, overflows.
            bad = np.flatnonzero(np.abs(x) > 1e150)
            if not bad.size:
                return x
            code = "not-finite" if np.isinf(x[bad[0]]) else "too-large"
            cause, fix = "a division by zero, or a marker for overload.", ""
        else:
            unique, first = np.unique(text, return_index=True)
            wrong = np.isnan(floats(unique, self.decimal)) & ~missing(unique, self.na_values)
            bad, words = np.sort(first[wrong]), unique[wrong].tolist()
            commas = self.decimal == "." and all(_COMMA.fullmatch(w) for w in words)
            if all(_THOUSANDS.fullmatch(w) for w in words):
                code, cause = "thousands-separator", "numbers written with thousands separators"
                cause += " or with a decimal comma." if commas else "."
                fix = "export without thousands separators"
                fix += (
                    '; where they are decimal commas, decimal="," (--decimal ,).' if commas else "."
                )
            elif commas:
                code, cause = "decimal-comma", "numbers written with a decimal comma."
                fix = 'decimal="," (--decimal ,).'
            else:
                code, fix = "text-cell", ""
                overload = str(text[bad[0]]).upper() in _OVERLOAD
                cause = "sensor overload?" if overload else "text among the numbers."
                if line[bad[0]] == self.line[0] and not overload:
                    cause = "a row of units?"
                    fix = f"units_row={line[0]} (--units-row {line[0]}) takes it for one; "
        k = bad[0]
        cell = str(text[k])
        if not fix or fix.endswith("; "):
            fix += f"na_values=[{cell!r}] (--na-values {cell}) reads it as missing."
        problem = f"{name!r} = {cell!r} is no number that can be used."
        place = f"{self.path}, line {line[k]}, column {name!r}"
        raise InputError(code, problem, place=place, cause=cause, fix=fix)


def read_table(
    path: str | Path,
    *,
    decimal: str = ".",
    separator: str | None = None,
    units_row: int | None = None,
    na_values: Collection[str] = (),
    dialects: str | Path | None = None,
    table: int | None = None,
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
    data = file_bytes(path)
    read_with = decimal, tuple(na_values)
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
        (*notes, *sheet.notes), decimal, na_values, sheet.units,
    )  # fmt: skip


def read_csv(
    path: str | Path | Table,
    input: str | Sequence[str],
    output: str,
    time: str | None = None,
    dt: float | None = None,
    group: str | Sequence[str] | None = None,
    where: Mapping[str, Sequence[str]] | None = None,
    nan: Literal["raise", "omit", "interpolate"] = "raise",
    decimal: str = ".",
    separator: str | None = None,
    units_row: int | None = None,
    na_values: Collection[str] = (),
    input_unit: str | None = None,
    output_unit: str | None = None,
    time_unit: str | None = None,
    keep: Sequence[str] = (),
    segments: Literal["auto"] | None = None,
    input_time: str | None = None,
    condition: Sequence[str] = (),
) -> Record:
    """A `Record` from a CSV file, or from a `Table` already read.

    **Arguments:**

    - `input`, `output`, `time`: columns by their exact headers. Units come from "Force (N)",
        "Force [N]", "force_N", a row of units, or `input_unit`, `output_unit`, `time_unit`;
        without any the unit is "1", noted. Several inputs are channels that `fit` combines.
    - `dt`: step in seconds where there is no time column: `t = k dt` within each sequence.
    - `group`: column(s) whose values name independent sequences, joined by "/".
    - `where`: `{column: values}`, the rows to use; numbers compare as numbers.
    - `nan`: "raise"; "omit" masks rows without output, history still runs over them, and drops rows that
        have neither input nor output, unless `dt` counts them; "interpolate" fills them linearly.
    - `keep`: further columns to carry along in `Record.columns`.
    - `segments`: "auto" starts a new sequence wherever time goes back.
    - `input_time`: the clock of the input(s), where it is another than that of the output, which is
        then `time`: the input is interpolated linearly to the output's times.
    - `condition`: columns such as a temperature or a pressure, on which the output depends too.
    - `decimal`, `separator`, `units_row`, `na_values`: see `read_table`.

    **Raises:** `InputError` as `read_table` and `Record` do, and `no-column`, `no-match`,
    `text-cell`, `decimal-comma`, `thousands-separator`, `not-finite`, `too-large`,
    `unknown-unit`, `wrong-unit`, `bad-option`.

    **Example:**

        >>> file = datasets / "sponge-50mm-cycles.csv"
        >>> record = hysteresis.read_csv(file, "force (N)", "displacement (mm)", "time (s)")
        >>> len(record), record.input_unit, record.output_unit
        (101, 'N', 'mm')
    """
    if isinstance(path, Table):
        table = path
    else:
        table = read_table(
            path, decimal=decimal, separator=separator, units_row=units_row, na_values=na_values
        )
    if dt is not None and (time is not None or not 0 < dt < np.inf):
        problem = f"time={time!r}, dt={dt!r}: give one of them, and a step above 0."
        raise InputError("bad-option", problem, fix="--time COL, or --dt SECONDS.")
    if nan not in ("raise", "omit", "interpolate"):
        raise InputError("bad-option", f"nan={nan!r}.", fix="--nan raise, omit or interpolate.")
    notes, units = list(table.notes), {}
    inputs = [input] if isinstance(input, str) else list(input)
    if not inputs or len(set(inputs)) < len(inputs):
        twice = ", ".join(sorted({repr(name) for name in inputs if inputs.count(name) > 1}))
        problem = f"Input {twice} is given twice." if inputs else "No input is given."
        raise InputError("given-twice", problem, fix="give each channel once (--input COL).")
    given = [("input", name, input_unit) for name in inputs] + [("output", output, output_unit)]
    if time is not None:
        given.append(("time", time, time_unit))
    given += [("condition", name, None) for name in condition]
    for role, name, unit in given:
        _column(table, name)
        units[role, name], note = column_unit(name, role, unit, table.units.get(name), table.path)
        notes += note
    channels = {name: units["input", name] for name in inputs} if len(inputs) > 1 else {}
    named = {} if channels else {"input_name": inputs[0], "input_unit": units["input", inputs[0]]}
    said = repr(inputs[0]) if named else f"{len(inputs)} channels"
    rows = np.ones(len(table.line), bool)
    for name, values in (where or {}).items():
        rows &= _matching(table, name, [str(v) for v in values])
    asked = " and ".join(f"{name}={','.join(map(str, v))}" for name, v in (where or {}).items())
    if not rows.any():
        raise InputError("no-match", f"No row has {asked}.", place=table.path)
    if not rows.all():
        notes.append(Note("selected", f"Used {rows.sum()} of {len(rows)} rows: {asked}."))
    if nan == "omit" and dt is None and input_time is None:
        cells = [np.isnan(table.number(name, rows)) for name in (*inputs, output)]
        empty = np.flatnonzero(rows)[np.logical_and.reduce(cells)]
        if 0 < len(empty) < rows.sum():
            rows[empty] = False
            without = f"Left out {len(empty)} rows that have neither {said} nor {output!r}."
            notes.append(Note("skipped", without))
    names = [group] if isinstance(group, str) else list(group or ())
    for name in (*names, *keep):
        _column(table, name)
    groups = None
    if names:
        parts = [table.text[name][rows] for name in names]
        groups = reduce(lambda a, b: np.char.add(np.char.add(a, "/"), b), parts)
    t = None if time is None else table.number(time, rows)
    moved = {name: table.number(name, rows) for name in (*inputs, *condition)}
    if input_time is not None:
        if t is None:
            problem = f"The input's clock is {input_time!r}, and the output's is not given."
            raise InputError("bad-option", problem, fix="--time COL, the clock of the output.")
        own = table.number(input_time, rows)
        moved, note = on_one_clock(moved, own, t, groups, input_time, time or "")
        notes.append(note)
        if (ended := np.isnan(t) & np.isnan(table.number(output, rows))).any():  # before the input
            rows[np.flatnonzero(rows)[ended]] = False
            moved, t = {name: x[~ended] for name, x in moved.items()}, t[~ended]
            groups = None if groups is None else groups[~ended]
    return Record.from_arrays(
        moved[inputs[0]] if named else None,
        table.number(output, rows),
        t,
        groups,
        dt=dt,
        line=table.line[rows],
        segments=segments,
        nan=nan,
        history=(Note("read", f"Read {rows.sum()} rows: {said} -> {output!r}."), *notes),
        columns={name: table.columns[name][rows] for name in keep}
        | {name: moved[name] for name in (*channels, *condition)},
        channels=channels,
        conditions={name: units["condition", name] for name in condition},
        output_name=output,
        time_name=time or "time",
        output_unit=units["output", output],
        time_unit=units.get(("time", time), time_unit or "s"),
        source=table.path,
        sha256=table.sha256,
        **named,
    )


def parse_condition(text: str) -> Callable[[Table | Record], np.ndarray]:
    """ "COL=VALUE[,VALUE]" or "COL%2=0" as a function of a table or record: its rows (n,) bool.

    Numbers compare as numbers: `run=4` holds for "4" and 4.0. The function raises `no-column`,
    and `no-match` where a value occurs nowhere. Raises `bad-condition`.

    **Example:**

        >>> table = hysteresis.read_table(datasets / "sponge-50mm-cycles.csv")
        >>> rows = hysteresis.parse_condition("cycle=2,3")(table)
        >>> int(rows.sum())
        40
    """
    name, equals, right = text.partition("=")
    name, values = name.strip(), [v.strip() for v in right.split(",")]
    if not (name and equals and all(values)):
        mend = "write COL=VALUE[,VALUE] or COL%2=0."
        raise InputError("bad-condition", f"{text!r} is no condition on a column.", fix=mend)
    stem, _, modulus = name.rpartition("%")

    def rows(table: Table | Record) -> np.ndarray:
        if stem and modulus.isdigit() and int(modulus) and name not in table.columns:
            return np.isin(np.mod(floats(_column(table, stem)), int(modulus)), floats(values))
        return _matching(table, name, values)

    return rows


def _matching(table: Table | Record, name: str, values: Sequence[str]) -> np.ndarray:
    words, inverse = np.unique(_column(table, name), return_inverse=True)
    numbers, found = floats(words), np.zeros(len(words), bool)
    for value, number in zip(values, floats(values), strict=True):
        hit = (words.astype(str) == value) | (numbers == number)
        if not hit.any():
            known = [f"{w:g}" if isinstance(w, float) else str(w) for w in words.tolist()]
            near = ", ".join(get_close_matches(value, known, 5, 0.0))
            problem = f"No row has {name}={value}; nearest: {near}."
            place = table.path if isinstance(table, Table) else table.source
            raise InputError("no-match", problem, place=place)
        found |= hit
    return found[inverse]


def _column(table: Table | Record, name: str) -> np.ndarray:
    if name in table.columns:
        return table.columns[name]
    names = list(table.columns)
    alike = [x for x in names if name.lower() in x.lower()]
    have = dict.fromkeys([*alike, *get_close_matches(name, names, len(names), 0.4), *names])
    cause = headless(names)
    if isinstance(table, Table) and any(note.code == "no-header" for note in table.notes):
        first = ", ".join(repr(str(cells[0])) for cells in table.text.values())
        cause = f"the file has no header: its first line is {first}."
    raise InputError(
        "no-header" if cause else "no-column",
        f"No column {name!r}; have {', '.join(map(repr, have))}.",
        place=getattr(table, "path", ""),
        cause=cause,
        fix="give the exact header, with its unit (--input, --output, --time, --group, --each).",
    )
