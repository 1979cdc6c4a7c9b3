"""A tree of laws over a record: outputs, the inputs behind outputs, and the tangents of both.

Compiling a tree that this machine has not seen takes seconds, which a short record is not worth. How much
is still to come is not known, so plain Python goes on until it has taken as long as compiling would: no
more than twice the shortest time that is possible (the ski-rental problem; Karlin et al. 1988).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from ._compiled import available, is_kept, loop_of, reals_of, table_of
from ._in_python import in_python
from ._memory_sizes import NONE, WIDE, WIDELY
from ._numbers import Numbers, Structure
from ._text import text_of

LINE = 8
"""Reals in a line of the cache."""

COMPILING = {"kept": 0.3, "line": 0.014}
"""Seconds until a loop is there: from disk, or compiled, for each line of its text."""

SOME = 64
"""Rows between two looks at the watch."""

_spent: dict[tuple[Structure, str], float] = {}
"""By trees that are not compiled yet, in plain Python."""


class Rows(NamedTuple):
    """What is run through: inputs or readings, times since the row before, and conditions."""

    x: np.ndarray
    dt: np.ndarray
    condition: np.ndarray


@contextmanager
def compiled_at_once() -> Iterator[None]:
    """Within, nothing runs in plain Python first."""
    before = COMPILING.copy()
    COMPILING.update(dict.fromkeys(COMPILING, 0.0))
    try:
        yield
    finally:
        COMPILING.update(before)


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
    value = np.empty(len(x))
    m = through("run", numbers, x, dt, (value,))
    return Ran(value, np.zeros(len(value), int), m)


def looks(numbers: Numbers, x: Any, dt: Any, levels: Any) -> np.ndarray:
    """Outputs at other inputs than each row's, `levels` (rows, levels), in the state before it; NaN at NaN.
    Otherwise as `run`."""
    levels = _own(levels)
    y = np.empty(levels.shape)
    through("looks", numbers, x, dt, (y, levels), levels.shape[1])
    return y


def find(numbers: Numbers, y: Any, dt: Any) -> Ran:
    """The inputs behind outputs."""
    value, status = np.empty((2, len(y)))
    m = through("find", numbers, y, dt, (value, status))
    return Ran(value, status.astype(int), m)


def through(
    wanted: str, numbers: Numbers, x: Any, dt: Any, outputs: tuple[np.ndarray, ...], *more: int
) -> np.ndarray:
    """The loop `wanted` over all rows into `outputs`, with `more` arguments; the numbers m after them."""
    key, rows = (numbers.known.structure.bare, wanted), _rows(x, dt)
    first, m, done = _own(numbers.m), np.array(numbers.m, float), 0
    enough = _compiling(*key)
    while done < len(rows.x):
        begun = perf_counter()
        plain = _spent.get(key, 0.0) < enough
        end = min(done + SOME, len(rows.x)) if plain else len(rows.x)
        (in_python if plain else loop_of)(*key)(
            m, numbers.known.n, first, len(m), *(column[done:end] for column in rows), end - done,
            *(column[done:end] for column in outputs), *more,
        )  # fmt: skip
        if plain:
            _spent[key] = _spent.get(key, 0.0) + perf_counter() - begun
        done = end
    return m


def _compiling(structure: Structure, wanted: str) -> float:
    """Seconds that compiling takes; for ever without numba."""
    if not available():
        return np.inf
    if is_kept(structure, wanted):
        return COMPILING["kept"]
    return COMPILING["line"] * text_of(structure, wanted).count("\n")


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
