"""Readings through a law around a tree, which says more than the estimate, or through one law alone."""

from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from .._parameter import array_module
from . import _over_time as over_time
from ._numbers import Known, Numbers
from ._readings import INVALID, spread
from ._text import EACH
from ._traced import on_host


class Told(NamedTuple):
    """Estimates, their status, and what the law says beside them, (rows, numbers); the state and the time
    of the last reading after them."""

    value: Any
    status: Any
    said: Any
    state: Any
    t: Any


def told(
    numbers: Numbers, state: Any, t: Any, held: Any, times: Any, y: Any, *, width: int
) -> Told:
    """Estimates from a `state`, behind readings y, (rows,) or beside a condition (rows, 2).

    A reading that is not finite is none: the last estimate is held, at first `held`, and its time is added
    to the next one's. `t` is that of the last reading, NaN where nothing came before. `width`: how much the
    law says. Without derivatives.
    """
    given = numbers.m, state, t, held, times, y
    return Told(*_on_host(partial(_told, numbers.known, "find_told", width), width, given))


def each(
    numbers: Numbers,
    function: str,
    *columns: Any,
    state: Any = None,
    t: Any = np.nan,
    held: Any = np.nan,
    times: Any = None,
    where: Any = None,
    keeps: tuple[str, ...] = (),
) -> Told:
    """What a function of one law gives row by row, of columns in the order of its arguments.

    As `told`, where a row without a finite number in `where` (the first column by default) is no reading.
    `keeps`: which numbers of the law's state are said.
    """
    where = columns[0] if where is None else where
    xp = array_module(numbers.m, *columns)
    times = xp.zeros(where.shape) if times is None else times
    state = numbers.state if state is None else state
    rows = xp.stack([xp.asarray(x, float) for x in columns], 1)
    given = numbers.m, state, t, held, times, where, rows
    host = partial(_told, numbers.known, EACH + "_".join([function, *keeps]), len(keeps))
    return Told(*_on_host(host, len(keeps), given))


def _on_host(host: Any, width: int, given: tuple[Any, ...]) -> Any:
    rows, state = given[5].shape[:1], given[1].shape
    shapes = (rows, rows, (*rows, width), state, ())
    kinds = [jax.ShapeDtypeStruct(*one) for one in zip(shapes, "dqddd", strict=True)]
    return on_host(host, kinds, *given)


def _told(
    known: Known, wanted: str, width: int, m: Any, state: Any, t: Any, held: Any, times: Any, y: Any,
    *columns: Any,
) -> tuple[Any, ...]:  # fmt: skip
    state, t, held, times, y = map(np.asarray, (state, t, held, times, y))
    numbers = Numbers(known, np.asarray(m, float)).with_state(state)
    reading, count = y[:, 0] if y.ndim == 2 else y, len(y)
    valid = np.isfinite(reading) & np.isfinite(times)
    rows, y = np.flatnonzero(valid), np.where(valid if y.ndim == 1 else valid[:, None], y, np.nan)
    passed, dt = np.diff(times[rows], prepend=t), np.zeros(count)
    dt[rows] = np.where(passed > 0.0, passed, 0.0)
    value, status, said = np.empty(count), np.full(count, float(INVALID)), np.empty((count, width))
    outputs = value, status, said, *(np.ascontiguousarray(x, float) for x in columns)
    m = over_time.through(wanted, numbers, y, dt, outputs)
    value = spread(value[rows], valid, held)
    last = times[rows[-1]] if len(rows) else t
    return value, status.astype(int), said, Numbers(known, m).state, np.asarray(last)
