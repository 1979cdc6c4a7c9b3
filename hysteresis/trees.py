"""Models as trees of laws: what `AbstractModel.tree` gives is made of this."""

import abc
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._law_model import AbstractLawModel
from ._model import AbstractModel, Tree
from ._parameter import is_concrete, size_of_inputs

ROUNDING = 32
"""Outputs closer than so many roundings of the largest one are one output: sums are not exact. The largest
is the reading, or the output of the virgin model at one of the ends."""

FLAT_WIDTH = 1e-6
"""Part of the range. After a reversal y grows with the square of u: 1e-14 in y is 1e-7 in u."""


def flat_width(eps: float) -> float:
    """Part of the range from which inputs with one output are FLAT: 1e-4 in single precision, as exact as
    that is. A quarter of it called a third of the readings of relays and stops FLAT, right to 5e-5."""
    return max(FLAT_WIDTH, ROUNDING**2 * eps)


def node(
    kind: str, parameters: Tree, state: Tree | None = None, parts: Iterable[Tree] = ()
) -> Tree:
    """One law: its `Parameters` and its `State` by name, in the order of its file."""
    found = {"kind": kind, "parameters": parameters, "state": {"status": 0} | (state or {})}
    return found | ({"parts": inner} if (inner := list(parts)) else {})


def series(*parts: Tree) -> Tree:
    """Trees one behind the other."""
    return {"kind": "series", "parts": list(parts)}


def curve(
    nodes: Any, outputs: Any, starts: Any, ends: Any, eps: float, endless: bool = False
) -> Tree:
    """Parabolas with these slopes at both ends of each cell; an `endless` one is known beyond its nodes."""
    flat = flat_width(eps) * (nodes[-1] - nodes[0])
    margin = ROUNDING * eps * jnp.abs(outputs).max()
    parameters = {
        "cells": len(nodes) - 1, "nodes": nodes, "outputs": outputs, "starts": starts, "ends": ends,
        "margin": margin, "flat": flat, "endless": int(endless),
    }  # fmt: skip
    return node("curve", parameters, {"value": 0.0})


def polygon(nodes: Any, increments: Any, offset: Any, eps: float) -> Tree:
    """An endless curve of straight lines."""
    slopes = increments / jnp.diff(nodes)
    outputs = offset + jnp.append(jnp.zeros_like(increments[:1]), increments.cumsum())
    return curve(nodes, outputs, slopes, slopes, eps, endless=True)


def plain(tree: Tree) -> Tree:
    """The tree of a model whose parameters are known, in numbers and lists of Python: what a file holds.

    **Example:**

        >>> tree = hysteresis.LinearSponge(K=2.0, threshold=1.0).tree()
        >>> hysteresis.trees.plain(tree)["parameters"]
        {'K': 2.0, 'b': 0.0, 'threshold': 1.0, 'least': 0.999999999999}
    """
    found = {
        key: {name: _flat(x) for name, x in value.items()} if isinstance(value, dict) else value
        for key, value in tree.items()
    }
    return found | ({"parts": [plain(one) for one in tree["parts"]]} if "parts" in tree else {})


def _flat(value: Any) -> Any:
    if isinstance(value, bool | int):
        return int(value)
    array = np.asarray(value)
    return array.ravel().tolist() if array.ndim else array.item()


# Trees whose input is looked for: sums, and models whose law has no inverse of its own.

REACH = 1024.0
"""Inputs looked for, in parts of the largest size that a parameter gives to them."""

BEYOND = 0.25
"""Part of a model's range by which inputs are looked for beyond it: at rest noise takes readings there."""


class AbstractSearchedModel(AbstractLawModel):
    """A model whose law goes forwards: the input behind an output is looked for, from `low` to `high` and a
    little beyond where it has such fields, else as far as its parameters reach.

    A subclass has fields and `forwards`; `docs/your-own-model.md` shows one.
    """

    @abc.abstractmethod
    def forwards(self) -> Tree:
        """The node of its law, which is a part of a sum."""

    def laws(self, eps: float, depth: int) -> Tree:
        return looked_for(self, [self.forwards()], eps)

    def search_range(self) -> tuple[Any, Any]:
        own = input_range(self)
        return reach_of(self) if own is None else widened(*own)


def input_range(model: AbstractModel) -> tuple[Any, Any] | None:
    """The least and the greatest input that a model was made for, as far as its fields say."""
    place = getattr(model, "density", model)
    if (nodes := getattr(place, "nodes", None)) is not None:
        return nodes[0], nodes[-1]
    low, high = getattr(place, "low", None), getattr(place, "high", None)
    return None if low is None or high is None else (low, high)


def search_range(model: AbstractModel) -> tuple[Any, Any]:
    """Between which inputs the one behind an output is looked for: what the model's own method of this name
    says, else its range, else as far as its parameters reach."""
    own: Any = getattr(model, "search_range", None)
    return own() if own else input_range(model) or reach_of(model)


def reach_of(*models: AbstractModel) -> tuple[Any, Any]:
    """As far as the parameters of some models reach."""
    reach = REACH * jnp.stack([size_of_inputs(model) for model in models]).max()
    return -reach, reach


def widened(low: Any, high: Any) -> tuple[Any, Any]:
    """A range of inputs, and some more on either side."""
    beyond = BEYOND * (high - low)
    return low - beyond, high + beyond


def common_range(ranges: Iterable[tuple[Any, Any]]) -> tuple[Any, Any]:
    """What ranges of inputs have in common; while JAX traces some of them, what the others have."""
    given = list(ranges)
    known = [ends for ends in given if all(map(is_concrete, ends))]
    lows, highs = zip(*(known or given), strict=True)
    xp = jnp if any(isinstance(end, jax.Array) for end in (*lows, *highs)) else np
    return xp.stack(lows).max(), xp.stack(highs).min()


def part_tree(model: AbstractModel, eps: float, depth: int) -> Tree:
    """The tree of a model in a sum: one that is only looked for is its law."""
    return model.forwards() if isinstance(model, AbstractSearchedModel) else model.tree(eps, depth)


def looked_for(
    model: AbstractModel, parts: list[Tree], eps: float, alone: Iterable[AbstractModel] = ()
) -> Tree:
    """The sum of parts, in which the input is looked for from the last one on.

    `alone`: the models that may be the output by themselves, which say how large it is; else the model.
    """
    low, high = search_range(model)
    sizes = jnp.stack([size_of(one, 0.0, low, high) for one in alone or (model,)])
    parameters = {
        "low": low, "high": high, "rounding": ROUNDING * eps, "size": sizes.max(),
        "flat": flat_width(eps) * (high - low), **precisions(eps, high - low),
    }  # fmt: skip
    return node("sum", parameters, {"value": low, "slope": 0.0}, parts)


def precisions(eps: float, reach: Any) -> Tree:
    """How close two inputs are between which one is found, without a bend of the output and with one."""
    return {"finest": max(1e-9, 2 * eps) * reach, "closest": 2 * eps * reach}


def size_of(model: AbstractModel, t: Any, *inputs: Any) -> Float[Array, ""]:
    """Of the outputs of a virgin model at some inputs, the largest one without its sign.

    It says what rounding is, so it has no derivative.
    """
    frozen, u = jax.lax.stop_gradient((model, jnp.stack([jnp.asarray(u, float) for u in inputs])))
    each = tuple(range(len(inputs)))  # a sequence of its own
    return jnp.abs(frozen.simulate(jnp.full(len(inputs), t, float), u, starts=each)).max()
