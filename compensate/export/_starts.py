"""Other first states of a tree, which a file holds."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from hysteresis import AbstractModel
from hysteresis.laws._tree import node_of
from hysteresis.trees import Tree

from ..guards._run_in import Past, Start, outputs


def starts_in(tree: Tree, model: AbstractModel, starts: Iterable[Start]) -> list[list[Tree]]:
    """For each start the states of the tree's elements, in the order of `node_of`."""
    return [_after(tree, model, start.history) for start in starts]


def _after(tree: Tree, model: AbstractModel, history: Past) -> list[dict[str, Any]]:
    read = np.asarray(outputs(model, history), float)
    times = np.zeros(len(read)) if history.times is None else np.asarray(history.times, float)
    *_, states = states_over(tree, "find", np.diff(times, prepend=times[0]).tolist(), read.tolist())
    return [vars(state) for state in states]


def states_over(tree: Tree, way: str, dt: Sequence[float], y: Sequence[Any]) -> Iterator[list[Any]]:
    """The states of a tree's elements where it is run one way: at first, and after each reading, or pair
    with the condition."""
    states: list[Any] = []
    takes: list[Any] = []
    node = node_of(tree, states, takes)
    yield states
    for step, reading in zip(dt, y, strict=True):
        if takes:
            reading, condition = reading
            for take in takes:
                take(condition)
        getattr(node, way)(step, reading)
        yield states
