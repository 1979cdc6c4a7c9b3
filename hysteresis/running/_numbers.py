"""A tree of laws as its structure and two vectors: m, of its floats, and n, of its whole numbers.

    {"kind": "sum", "parameters": {...}, "state": {...}, "parts": [...]}

What JAX has made is free: outputs have derivatives by it. Numbers of Python and NumPy are constants.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._parameter import is_concrete
from ..laws._nodes import WITHOUT
from ..laws._tree import Tree, parts_of
from ._law import law


class Structure(NamedTuple):
    """What is compiled: kinds, and the names of free parameters."""

    kind: str
    free: tuple[str, ...]
    parts: tuple["Structure", ...]

    @property
    def bare(self) -> "Structure":
        """Without regard to what is free: for outputs alone."""
        return Structure(self.kind, (), tuple(part.bare for part in self.parts))

    def kinds(self) -> set[str]:
        """Of all nodes."""
        return {self.kind}.union(*(part.kinds() for part in self.parts))


class Known(NamedTuple):
    """What is known of a tree before JAX runs; it can be hashed. `whole`: its whole numbers, at the end of
    which stands where in m the state begins; `states`: how many of m are its state; `free`: places in m of
    the numbers that JAX has made."""

    structure: Structure
    whole: tuple[int, ...]
    states: int
    free: tuple[int, ...]

    @property
    def n(self) -> np.ndarray:
        return np.array(self.whole, np.int64)


class Numbers(NamedTuple):
    """A tree in numbers: `m`, its reals, the state last, and what else is known."""

    known: Known
    m: Any

    @property
    def state(self) -> Any:
        m = np.asarray(self.m) if is_concrete(self.m) else self.m  # JAX would compile the cut
        return m[len(m) - self.known.states :]

    def with_state(self, state: Any) -> "Numbers":
        """The same parameters in another state."""
        xp: Any = np if is_concrete(self.m) and is_concrete(state) else jnp
        parameters = xp.asarray(self.m)[: len(self.m) - self.known.states]
        return self._replace(m=xp.concatenate([parameters, xp.asarray(state)]))


def with_laws(tree: Tree) -> list[Tree]:
    """The nodes that have a law, parts before their whole."""
    inner = [one for part in parts_of(tree) for one in with_laws(part)]
    return inner if tree["kind"] == WITHOUT else [*inner, tree]


def numbers_of(tree: Tree) -> Numbers:
    """The numbers of a tree; m is a NumPy array where all of them are known."""
    nodes = with_laws(tree)
    values: list[Any] = []
    size = 0

    def add(value: Any) -> int:
        nonlocal size
        begin, size = size, size + int(np.size(value))
        values.append(value)
        return begin

    rows: list[list[int]] = []
    for node in nodes:
        of, own = law(node["kind"]), node["parameters"]
        begin = size
        for name in of.named("Parameters", "float"):
            add(own[name])
        whole = [int(own[name]) for name in of.named("Parameters", "int")]
        rows.append(
            [begin, 0, *whole, *(add(own[name]) for name in of.named("Parameters", "Reals"))]
        )
    states = size
    for node, row in zip(nodes, rows, strict=True):
        of, own = law(node["kind"]), node["state"]
        row[1] = size
        for name in of.named("State", "int", "float"):
            add(own[name])
        row += [add(own[name]) for name in of.named("State", "Reals")]
    traced = any(isinstance(value, Tracer) for value in values)
    m = _joined(values, jnp if traced else np)
    free = np.repeat([isinstance(v, jax.Array) for v in values], [np.size(v) for v in values])
    whole = (*(i for row in rows for i in row), states)
    places = tuple(np.flatnonzero(free).tolist())
    return Numbers(Known(structure_of(tree), whole, size - states, places), m)


def place_of(known: Known, field: str) -> int:
    """Where in m a number of the state of the outermost law begins."""
    own = law(known.structure.kind)
    row, place = len(known.whole) - 1 - own.row, own.place("State", field)
    if own.fields["State"][field] == "Reals":
        return known.whole[row + place]
    return known.whole[row + 1] + place


def held_at_first(tree: Tree) -> Any:
    """What is estimated before the first reading: where the law of the input begins."""
    if tree["kind"] == "sum" or not tree.get("parts"):
        state = tree["state"]
        return state.get("value", state.get("u", 0.0))
    return held_at_first(tree["parts"][0])


def _joined(values: list[Any], xp: Any) -> Any:
    return xp.concatenate([xp.ravel(xp.asarray(value, float)) for value in values])


def structure_of(tree: Tree) -> Structure:
    own = tree.get("parameters", {})
    free = tuple(name for name, value in own.items() if isinstance(value, jax.Array))
    return Structure(tree["kind"], free, tuple(map(structure_of, parts_of(tree))))
