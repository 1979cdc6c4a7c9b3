"""Models and what is around their inverses as trees of plain numbers: what the runtimes without JAX run."""

from collections.abc import Iterator

import numpy as np

from hysteresis import AbstractModel
from hysteresis.trees import Tree, plain

from ..guards._guarded import ROUNDING as ROUNDING_OF_ENDS
from ..guards._guarded import GuardedCompensator
from ..inverses import inverse_of


def program_of(model: AbstractModel) -> Tree:
    """The tree of a model that can be inverted.

    Raises `InputError` where the model has no inverse, or no element is known for one of its parts.
    """
    inverse_of(model)
    return tree_of(model)


def tree_of(model: AbstractModel, precision: type = np.float64, depth: int = 64) -> Tree:
    """The tree of a model for numbers of a precision, and so many reversals of a Preisach model."""
    return plain(model.tree(float(np.finfo(precision).eps), depth))


def nodes_of(tree: Tree) -> Iterator[Tree]:
    """A tree, node by node."""
    yield tree
    for part in tree.get("parts", ()):
        yield from nodes_of(part)


def guard_tree(guard: GuardedCompensator, precision: type = np.float64) -> Tree:
    """The guard of a compensator, as an element."""
    # In single precision an estimate just after a reversal is 1e-3 of the range off.
    part = 0.0 if precision is np.float64 else 1e3 * ROUNDING_OF_ENDS
    made = guard.law(part * float(guard.high - guard.low))
    return {"beyond": guard.beyond, **plain(made)}
