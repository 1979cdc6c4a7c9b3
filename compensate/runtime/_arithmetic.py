"""What the solvers are written in, of plain numbers; `compensate._traced` has the same of JAX's arrays.

A text that takes one of the two as `o` runs reading by reading on a robot, and JAX traces it: many of them
at once, with derivatives. Here a list holds what JAX has in arrays with a leading axis.
"""

from collections.abc import Callable, Iterable
from math import exp as exp
from math import isfinite as isfinite
from math import sqrt as sqrt
from typing import Any

most, some = max, any


def no(test: bool) -> bool:
    """Whether a test fails."""
    return not test


def where(test: bool, one: Any, other: Any) -> Any:
    """One of two."""
    return one if test else other


def when(test: bool, made: Callable[[], Any], other: Any) -> Any:
    """What is made, only where the test holds; JAX makes both."""
    return made() if test else other


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
