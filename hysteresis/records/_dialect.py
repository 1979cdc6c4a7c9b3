"""The header of a CSV, and rows that are all as long as that."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .._errors import InputError
from ._cells import floats
from .importers._sheet import trimmed

MOST_COLUMNS = 10_000


def header_of(path: Path, cells: list[str]) -> list[str]:
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


def made_square(path: Path, rows: list[list[str]], line: np.ndarray, width: int, sep: str) -> None:
    """Makes every row `width` cells long by dropping empty cells at its end, or names the line."""
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


def headless(names: Sequence[str]) -> str:
    """What is said where the names of all columns are numbers; "" where they are not."""
    numeric = bool(names) and not np.isnan(floats(names)).any()
    return "the file has no header: its first line is numbers." if numeric else ""
