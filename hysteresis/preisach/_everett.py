"""The Everett function of a density that is constant on each cell of a grid: exact, by table look-up.

E(a, b) is the mass of {b <= beta <= alpha <= a}. Let T[p, q] be E between grid nodes, made symmetric
by E(b, a) = E(a, b). For a in cell i with fraction f let h(a) = w_ii f (f - 1), where w_ii is the mass
of the half cell on the diagonal. Then

    E(a, b) = bilinear(T; a, b) + h(a) + h(b)

exactly. The half cells make E quadratic near the diagonal: without h the output jumps at every
reversal, since E(a, a) must be 0 while bilinear(T; a, a) = 2 w_ii f (1 - f).
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._parameter import is_concrete
from .._registry import register
from ..running._traced import on_host
from ._memory import MemoryTree, memory_tree

Tree = TypeVar("Tree")


@register
class EverettTable(NamedTuple):
    """E between grid nodes (n+1, n+1), symmetric, and the masses of the diagonal half cells (n,)."""

    node: Float[Array, "nodes nodes"]
    diagonal: Float[Array, " cells"]


class GridPairs(NamedTuple):
    """Pairs (a, b) located on the grid: the cell of a, its table entry with b's, both fractions."""

    cell: Int[Array, "*pairs"]
    cell_b: Int[Array, "*pairs"]
    corner: Int[Array, "*pairs"]
    fraction: Float[Array, "*pairs"]
    fraction_b: Float[Array, "*pairs"]


@jax.jit
def everett_table(weights: Float[Array, "cells cells"]) -> EverettTable:
    """T[p, q] = sum of the weights in rows i < p and columns j >= q, for p >= q; symmetric."""
    lower = jnp.tril(weights)
    up_to_row = running_sum(lower)
    node = running_sum(up_to_row.T, from_the_end=True)  # transposed, [q, p]
    # No row lies below node 0 and no column from node n on, so the padding is exact. Entries with p <= q
    # are 0 so far, so adding the transpose doubles nothing.
    node = jnp.pad(node, ((0, 1), (1, 0)))
    return EverettTable(node + node.T, jnp.diagonal(lower))


@partial(jax.jit, static_argnames="from_the_end")
def running_sum(rows: Array, from_the_end: bool = False) -> Array:
    """Cumulative sum over the first axis, row by row: on a CPU twice as fast as `jnp.cumsum`."""

    def add(total: Array, row: Array) -> tuple[Array, Array]:
        total = total + row
        return total, total

    return jax.lax.scan(add, jnp.zeros_like(rows[0]), rows, reverse=from_the_end)[1]


def everett_terms(table: EverettTable, pairs: GridPairs) -> tuple[Array, Array, Array]:
    """E(a, b) of every pair as three terms: bilinear(T; a, b), h(a) and h(b).

    They are separate because many pairs share an a, for which h(a) is then computed once.
    """
    f, g = pairs.fraction, pairs.fraction_b
    half_a = read(table.diagonal, pairs.cell) * f * (f - 1)
    half_b = read(table.diagonal, pairs.cell_b) * g * (g - 1)
    return bilinear(table.node, pairs), half_a, half_b


def bilinear(table: Float[Array, "nodes nodes"], pairs: GridPairs) -> Float[Array, "*pairs"]:
    """The table at every pair, bilinear between its nodes."""
    f, g = pairs.fraction, pairs.fraction_b

    def node(p: int, q: int) -> Array:
        if jnp.ndim(pairs.corner) == 0:
            # A flat view inside a scan's body breaks the loop up: 600 against 25 ns a step.
            return read(table, (pairs.cell + p, pairs.cell_b + q))
        return read(table.reshape(-1), pairs.corner + (p * table.shape[0] + q))

    at_a = node(0, 0) * (1 - g) + node(0, 1) * g
    beyond_a = node(1, 0) * (1 - g) + node(1, 1) * g
    return at_a * (1 - f) + beyond_a * f


def read(array: Array, index: Any) -> Array:
    """array[index] without a bounds check, which would double the time; no index may be negative."""
    return array.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def materialise(tree: Tree, runtime_true: Any) -> Tree:
    """`tree`, computed once and stored. `runtime_true` must be true, and unknown at compile time.

    XLA otherwise fuses a small table into the large gather that reads it and computes an entry again
    for every sample (960 against 325 microseconds at 56,708 samples); its optimization_barrier does
    nothing on a CPU, a branch does.
    """
    return jax.lax.cond(runtime_true, _same, _zeros, tree)


def tabulate_once(density: Any, runtime_true: Any) -> Any:
    """`materialise` of `density.tabulate()`, made inside the branch: a large table is not copied."""
    return jax.lax.cond(runtime_true, _tabulate, _no_table, density)


# Named, not lambdas: outside `jit`, JAX compiles a branch anew for every new function.
def _same(tree: Tree) -> Tree:
    return tree


def _zeros(tree: Tree) -> Tree:
    return jax.tree.map(jnp.zeros_like, tree)


def _tabulate(density: Any) -> Any:
    return density.tabulate()


def _no_table(density: Any) -> Any:
    shapes = jax.eval_shape(_tabulate, density)
    return jax.tree.map(lambda entry: jnp.zeros(entry.shape, entry.dtype), shapes)


# The open loops of a running Preisach model: a stack of reversals of fixed capacity.
#
# The forward model and its inverse keep the same stack; one sees where the input goes, the other
# where the output does.

# The memory tree of a path that is not known yet, inside `jit` and `vmap`.


def traced_tree(path: Float[Array, " samples"]) -> MemoryTree:
    """`memory_tree` of a traced path, called back, in arrays as long as the path.

    Entries are those of `memory_tree`, then padding: anchors that hang on anchor 0 at its own node,
    and events where nothing happens. They are integers: gradients flow through the values they gather.
    """
    samples = path.shape[0]
    kind = jnp.zeros(0, int).dtype
    kinds = [jax.ShapeDtypeStruct((n,), kind) for n in (samples,) * 4 + (samples * 3 // 2, samples)]
    found = on_host(_padded, tuple(kinds), jax.lax.stop_gradient(path))
    return MemoryTree._make(part.astype(jnp.int32) for part in found)


def _padded(path: np.ndarray) -> tuple[np.ndarray, ...]:
    tree, samples = memory_tree(path), len(path)
    pops = samples - len(tree.parent)
    event = np.full(samples * 3 // 2, 2 * samples)
    event[: len(tree.event)] = np.where(
        tree.event < len(tree.parent), tree.event, tree.event + pops
    )
    node, parent, position = (
        np.pad(part, (0, pops)).astype(int) for part in (tree.node, tree.parent, tree.position)
    )
    rising = 1 - 2 * (np.arange(samples) % 2)
    return tree.anchor.astype(int), node, parent, rising, event, position


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
