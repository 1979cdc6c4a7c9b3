"""What a record is given, as rows of numbers of one length."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._errors import InputError
from .._quantities import conversion

PIECE = 2**16
"""Rows that are worked on at a time."""

REAL = "bifuO"
"""Kinds of arrays that may hold real numbers: not complex ones, dates, or words that look like numbers."""


def numbers(name: str, values: ArrayLike, keep: bool = False) -> np.ndarray:
    """A copy as float64, NaN where a masked array is masked. Raises `InputError` `not-numbers`.

    `keep`: what nobody can write to, such as a column of a large table, is given as it is.
    """
    try:
        given = np.ma.getdata(values) if np.ma.isMaskedArray(values) else np.asarray(values)
        kept = keep and given is values and given.dtype == float and _is_fixed(given)
        found = given if kept or given.dtype.kind in "cmM" else np.array(given, float)
        problem = "" if given.dtype.kind in REAL else f"it holds {given.dtype.name}"
    except (TypeError, ValueError) as error:
        found, problem = np.empty(0), str(error)
    if problem:
        raise InputError(
            "not-numbers", f"{name} is not a row of numbers: {problem}.", fix="give real numbers."
        )
    if np.ma.isMaskedArray(values):
        found[np.ma.getmaskarray(values)] = np.nan
    return found


def _is_fixed(array: Any) -> bool:
    while isinstance(array, np.ndarray) and not array.flags.writeable:
        array = array.base
    return array is None


def pieces(count: int) -> Iterator[slice]:
    """So many rows, some thousands at a time: what is made of them then takes no memory to speak of."""
    yield from (slice(at, min(at + PIECE, count)) for at in range(0, count, PIECE))


def in_pieces(make: Callable[..., np.ndarray], x: np.ndarray, *more: float) -> np.ndarray:
    """What `make` makes of each row, some thousands at a time."""
    return np.concatenate([make(x[rows], *more) for rows in pieces(len(x))])


def in_rows(kept: np.ndarray, *arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Arrays in the rows (n,) bool that are kept: as they are where all are, as a mask makes copies."""
    return arrays if kept.all() else tuple(x[kept] for x in arrays)


def named_columns(columns: Any, asked: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of a data frame, which may number them, a mapping or an array with named fields.

    Raises `InputError` `no-column`, `given-twice`.
    """
    fields = columns.dtype.names if isinstance(columns, np.ndarray) else None
    every = columns if isinstance(columns, Mapping) else fields or getattr(columns, "columns", ())
    names = {str(name): name for name in every}
    for name in asked:
        if name not in names:
            near = ", ".join(get_close_matches(name, names, 5, 0.0))
            have = near or f"none: a {type(columns).__name__} has no named columns"
            raise InputError("no-column", f"No column {name!r}; have {have}.")
    found = {name: np.asanyarray(columns[names[name]]) for name in asked}
    if twice := [name for name, x in found.items() if x.ndim > 1]:
        raise InputError("given-twice", f"Column {twice[0]!r} is there twice.", fix="rename one.")
    return found


def tell_nothing(sigma: np.ndarray) -> np.ndarray:
    """Rows (n,) bool whose sigma is above 1,000 times the median: a million of them weigh as one."""
    known = sigma[sigma > 0]
    return np.isfinite(sigma) & (sigma > 1e3 * np.median(known if len(known) else 1.0))


def times(values: ArrayLike, unit: str = "s") -> np.ndarray:
    """Times as float64, dates in a unit from the first one. Raises `InputError` `not-numbers`."""
    given = np.asarray(values)
    if given.size and isinstance(given.flat[0], datetime | timedelta):  # as of a time zone
        given = np.array([x - given.flat[0] for x in given.flat], "timedelta64[ns]")
    is_dates = given.size and given.dtype.kind in "mM"
    if not is_dates or (factor := conversion("s", unit)) is None:
        return numbers("time", values, keep=True)
    return (given - given.flat[0]) / np.timedelta64(1, "s") * factor


def same_length(**arrays: np.ndarray | None) -> None:
    """Raise `InputError` `length-mismatch` where one is no row, or they differ."""
    shapes = {name: x.shape for name, x in arrays.items() if x is not None}
    if any(len(shape) != 1 for shape in shapes.values()):
        raise InputError("length-mismatch", f"Each must be one row of numbers; have {shapes}.")
    (name, (n,)), *rest = shapes.items()
    for other, (m,) in rest:
        if m != n:
            raise InputError("length-mismatch", f"{name} has {n} values, {other} {m}.")


def fill(x: np.ndarray, t: np.ndarray) -> None:
    """Put straight lines over `t` where `x` is not finite, and the nearest value at its ends."""
    good = np.isfinite(x)
    if good.any():
        x[~good] = np.interp(t[~good], t[good], x[good])


# Cells of a text file as numbers.

LONG_CELL, MOST_TEXT = 256, 256_000_000
"""Characters of a cell that never matter, and bytes of all columns of text with longer ones."""

LARGEST, LEAST_RANGE = 1e150, 1e-150
"""Beyond these no number is a measurement, and squares summed over rows overflow, or are 0."""

LARGE = 1e20
"""Beyond this a number far from all others is a mark."""

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
    return np.where(np.isin(x, marked(na_values, decimal)), np.nan, x)  # -999 and -999.0 alike


def marked(na_values: Collection[str], decimal: str) -> np.ndarray:
    """The numbers among `na_values`, also with a point beside decimal commas, as messages write them."""
    return np.append(floats([*na_values], decimal), floats([*na_values]))


_MARK = re.compile(r"[67]?9{2,}(\.9+)?|9(\.9\d*)?e\+\d+")
"""Numbers that programs write where they have no reading: in nines, as -9999 and 9.9e37."""

FEWEST = 8
"""Different readings from which on their range is known."""


def marks(x: np.ndarray) -> list[float]:
    """The numbers of a column (n,) that stand for a missing one: in nines, or too large for a reading, and
    farther from all others than these lie apart."""
    ends = {float(end.reduce(x)) for end in (np.fmin, np.fmax)} if x.size else set[float]()
    written = {one: _MARK.fullmatch(f"{abs(one):.15g}") for one in sorted(ends)}
    ends = [one for one, nines in written.items() if nines or LARGE < abs(one) <= LARGEST]
    others = np.unique(x[np.isfinite(x) & ~np.isin(x, ends)]) if ends else x[:0]
    if len(others) < FEWEST:
        return []
    return [one for one in ends if max(others[0] - one, one - others[-1]) > np.ptp(others)]


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
