"""A tree of laws over time in plain Python: nothing to compile, 1 to 100 microseconds a row."""

from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from ..laws._tree import Node, Tree, node_of
from ._law import Law, law
from ._numbers import WITHOUT, Numbers, Structure

SOME = 64
"""Rows between two looks at the watch."""


class Rows(NamedTuple):
    """What is run through: inputs or readings, times since the row before, and conditions."""

    x: np.ndarray
    dt: np.ndarray
    condition: np.ndarray


def advance(
    wanted: str,
    numbers: Numbers,
    m: np.ndarray,
    rows: Rows,
    outputs: tuple[np.ndarray, ...],
    budget: float,
) -> tuple[int, float]:
    """Run ("run") or invert ("find") from m on until the rows or the seconds are used up: how many rows,
    and how long they took. m moves on with them."""
    begun, done, count = perf_counter(), 0, len(rows.x)
    opened = _open(numbers, m)
    step, said = _step(opened.node, wanted), opened.node.status
    for first in range(0, count, SOME):
        if perf_counter() - begun > budget:
            break
        some = slice(first, min(first + SOME, count))
        table = (rows.x[some], rows.dt[some], rows.condition[some])
        for k, (x, dt, c) in enumerate(
            zip(*(column.tolist() for column in table), strict=True), first
        ):
            if not dt >= 0.0:
                dt = -dt if dt < 0.0 else 0.0
                opened = _open(numbers, numbers.m)
                step, said = _step(opened.node, wanted), opened.node.status
            for take in opened.takes:
                take(c)
            outputs[0][k] = step(dt, x)
            if wanted == "find":
                outputs[1][k] = said()
        done = some.stop
    _close(opened, numbers, m)
    return done, perf_counter() - begun


def _step(node: Node, wanted: str) -> Callable[[float, float], float]:
    # A moving mass goes from force to displacement by `find` alone.
    return node.find if wanted == "find" or node.move is None else node.move


class _Opened(NamedTuple):
    """A tree with states of its own."""

    node: Node
    states: list[Any]
    takes: list[Callable[[float], float]]


def _open(numbers: Numbers, m: np.ndarray) -> _Opened:
    laws, values = _laws(numbers.known.structure), m.tolist()
    begins = _begins(laws, numbers.known.whole)
    ends = dict(zip(begins, [*list(begins.values())[1:], len(values)], strict=True))

    def part(k: int, structure: str) -> Tree:
        own: Tree = {}
        for name, kind in laws[k].fields[structure].items():
            if structure == "Parameters" and kind == "int":
                own[name] = int(
                    numbers.known.whole[_row(laws, k) + laws[k].place("Parameters", name)]
                )
                continue
            begin = begins[k, structure, name]
            found = values[begin : ends[k, structure, name]]
            own[name] = found if kind == "Reals" else int(found[0]) if kind == "int" else found[0]
        return own

    order = iter(range(len(laws)))

    def tree(structure: Structure) -> Tree:
        parts = [tree(one) for one in structure.parts]
        if structure.kind == WITHOUT:
            return {"kind": structure.kind, "parts": parts}
        k = next(order)
        own = {"parameters": part(k, "Parameters"), "state": part(k, "State")}
        return {"kind": structure.kind, **own, **({"parts": parts} if parts else {})}

    states: list[Any] = []
    takes: list[Callable[[float], float]] = []
    return _Opened(node_of(tree(numbers.known.structure), states, takes), states, takes)


def _close(opened: _Opened, numbers: Numbers, m: np.ndarray) -> None:
    laws = _laws(numbers.known.structure)
    begins = _begins(laws, numbers.known.whole)
    for k, state in enumerate(opened.states):
        for name in laws[k].fields["State"]:
            value, begin = np.ravel(getattr(state, name)), begins[k, "State", name]
            m[begin : begin + len(value)] = value


def _laws(structure: Structure) -> list[Law]:
    inner = [one for part in structure.parts for one in _laws(part)]
    return inner if structure.kind == WITHOUT else [*inner, law(structure.kind)]


def _row(laws: list[Law], k: int) -> int:
    return sum(one.row for one in laws[:k])


def _begins(laws: list[Law], n: tuple[int, ...]) -> dict[tuple[int, str, str], int]:
    """Where in m every field begins, in the order in which they lie there."""
    found: dict[tuple[int, str, str], int] = {}
    for structure, first in (("Parameters", 0), ("State", 1)):
        for k, one in enumerate(laws):
            row = _row(laws, k)
            for name in one.named(structure, "float", *(("int",) if first else ())):
                found[k, structure, name] = n[row + first] + one.place(structure, name)
            for name in one.named(structure, "Reals"):
                found[k, structure, name] = n[row + one.place(structure, name)]
    return found
