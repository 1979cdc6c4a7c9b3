"""The inverse of a tree over readings of which some may be missing, and the tangents of its estimates."""

from typing import Any, NamedTuple

import numpy as np

from . import _over_time as over_time
from ._numbers import Numbers

INVALID = 5
"""The status of a reading that is not a number, as in `compensate.Status`."""


class Estimated(NamedTuple):
    """Estimates, their status, and the numbers m after the last one."""

    value: np.ndarray
    status: np.ndarray
    m: np.ndarray


class _Valid(NamedTuple):
    """Which rows are readings, these alone, and the time since the one before."""

    valid: np.ndarray
    y: np.ndarray
    dt: np.ndarray


def estimated(numbers: Numbers, y: Any, dt: Any, held: Any) -> Estimated:
    """The inputs behind readings y, (rows,) or (rows, 2) with a condition.

    A row that is not finite is no reading: the last estimate is held, and its time is added to the next
    one's. The first dt is NaN where nothing came before; then the first reading's is 0, whenever it comes.
    """
    valid, y, dt = _valid(y, dt)
    found = over_time.find(numbers, y, dt)
    status = np.full(len(valid), INVALID)
    status[valid] = found.status
    return Estimated(spread(found.value, valid, held), status, found.m)


def tangents_of(numbers: Numbers, dm: np.ndarray, y: Any, dt: Any, dy: Any) -> np.ndarray:
    """Derivatives of the estimates, (rows, columns): in directions dm of numbers, dy of readings."""
    valid, y, dt = _valid(y, dt)
    dy = None if dy is None else np.asarray(dy)[valid]
    return spread(over_time.tangents(numbers, dm, y, dt, dy, inverse=True).columns, valid, 0.0)


def spread(values: np.ndarray, valid: np.ndarray, first: Any) -> np.ndarray:
    """Values of the valid rows for all: between them the one before, at first `first`, one or many."""
    index = np.cumsum(valid)
    found = np.concatenate([np.zeros((1, *values.shape[1:])), values])[index]
    found[index == 0] = np.broadcast_to(first, found.shape)[index == 0]
    return found


def _valid(y: Any, dt: Any) -> _Valid:
    y, dt = np.asarray(y, float), np.asarray(dt, float)
    finite = np.isfinite(y) if y.ndim == 1 else np.isfinite(y).all(axis=1)
    rows = np.flatnonzero(finite)
    passed = np.nan_to_num(dt, nan=0.0)
    if len(rows) < len(y):
        until = np.append(0.0, np.cumsum(passed))
        passed = np.diff(until[rows + 1], prepend=0.0)
    passed = np.maximum(passed, 0.0)  # a clock that steps back: no time has passed
    if len(rows) and np.isnan(dt[0]):
        passed[0] = np.nan
    return _Valid(finite, y[rows], passed)
