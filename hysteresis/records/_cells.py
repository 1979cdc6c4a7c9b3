"""Cells of a text file as numbers."""

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError

LONG_CELL, MOST_TEXT = 256, 256_000_000
"""Characters of a cell that never matter, and bytes of all columns of text with longer ones."""

LARGEST, LEAST_RANGE = 1e150, 1e-150
"""Beyond these no number is a measurement, and squares summed over rows overflow, or are 0."""

_FORTRAN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)D[+-]?\d+")
MISSING = ("", "nan", "na", "n/a", "null", "none", "-nan", "#n/a")
"""Words for a value that is not there, in small letters."""


def floats(cells: Sequence[str] | np.ndarray, decimal: str = ".") -> np.ndarray:
    """(n,) float64, NaN where a cell is no number."""
    x = np.asarray(cells)
    if x.dtype.kind not in "US":
        return x.astype(float)
    if _underscored(x):  # Python reads 1_5, a name, as 15
        x = np.where(np.char.find(x, "_") >= 0, "", x)
    if decimal == ",":
        x = np.where(np.char.count(x, ".") > 0, "", np.char.replace(x, ",", "."))
    try:
        return x.astype(float)
    except ValueError:
        return np.array([_float(c) for c in x.tolist()])


def _underscored(cells: np.ndarray) -> bool:
    """Whether some cell has an underscore: its characters are looked at as numbers, which is fast."""
    kind = np.uint32 if cells.dtype.kind == "U" else np.uint8
    return (
        bool((np.ascontiguousarray(cells).view(kind) == ord("_")).any())
        if cells.itemsize
        else False
    )


def _float(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:  # Fortran writes 1.5D+03
        return float(cell.replace("D", "e")) if _FORTRAN.fullmatch(cell) else np.nan


def missing(cells: np.ndarray, na_values: Collection[str]) -> np.ndarray:
    """(n,) bool: empty, a word for nothing, or one of `na_values`."""
    return np.isin(np.char.lower(cells), [*MISSING, *(v.strip().lower() for v in na_values)])


def parsed(cells: np.ndarray, decimal: str, na_values: Collection[str]) -> np.ndarray:
    """A column as (n,) float64, NaN where missing; as it is where a cell is neither."""
    if cells.itemsize > 4 * LONG_CELL:  # no number is that long, and every step would copy the text
        return cells
    if not na_values and decimal == "." and not _underscored(cells):
        try:  # the plain column, ten times faster than asking every cell what it is
            return cells.astype(float)
        except ValueError:
            pass
    empty = missing(cells, na_values)
    x = floats(np.where(empty, "nan", cells), decimal)
    if np.any(np.isnan(x) & ~empty):
        return cells
    return np.where(np.isin(x, floats([*na_values], decimal)), np.nan, x)  # -999 and -999.0 alike


def check_room(path: Path, columns: Mapping[str, Any], line: np.ndarray) -> None:
    """Raise `InputError` where long cells would make columns of text too large.

    An array of text gives every cell the room of the longest one, four bytes a character.
    """
    room = 0
    for name, cells in columns.items():
        if isinstance(cells, np.ndarray):  # its cells have their room already
            continue
        longest = max(map(len, cells), default=0)
        if longest <= LONG_CELL:
            continue
        room += 4 * longest * len(cells)
        if room > MOST_TEXT:
            k = next(k for k, cell in enumerate(cells) if len(cell) == longest)
            raise long_cell(path, int(line[k]), LONG_CELL, name)


def long_cell(path: Path, line: int, limit: int, column: str = "") -> InputError:
    return InputError(
        "long-cell",
        f"A cell has more than {limit:,} characters.",
        place=f"{path}, line {line}" + (f", column {column!r}" if column else ""),
        cause="a quotation mark that is not closed, or text among the numbers.",
        fix="close it, or leave that line or column out.",
    )
