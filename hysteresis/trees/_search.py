"""Trees whose input is looked for: sums, and models whose law has no inverse of its own."""

import abc
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._law_model import AbstractLawModel
from .._model import DOUBLE, AbstractModel, Tree
from .._parameter import is_concrete
from ._node import FLAT_WIDTH, ROUNDING, node

BEYOND = 0.25
"""Part of a model's range by which inputs are looked for beyond it: at rest noise takes readings there."""


class AbstractSearchedModel(AbstractLawModel):
    """A model for inputs from `low` to `high` whose law goes forwards: the input behind an output is looked
    for, a little beyond them too."""

    @abc.abstractmethod
    def forwards(self) -> Tree:
        """The node of its law, which is a part of a sum."""

    def tree(self, eps: float = DOUBLE, depth: int = 64) -> Tree:
        return looked_for(self, [self.forwards()], eps)

    def search_range(self) -> tuple[Any, Any]:
        return widened(*super().search_range())


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
    low, high = model.search_range()
    sizes = jnp.stack([size_of(one, 0.0, low, high) for one in alone or (model,)])
    parameters = {
        "low": low, "high": high, "rounding": ROUNDING * eps, "size": sizes.max(),
        "flat": max(FLAT_WIDTH, 256 * eps) * (high - low), **precisions(eps, high - low),
    }  # fmt: skip
    return node("sum", parameters, {"value": low, "slope": 0.0}, parts)


def precisions(eps: float, reach: Any) -> Tree:
    """How close two inputs are between which one is found, without a bend of the output and with one."""
    return {"finest": max(1e-9, 2 * eps) * reach, "closest": 2 * eps * reach}


def size_of(model: AbstractModel, t: Any, *inputs: Any) -> Float[Array, ""]:
    """Of the outputs of a virgin model at some inputs, the largest one without its sign."""
    own = model.init()
    return jnp.abs(jnp.stack([model.step(own, t, jnp.asarray(u, float))[1] for u in inputs])).max()
