"""Sequences that each begin in the same past, hung on one memory tree."""

from itertools import pairwise
from typing import Any

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


def hang(past: Any, u: Any, starts: tuple[int, ...]) -> tuple[MemoryTree, Any]:
    """The tree of all sequences, its `anchor` that of the samples of `u` alone, and inputs at its nodes.

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
    pasts = np.repeat(np.arange(1, len(bounds)) * len(past), np.diff(bounds))
    anchor = tree.anchor[np.arange(len(u)) + pasts]
    return tree._replace(anchor=anchor), path[tree.node]
