"""A tree of laws over a record: outputs, the inputs behind outputs, and the tangents of both."""

from typing import Any, NamedTuple

import numpy as np

from ._compiled import locals_of, loop_of, table_of
from ._numbers import Structure

WIDE = 4


class Ran(NamedTuple):
    """Outputs, or inputs with their status; and the numbers m after the last row."""

    value: np.ndarray
    status: np.ndarray
    m: np.ndarray


class Tangents(NamedTuple):
    """As `Ran`, and its derivatives in each direction, (rows, columns)."""

    value: np.ndarray
    status: np.ndarray
    columns: np.ndarray


def run(
    structure: Structure, m: np.ndarray, n: np.ndarray, dt: Any, u: Any, starts: Any = (0,)
) -> Ran:
    """Outputs at every input, dt after the one before. A sequence begins at each of `starts`."""
    return _over_time("run", structure, m, n, dt, u, starts)


def find(
    structure: Structure, m: np.ndarray, n: np.ndarray, dt: Any, y: Any, starts: Any = (0,)
) -> Ran:
    """The inputs behind outputs."""
    return _over_time("find", structure, m, n, dt, y, starts)


def _over_time(
    wanted: str, structure: Structure, m: np.ndarray, n: np.ndarray, dt: Any, x: Any, starts: Any
) -> Ran:
    first, after = _own(m), np.array(m, float)
    x, dt, starts = _own(x), _own(dt), _ended(starts)
    value, status = np.empty(len(x)), np.zeros(len(x))
    outputs = (value, status) if wanted == "find" else (value,)
    loop = loop_of(structure.bare, wanted)
    loop(after, n, first, len(first), x, dt, starts, len(x), *outputs)
    return Ran(value, status.astype(int), after)


def tangents(
    structure: Structure,
    m: np.ndarray,
    n: np.ndarray,
    dm: np.ndarray,
    dt: Any,
    x: Any,
    dx: np.ndarray | None = None,
    starts: Any = (0,),
    inverse: bool = False,
) -> Tangents:
    """Outputs, or with `inverse` inputs, and their tangents: dm (numbers, columns) and dx (rows, columns)
    are those of the numbers, and of what is given."""
    first, after = _own(m), np.array(m, float)
    x, dt, starts = _own(x), _own(dt), _ended(starts)
    size, columns = dm.shape
    width = -(-(columns + inverse) // WIDE) * WIDE
    wanted = "find_tangents" if inverse else "tangents"
    loop, own = loop_of(structure, wanted), locals_of(structure)
    D = np.zeros((own + size, width))
    dfirst = np.zeros((size, width))
    dfirst[:, :columns] = dm
    value, status, dvalue = np.empty(len(x)), np.zeros(len(x)), np.empty((len(x), columns))
    given = np.zeros((1, 1)) if dx is None else _own(dx)
    outputs = (value, status, dvalue, np.empty(2 * size)) if inverse else (value, dvalue)
    loop(
        after, n, first, size, x, dt, starts, len(x), table_of(D), D, width, columns, dfirst,
        int(dx is not None), given, *outputs,
    )  # fmt: skip
    return Tangents(value, status.astype(int), dvalue)


def _own(x: Any) -> np.ndarray:
    return np.ascontiguousarray(x, float)


def _ended(starts: Any) -> np.ndarray:
    return np.append(np.asarray(starts, np.int64), -1)
