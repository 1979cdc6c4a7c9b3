"""Table: the columns of a file as numbers and as text, before any of them is an input or an output."""

import re
from collections import UserDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from .._errors import InputError
from .._escape import shell_word
from .._verdict import Note
from ._abstract_record import AbstractRecord
from ._arrays import LARGEST, LONG_CELL, floats, missing, parsed
from ._compiled_rows import CompiledRows

_OVERLOAD = ("OVLD", "OVER", "OVERLOAD", "OVF", "OL", "SAT", "CLIP")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}([,.'\u2019\s]\d{3})+([.,]\d+)?")
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True, eq=False)
class Table:
    """The columns of one file as numbers and as text, before any of them is an input or an output.

    **Arguments:**

    - `columns`: (n,) float64 where every cell is a number or missing (NaN), else (n,) str. Dates, times of
      day and times since 1970 are seconds from the first row. Numbers of a large text are read-only.
    - `text`: (n,) str, every column as it is in the file, without the blanks around it. Of a large text
      it is made each time that it is asked for.
    - `line`: (n,) the line of each row, from 1.
    - `units`: from a row of units, by column; empty without one. `written_units`: as the file writes them.
    - `path`, `sha256`: the file; `notes`: a sentence for each thing that was not plain.
    - `decimal`, `na_values`: what the numbers were read with.
    - `share`: of the file's bytes, those that were read: 1, or less of an excerpt.
    - `row`: (n,) of some rows of another table, the place of each in it, from 0.
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
    share: float = 1.0
    row: np.ndarray | None = None

    def number(self, name: str, rows: np.ndarray | slice | None = None) -> np.ndarray:
        """A column, or those `rows` of it, as float64, NaN where missing.

        Only what is asked for has to be numbers. Raises `no-column`, or names the first cell that is
        none: `decimal-comma`, `thousands-separator`, `text-cell`, `not-finite`, `too-large`.
        """
        x, line = column_of(self, name), self.line
        text = None if x.dtype.kind == "f" else self.text[name]
        if rows is not None:
            x, line = x[rows], line[rows]
            if text is not None:
                text = text[rows]
                x = parsed(text, self.decimal, self.na_values)
        if x.dtype.kind == "f":
            bad = np.flatnonzero((x > LARGEST) | (x < -LARGEST))
            if not bad.size:
                return x
            text = self.text[name] if rows is None else self.text[name][rows]
            code = "not-finite" if np.isinf(x[bad[0]]) else "too-large"
            cause, fix = "a division by zero, or a marker for overload.", ""
        else:
            text = x if text is None else text
            unique, first = np.unique(text, return_index=True)
            wrong = np.isnan(floats(unique, self.decimal)) & ~missing(unique, self.na_values)
            wrong |= np.char.str_len(unique) > LONG_CELL  # which `parsed` takes for no number
            bad, words = np.sort(first[wrong]), unique[wrong].tolist()
            commas = self.decimal == "." and all(_COMMA.fullmatch(w) for w in words)
            both = [w for w in words if "," in w and re.search(r"[.'\u2019\s]", w)]
            grouped = [_THOUSANDS.fullmatch(w) or (both and _COMMA.fullmatch(w)) for w in words]
            if all(grouped):
                bad = bad[np.isin(text[bad], both)] if both else bad
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
                if self.decimal == "," and not np.isnan(floats(words)).any():
                    cause = "numbers written with a decimal point."
                    fix = 'decimal="." (leave --decimal away).'
                below = floats(text[bad[0] + 1 :][:1], self.decimal)  # a row of units: a number
                if line[bad[0]] == self.line[0] and not (fix or overload or np.isnan(below).any()):
                    cause = "a row of units?"
                    fix = f"units_row={line[0]} (--units-row {line[0]}) takes it for one; "
        k = bad[0]
        cell = str(text[k])
        if not fix or fix.endswith("; "):
            fix += f"na_values=[{cell!r}] (--na-values {shell_word(cell)}) reads it as missing."
        problem = f"{name!r} = {cell!r} cannot be used as a number."
        place = f"{self.path}, line {line[k]}, column {name!r}"
        raise InputError(code, problem, place=place, cause=cause, fix=fix)


class TextColumns(UserDict[str, Any]):
    """Columns of text that are made when they are asked for, and not kept.

    - `names`: of the columns; `make`: gives (n,) str for one of them.
    """

    def __init__(self, names: Iterable[str], make: Callable[[str], np.ndarray]):
        super().__init__(dict.fromkeys(names, make))

    def __getitem__(self, name: str) -> np.ndarray:
        return self.data[name](name)


def with_column(table: Table, name: str, values: np.ndarray, unit: str | None = None) -> Table:
    """A table with one more column, of numbers or of words."""

    def text(asked: str) -> np.ndarray:
        return values.astype(str) if asked == name else table.text[asked]

    units, written = (
        {**said, name: unit} if unit else said for said in (table.units, table.written_units)
    )
    return replace(
        table, columns={**table.columns, name: values}, text=TextColumns((*table.text, name), text),
        units=units, written_units=written,
    )  # fmt: skip


def rows_of(table: Table, rows: np.ndarray | slice) -> Table:
    """A table of these rows (n,) of another."""
    return replace(
        table,
        columns={name: x[rows] for name, x in table.columns.items()},
        text=TextColumns(table.text, lambda name: table.text[name][rows]),
        line=table.line[rows],
        row=places(table)[rows],
    )


OWN_ROW = "row of the table"
"""Column of a record with the places of its rows in the table, where that has several rows on one line."""


def places(table: Table) -> np.ndarray:
    """The place of each row (n,) in the table of the file."""
    return np.arange(len(table.line)) if table.row is None else table.row


def rows_read(table: Table, record: AbstractRecord) -> np.ndarray:
    """The rows (n,) of a table that a record of it holds: tables side by side share their lines."""
    own = record.columns.get(OWN_ROW)
    return np.searchsorted(table.line, record.line) if own is None else own


def followed(begun: Table, rows: CompiledRows) -> Table:
    """A table of the rows of `begun` and of those that follow them in a text. Raises `OddRowsError`."""
    names = list(begun.columns)
    numbers, line = rows.numbers(begun.columns)
    line[: len(begun.line)] = begun.line

    def text(name: str) -> np.ndarray:
        return np.concatenate([begun.text[name], rows.words(names.index(name))])

    columns = {name: numbers[name] if name in numbers else text(name) for name in names}

    def kept(name: str) -> np.ndarray:
        return text(name) if columns[name].dtype.kind == "f" else columns[name]

    return replace(begun, columns=columns, text=TextColumns(names, kept), line=line)


def column_of(table: "Table | AbstractRecord", name: str) -> np.ndarray:
    if name in table.columns:
        return table.columns[name]
    names = list(table.columns)
    alike = [x for x in names if name.lower() in x.lower()]
    have = dict.fromkeys([*alike, *get_close_matches(name, names, len(names), 0.4), *names])
    cause = headless(names)
    if isinstance(table, Table) and any(note.code == "no-header" for note in table.notes):
        first = ", ".join(repr(str(cells[0])) for cells in table.text.values())
        cause = f"the file has no header: its first line is {first}."
    fix = "give the exact header, with its unit (--input, --output, --time, --group, --each), or correct"
    fix += " it in the file."
    if "," in name and all(part.strip() in names for part in name.split(",")):
        fix = "name each column by itself (--input COL --input COL)."
    raise InputError(
        "no-header" if cause else "no-column",
        f"No column {name!r}; have {', '.join(map(repr, have))}.",
        place=getattr(table, "path", ""),
        cause=cause,
        fix=fix,
    )


def headless(names: Sequence[str]) -> str:
    """What is said where the names of all columns are numbers; "" where they are not."""
    numeric = bool(names) and not np.isnan(floats(names)).any()
    return "the file has no header: its first line is numbers." if numeric else ""
