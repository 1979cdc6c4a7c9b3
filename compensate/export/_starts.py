"""What a file holds of runs: other first states of its tree, and the readings that it is checked with."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from hysteresis import AbstractModel

from ..guards._run_in import Past, Start, outputs
from ..runtime._compensator import Compensator, _apart
from ..runtime._tree import node_of
from ._node import Tree


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


def agreeing(document: Tree) -> Tree:
    """The golden pair up to where plain Python gives another estimate than JAX: on a flat place, as at rest
    before a contact, rounding decides between its ends."""
    golden, it = document["golden"], Compensator(document)
    held = golden.get("condition") or [None] * len(golden["dt"])
    rows = zip(golden["dt"], golden["reading"], held, golden["value"], strict=True)
    for k, (dt, reading, condition, wanted) in enumerate(rows):
        off = _apart(it.step(dt, reading, condition).value, wanted)
        if k and off > golden["tolerance"]:
            return {key: v[:k] if isinstance(v, list) else v for key, v in golden.items()}
    return golden
