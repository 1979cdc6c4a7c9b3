"""A tree of laws over a record: outputs, the inputs behind outputs, and the tangents of both.

Compiling a tree that this machine has not seen takes seconds, which a short record is not worth. How much
is still to come is not known, so plain Python goes on until it has taken as long as compiling would: no
more than twice the time of whoever had known (the ski-rental problem; Karlin et al. 1988).
"""

from typing import Any, NamedTuple

import numpy as np

from ._compiled import available, is_kept, loop_of, reals_of, table_of
from ._memory_sizes import NONE, WIDE, WIDELY
from ._numbers import Numbers, Structure
from ._plain import Rows, advance

LINE = 8
"""Reals in a line of the cache."""

COMPILING = {True: 0.3, False: 3.0}
"""Seconds until a loop is there: from disk, or compiled."""

_spent: dict[tuple[Structure, str], float] = {}
"""By trees that are not compiled yet, in plain Python."""


class Ran(NamedTuple):
    """Outputs, or inputs with their status; and the numbers m after the last row."""

    value: np.ndarray
    status: np.ndarray
    m: np.ndarray


class Tangents(NamedTuple):
    """As `Ran`, and the derivatives in each direction, (rows, columns)."""

    value: np.ndarray
    status: np.ndarray
    columns: np.ndarray


def run(numbers: Numbers, x: Any, dt: Any) -> Ran:
    """Outputs at every input, (rows,) or, with a condition, (rows, 2), dt after the row before. A sequence
    begins where dt is NaN, or negative: so long after the first state."""
    return _over_time("run", numbers, _rows(x, dt))


def find(numbers: Numbers, y: Any, dt: Any) -> Ran:
    """The inputs behind outputs."""
    return _over_time("find", numbers, _rows(y, dt))


def _over_time(wanted: str, numbers: Numbers, rows: Rows) -> Ran:
    key, count = (numbers.known.structure.bare, wanted), len(rows.x)
    first, m = _own(numbers.m), np.array(numbers.m, float)
    value, status = np.empty(count), np.zeros(count)
    outputs = (value, status) if wanted == "find" else (value,)
    left = (COMPILING[is_kept(*key)] if available() else np.inf) - _spent.get(key, 0.0)
    done = 0
    if left > 0:
        numbers = numbers._replace(m=first)
        done, taken = advance(wanted, numbers, m, rows, outputs, left)
        _spent[key] = _spent.get(key, 0.0) + taken
    if done < count:
        rest = Rows(*(column[done:] for column in rows))
        loop_of(*key)(
            m, numbers.known.n, first, len(m), rest.x, rest.dt, rest.condition, count - done,
            *(column[done:] for column in outputs),
        )  # fmt: skip
    return Ran(value, status.astype(int), m)


def tangents(
    numbers: Numbers,
    dm: np.ndarray,
    x: Any,
    dt: Any,
    dx: np.ndarray | None = None,
    *,
    inverse: bool = False,
    kept: tuple[int, int] = (0, 1),
) -> Tangents:
    """Outputs, or with `inverse` inputs, and their tangents: dm (numbers, columns) and dx (rows, columns)
    are those of the numbers, and of what is given. `kept`: the first row of outputs whose tangents are
    kept, and from one to the next of them."""
    first, m, rows = _own(numbers.m), np.array(numbers.m, float), _rows(x, dt)
    (size, columns), count = dm.shape, len(rows.x)
    width = -(-(columns + inverse) // WIDE) * WIDE
    others = reals_of(numbers.known.structure)
    D, dfirst = _aligned(others + size, width), np.zeros((size, width))
    dfirst[:, :columns] = dm
    spots = np.append(np.full(others, NONE), _spots(dm))
    value, status = np.empty(count), np.zeros(count)
    found = np.empty((len(range(kept[0], count, kept[1])), columns))
    given = np.zeros((1, 1)) if dx is None else _own(dx)
    outputs = (value, status, found, np.empty(2 * size)) if inverse else (*kept, value, found)
    loop_of(numbers.known.structure, "find_tangents" if inverse else "tangents")(
        m, numbers.known.n, first, size, rows.x, rows.dt, rows.condition, count,
        table_of(D, spots), D, width, columns, dfirst, int(dx is not None), given, *outputs,
    )  # fmt: skip
    return Tangents(value, status.astype(int), found)


def _aligned(rows: int, width: int) -> np.ndarray:
    """Zeros, of which no four columns lie in two lines of the processor's cache: that doubles the speed."""
    room = np.zeros(rows * width + LINE)
    begin = -room.ctypes.data // room.itemsize % LINE
    return room[begin : begin + rows * width].reshape(rows, width)


def _spots(dm: np.ndarray) -> np.ndarray:
    """The column in which a number is the direction, see `_memory.py`."""
    moved = np.count_nonzero(dm, axis=1)
    alone = (moved == 1) & (dm.sum(axis=1) == 1.0)
    found = np.where(moved == 0, NONE, WIDELY)
    return np.where(alone, dm.argmax(axis=1) if dm.shape[1] else NONE, found)


def _rows(x: Any, dt: Any) -> Rows:
    """Without a condition the input stands in its place, where nothing looks at it."""
    x = np.asarray(x, float)
    own, condition = (x[:, 0], x[:, 1]) if x.ndim == 2 else (x, x)
    return Rows(_own(own), _own(dt), _own(condition))


def _own(x: Any) -> np.ndarray:
    return np.ascontiguousarray(x, float)
