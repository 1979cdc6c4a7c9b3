"""What the solvers are written in, of plain numbers; `compensate._traced` has the same of JAX's arrays.

A text that takes one of the two as `o` runs reading by reading on a robot, and JAX traces it: many of them
at once, with derivatives. Here a list holds what JAX has in arrays with a leading axis.
"""

from collections.abc import Callable, Iterable, Sequence
from math import exp as exp
from math import expm1 as expm1
from math import inf
from math import isfinite as isfinite
from math import log as log_of
from math import sqrt as sqrt
from operator import mul
from typing import Any

most, some, total = max, any, sum

Row = Sequence[float]
Table = Sequence[Row]


def no(test: bool) -> bool:
    """Whether a test fails."""
    return not test


def where(test: bool, one: Any, other: Any) -> Any:
    """One of two."""
    return one if test else other


def when(test: bool, made: Callable[[], Any], other: Any) -> Any:
    """What is made, only where the test holds; JAX makes both."""
    return made() if test else other


rarely = when
"""JAX makes it only where the test holds, which takes longer."""


def either(test: bool, one: Callable[[], Any], other: Callable[[], Any]) -> Any:
    """One of two that are made; JAX makes both."""
    return one() if test else other()


def each(of: Callable[..., Any], *columns: Iterable[Any]) -> list[Any]:
    """A function of each entry."""
    return list(map(of, *columns))


def where_each(
    items: list[Any], test: Callable[[Any], bool], made: Callable[[Any, bool], Any], other: Any
) -> list[Any]:
    """What is made of each entry for which the test holds; JAX has the other for the rest, and here that
    stands alone where it holds for none."""
    return [made(one, True) for one in items if test(one)] or [other]


def first_of_least(
    items: list[Any], cost: Callable[[Any], float], strength: Callable[[Any], float]
) -> Any:
    """The first of the strongest entries of those that cost least."""
    if len(items) == 1:
        return items[0]
    return max(items, key=lambda one: (-cost(one), strength(one)))


def vector(parts: tuple[float, ...]) -> tuple[float, ...]:
    """Some numbers as one."""
    return parts


def clip(value: float, low: float, high: float) -> float:
    """The nearest number between two."""
    return min(max(value, low), high)


def cell(along: float, cells: int) -> tuple[int, float]:
    """In which of so many cells between -1 and 1 a number lies, and where in it."""
    at = (along + 1.0) / 2.0 * cells
    first = min(int(at), cells - 1)
    return first, at - first


def log(x: float) -> float:
    """The natural logarithm, that of 0 too."""
    return log_of(x) if x else -inf


def place_of_most(values: list[float]) -> int:
    """Of the first one that is the greatest."""
    return values.index(max(values))


def at(items: list[Any], place: int) -> Any:
    """One entry."""
    return items[place]


def put(items: list[Any], place: int, one: Any) -> list[Any]:
    """The same with another entry."""
    return [*items[:place], one, *items[place + 1 :]]


def table(rows: Table) -> Table:
    """Some rows as one."""
    return rows


def turned(rows: Table) -> Table:
    """Columns as rows."""
    return list(zip(*rows, strict=True))


def mixed(a: float, x: Any, b: float, y: Any) -> Any:
    """a x + b y, of numbers or of rows."""
    if isinstance(x, float | int):
        return a * x + b * y
    return [a * u + b * v for u, v in zip(x, y, strict=True)]


def plus_at(rows: Table, more: Iterable[tuple[int, int, float]]) -> Table:
    """A table with something added at some of its places."""
    found = [list(row) for row in rows]
    for i, j, value in more:
        found[i][j] += value
    return found


def times(rows: Table, h: Row) -> Row:
    """The first columns, weighed by h and added up."""
    return [sum(map(mul, h, row)) for row in rows]


def less(rows: Table, column: Row, by: float) -> Table:
    """rows - column column' / by."""
    return [
        [p - a * b / by for p, b in zip(row, column, strict=True)]
        for row, a in zip(rows, column, strict=True)
    ]
