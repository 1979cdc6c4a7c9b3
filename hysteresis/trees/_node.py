"""A node of a tree: the kind of its law, its numbers, and its parts."""

from collections.abc import Iterable
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._model import Tree

ROUNDING = 32
"""Outputs closer than so many roundings of the largest one are one output: sums are not exact. The largest
is the reading, or the output of the virgin model at one of the ends."""

FLAT_WIDTH = 1e-6
"""Part of the range. After a reversal y grows with the square of u: 1e-14 in y is 1e-7 in u."""


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
    flat = max(FLAT_WIDTH, 8 * ROUNDING * eps) * (nodes[-1] - nodes[0])
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
