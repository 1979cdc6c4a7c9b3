"""Readings through a law around a tree, which says more than the estimate."""

from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from . import _over_time as over_time
from ._numbers import Known, Numbers
from ._readings import INVALID
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
    rows = y.shape[:1]
    kinds = [
        jax.ShapeDtypeStruct(shape, kind)
        for shape, kind in zip((rows, rows, (*rows, width), state.shape, ()), "dqddd", strict=True)
    ]
    host = partial(_told, numbers.known, width)
    return Told(*on_host(host, kinds, numbers.m, state, t, held, times, y))


def _told(known: Known, width: int, m: Any, *given: Any) -> tuple[Any, ...]:
    state, t, held, times, y = map(np.asarray, given)
    numbers = Numbers(known, np.asarray(m, float)).with_state(state)
    reading, count = y[:, 0] if y.ndim == 2 else y, len(y)
    rows = np.flatnonzero(np.isfinite(reading) & np.isfinite(times))
    passed, dt = np.diff(times[rows], prepend=t), np.zeros(count)
    dt[rows] = np.where(passed > 0.0, passed, 0.0)
    value, status, said = np.empty(count), np.full(count, float(INVALID)), np.empty((count, width))
    m = over_time.through("find_told", numbers, y, dt, (value, status, said))
    latest = np.full(count, -1)
    latest[rows] = rows
    latest = np.maximum.accumulate(latest)
    value = np.where(latest < 0, held, value[latest]) if count else value
    last = times[rows[-1]] if len(rows) else t
    return value, status.astype(int), said, Numbers(known, m).state, np.asarray(last)
