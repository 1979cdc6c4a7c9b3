"""JSON as loggers write it: an object for each row, line by line or in a list, or one of whole columns.

Keys name the columns. What is nested gets the names of its keys, or its places, joined by points.
"""

import json
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ..._note import Note
from ._file import fault
from ._sheet import Sheet, distinct

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
        return Sheet(whole, np.ones(length, int), {}, _notes(len(whole), length, notes))
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
