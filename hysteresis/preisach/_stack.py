"""The open loops of a running Preisach model: a stack of reversals of fixed capacity.

The forward model and its inverse keep the same stack; one sees where the input goes, the other
where the output does.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._parameter import is_concrete
from ._everett import read
from ._memory import MemoryTree, memory_tree

# The memory tree of a path that is not known yet: arrays of fixed length, inside `jit` and `vmap`.


def traced_tree(path: Float[Array, " samples"]) -> MemoryTree:
    """`memory_tree` of a traced path, in arrays as long as the path, on any device.

    Entries are those of `memory_tree`, then padding: anchors that hang on anchor 0 at its own node,
    and events where nothing happens. One thing differs: the samples of a plateau that the path turns on
    hang on the branch before the turn, not on the one behind it, as no sample knows the next. Both
    give the same output. The entries are integers: gradients flow through the values they gather.

    Time: one pass of 1.5 iterations a sample without loops in them, so that a batch costs no more
    than its paths one by one: 60 to 100 ns a sample on a CPU, smooth paths and white noise.
    """
    path = jax.lax.stop_gradient(path)
    samples = path.shape[0]
    nothing = 2 * samples
    integer = jnp.int32

    # A row of the stack is an anchor and its node. Every iteration turns if it has to, closes one
    # loop if it has to, and goes on to the next sample if no other loop is to be closed: with fewer
    # than half as many loops as samples, the path is through after 3/2 samples iterations.
    def iterate(carry: tuple[Array, ...], _: None) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        sample, last, rising, anchors, depth, stack = carry
        here, before = read(path, sample), read(path, last)
        way = jnp.where(here > before, 1, jnp.where(here < before, -1, rising))
        turns = (way != rising) | (anchors == 0)
        # The place above the top is free: written in any case, and taken where the path turns. The
        # stack is read after the write alone, or XLA would copy it in every iteration.
        stack = stack.at[depth].set(jnp.stack([anchors, last]), mode="promise_in_bounds")
        parent = read(stack, jnp.maximum(depth - 1, 0))[0]
        pushed = jnp.where(turns, anchors, nothing)
        anchors = jnp.where(turns, anchors + 1, anchors)
        depth = jnp.where(turns, depth + 1, depth)
        sign = way.astype(path.dtype)

        def closes(depth: Array) -> Array:
            older = read(path, read(stack, jnp.maximum(depth - 2, 0))[1])
            return (depth >= 3) & (sign * here >= sign * older)

        pops = closes(depth)
        popped = jnp.where(pops, samples + read(stack, depth - 1)[0], nothing)
        depth = jnp.where(pops, depth - 2, depth)
        stays = closes(depth)
        done = jnp.where(stays, samples, sample)
        record = done, read(stack, depth - 1)[0], pushed, parent, last, popped
        last = jnp.where(stays | (here == before), last, sample)
        sample = jnp.where(stays, sample, jnp.minimum(sample + 1, samples - 1))
        return (sample, last, way, anchors, depth, stack), record

    zero, one = jnp.asarray(0, integer), jnp.asarray(1, integer)
    begin = zero, zero, one, zero, zero, jnp.zeros((samples + 1, 2), integer)
    records = jax.lax.scan(iterate, begin, length=samples + samples // 2)[1]
    done, top, pushed, parent, last, popped = records

    def placed(index: Array, value: Array) -> Array:
        return jnp.zeros(samples, integer).at[index].set(value, mode="drop")

    # Leave out the events that are none.
    happened = jnp.stack([pushed, popped], 1).reshape(-1)
    position = jnp.cumsum(happened != nothing, dtype=integer) - 1
    event = jnp.full(samples + samples // 2, nothing, integer)
    event = event.at[jnp.where(happened == nothing, nothing, position)].set(happened, mode="drop")
    rising = jnp.asarray(1 - 2 * (np.arange(samples) % 2), integer)
    node, above = placed(pushed, last), placed(pushed, parent)
    return MemoryTree._make(
        (placed(done, top), node, above, rising, event, placed(pushed, position[::2]))
    )


class OpenLoops(NamedTuple):
    """Reversals whose loops are not closed yet, oldest first.

    - `extremum`, `level` (capacity,): input and output at each; entry 0 is the negative saturation.
    - `depth`: the number of entries in use.
    - `dropped`: the number of loops that were forgotten because the stack was full.
    """

    extremum: Array
    level: Array
    depth: Array
    dropped: Array

    @classmethod
    def none(cls, capacity: int, u: Array, y: Array) -> "OpenLoops":
        """A stack that holds only the saturation, at input `u` and output `y`."""
        empty, one = jnp.zeros(capacity), jnp.asarray(1, jnp.int32)
        return cls(empty.at[0].set(u), empty.at[0].set(y), one, one - 1)

    @property
    def anchor(self) -> tuple[Array, Array]:
        """Input and output where the present branch started."""
        return read(self.extremum, self.depth - 1), read(self.level, self.depth - 1)

    def push(self, when: Array, u: Array, y: Array) -> "OpenLoops":
        """Open a loop at (u, y) `when` the direction turned; a full stack forgets its smallest."""
        full = when & (self.depth >= self.extremum.shape[0])
        depth = jnp.where(full, self.depth - 2, self.depth)
        top = jnp.where(when, depth, depth - 1)
        return OpenLoops(
            self.extremum.at[top].set(jnp.where(when, u, read(self.extremum, top))),
            self.level.at[top].set(jnp.where(when, y, read(self.level, top))),
            jnp.where(when, depth + 1, depth),
            jnp.where(full, self.dropped + 1, self.dropped),
        )

    def wipe_out(self, passed: Callable[[Array, Array], Array]) -> "OpenLoops":
        """Close the innermost loop as long as its older reversal (u, y) is `passed`."""

        def closes(depth: Array) -> Array:
            older = jnp.maximum(depth - 2, 0)
            return (depth >= 3) & passed(read(self.extremum, older), read(self.level, older))

        # Two reversals leave at a time. The loop carries only the integer, because XLA would copy arrays.
        depth = jax.lax.while_loop(closes, lambda depth: depth - 2, self.depth)
        return self._replace(depth=depth)


# Sequences that each begin in the same past, hung on one memory tree.


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
    - `place` (anchors,): the position of a node in (pasts, samples of u), joined.
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
