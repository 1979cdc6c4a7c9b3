"""What a record is given, as rows of numbers of one length."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from difflib import get_close_matches
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

    Raises `InputError` `no-column`.
    """
    fields = columns.dtype.names if isinstance(columns, np.ndarray) else None
    every = columns if isinstance(columns, Mapping) else fields or getattr(columns, "columns", ())
    names = {str(name): name for name in every}
    for name in asked:
        if name not in names:
            near = ", ".join(get_close_matches(name, names, 5, 0.0))
            have = near or f"none: a {type(columns).__name__} has no named columns"
            raise InputError("no-column", f"No column {name!r}; have {have}.")
    return {name: np.asanyarray(columns[names[name]]) for name in asked}


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
