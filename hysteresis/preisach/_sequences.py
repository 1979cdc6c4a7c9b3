"""Sequences that each begin in the same past, hung on one memory tree."""

from itertools import pairwise
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._parameter import is_concrete
from ._memory import MemoryTree, memory_tree
from ._stack import OpenLoops
from ._traced_memory import traced_tree


def past_inputs(loops: OpenLoops, u: Array) -> Any:
    """A path of inputs that leads from saturation to a state with these open loops, and to `u`."""
    extremum, depth = loops.extremum, loops.depth
    if is_concrete(u):
        return np.append(np.asarray(extremum)[: int(depth)], float(u))
    # A traced depth: fill up with the present input, since a plateau adds no memory.
    is_open = jnp.arange(extremum.shape[0], dtype=jnp.int32) < depth
    return jnp.append(jnp.where(is_open, extremum, u), u)


class Hung(NamedTuple):
    """Sequences on one tree; the path is their pasts and samples in turn.

    - `tree`: of the path, but `anchor` is that of the samples of `u` alone.
    - `at_node` (anchors,): inputs at the nodes.
    - `past`, `past_anchor`: inputs of all the pasts, and their anchors.
    - `place` (anchors,): where a node stands in (pasts, samples of u), one after the other.
    """

    tree: MemoryTree
    at_node: Any
    past: Any
    past_anchor: Any
    place: Any


def hang(past: Any, u: Any, starts: tuple[int, ...]) -> Hung:
    """Sequences that each begin behind the same past, on one tree.

    **Arguments:**

    - `past`: a path that starts at its own minimum, the negative saturation; before each sequence.
    - `u`: inputs; NumPy arrays give a tree on the host, traced ones the form of fixed length.
    - `starts`: first samples of the sequences in `u`.
    """
    concrete = is_concrete(u) and is_concrete(past)
    bounds = [*starts, len(u)]
    pieces = [piece for a, b in pairwise(bounds) for piece in (past, u[a:b])]
    path: Any = (np if concrete else jnp).concatenate(pieces)
    tree = memory_tree(path) if concrete else traced_tree(path)
    # In the path each sequence stands behind its past; in `Hung` all the pasts come first.
    here, place = slice(len(past), None), tree.node
    before: Any = slice(0, len(past))
    if len(starts) > 1:
        pasts = np.repeat(np.arange(1, len(bounds)) * len(past), np.diff(bounds))
        here = np.arange(len(u)) + pasts
        before = np.setdiff1d(np.arange(len(path)), here, assume_unique=True)
        rank = np.empty(len(path), np.int32)
        rank[before], rank[here] = np.arange(len(before)), len(before) + np.arange(len(u))
        place = (rank if concrete else jnp.asarray(rank))[tree.node]
    own = tree._replace(anchor=tree.anchor[here])
    return Hung(own, path[tree.node], path[before], tree.anchor[before], place)
