"""Other first states of a tree, which a file holds."""

from collections.abc import Iterable
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
    states: list[Any] = []
    takes: list[Any] = []
    node = node_of(tree, states, takes)
    read = np.asarray(outputs(model, history), float)
    times = np.zeros(len(read)) if history.times is None else np.asarray(history.times, float)
    rows = zip(np.diff(times, prepend=times[0]).tolist(), read.tolist(), strict=True)
    for dt, reading in rows:
        if takes:
            reading, condition = reading
            for take in takes:
                take(condition)
        node.find(dt, reading)
    return [vars(state) for state in states]
