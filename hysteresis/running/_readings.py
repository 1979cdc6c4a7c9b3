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
    """Readings alone, the time since the one before, and for each row the latest reading: -1 before the
    first one."""

    rows: np.ndarray
    y: np.ndarray
    dt: np.ndarray
    latest: np.ndarray


def estimated(numbers: Numbers, y: Any, dt: Any, held: Any) -> Estimated:
    """The inputs behind readings y, (rows,) or (rows, 2) with a condition.

    A row that is not finite is no reading: the last estimate is held, and its time is added to the next
    one's. The first dt is NaN where nothing came before; then the first reading's is 0, whenever it comes.
    """
    valid = _valid(y, dt)
    found = over_time.find(numbers, valid.y, valid.dt)
    value = np.where(valid.latest < 0, held, _at(found.value, valid.latest))
    status = np.full(len(value), INVALID)
    status[valid.rows] = found.status
    return Estimated(value, status, found.m)


def tangents_of(numbers: Numbers, dm: np.ndarray, y: Any, dt: Any, dy: Any) -> np.ndarray:
    """Derivatives of the estimates, (rows, columns): in directions dm of numbers, dy of readings."""
    valid = _valid(y, dt)
    dy = None if dy is None else np.asarray(dy)[valid.rows]
    found = over_time.tangents(numbers, dm, valid.y, valid.dt, dy, inverse=True).columns
    return np.where(valid.latest[:, None] < 0, 0.0, _at(found, valid.latest))


def _valid(y: Any, dt: Any) -> _Valid:
    y, dt = np.asarray(y, float), np.asarray(dt, float)
    finite = np.isfinite(y) if y.ndim == 1 else np.isfinite(y).all(axis=1)
    rows = np.flatnonzero(finite)
    latest = np.maximum.accumulate(np.where(finite, np.arange(len(y)), -1)) if len(y) else rows
    passed = np.nan_to_num(dt, nan=0.0)
    if len(rows) < len(y):
        until = np.append(0.0, np.cumsum(passed))
        passed = np.diff(until[rows + 1], prepend=0.0)
    passed = np.maximum(passed, 0.0)  # a clock that steps back: no time has passed
    if len(rows) and np.isnan(dt[0]):
        passed[0] = np.nan
    order = np.cumsum(finite) - 1
    return _Valid(rows, y[rows], passed, np.where(latest < 0, -1, order[latest]))


def _at(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Values at indices; anything at those before the first."""
    return values[index] if len(values) else np.zeros((len(index), *values.shape[1:]))
