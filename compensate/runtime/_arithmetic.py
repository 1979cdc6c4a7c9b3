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
from operator import getitem, mul, not_
from typing import Any

most, some, total, no, at = max, any, sum, not_, getitem

Row = Sequence[float]
Table = Sequence[Row]

Real = Any
Test = Any
Numbers = Any
Items = Any
State = Any
Arithmetic = Any
"""Of plain numbers or of JAX's arrays: a number, whether something holds, some numbers, many of a kind,
what is remembered; and one of the two modules."""


def where(test: bool, one: State, other: State) -> State:
    """One of two."""
    return one if test else other


def either(test: bool, one: Callable[[], State], other: Callable[[], State]) -> State:
    """One of two that are made; JAX makes both."""
    return one() if test else other()


rarely = either
"""JAX makes only one, which takes longer where both are quick."""


def each(of: Callable[[State], State], items: Iterable[State]) -> list[State]:
    """A function of each entry."""
    return list(map(of, items))


def where_each(
    items: list[State],
    test: Callable[[State], bool],
    made: Callable[[State, bool], State],
    other: State,
) -> list[State]:
    """What is made of each entry for which the test holds; JAX has the other for the rest, and here that
    stands alone where it holds for none."""
    return [made(one, True) for one in items if test(one)] or [other]


def first_of_least(
    items: list[State], cost: Callable[[State], float], strength: Callable[[State], float]
) -> State:
    """The first of the strongest entries of those that cost least."""
    if len(items) == 1:
        return items[0]
    return max(items, key=lambda one: (-cost(one), strength(one)))


def vector(parts: Items) -> Numbers:
    """Some numbers, or rows of numbers, as one."""
    return parts


def clip(value: float, low: float, high: float) -> float:
    """The nearest number between two."""
    return min(max(value, low), high)


def log(x: float) -> float:
    """The natural logarithm, that of 0 too."""
    return log_of(x) if x else -inf


def place_of_most(values: list[float]) -> int:
    """Of the first one that is the greatest."""
    return values.index(max(values))


def put(items: list[State], place: int, one: State) -> list[State]:
    """The same with another entry."""
    return [*items[:place], one, *items[place + 1 :]]


def turned(rows: Table) -> Table:
    """Columns as rows."""
    return list(zip(*rows, strict=True))


def mixed(a: float, x: Numbers, b: float, y: Numbers) -> Numbers:
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
