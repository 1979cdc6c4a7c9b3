"""The Everett function of a density that is constant on each cell of a grid: exact, by table look-up.

E(a, b) is the mass of {b <= beta <= alpha <= a}. Let T[p, q] be E between grid nodes, made symmetric
by E(b, a) = E(a, b). For a in cell i with fraction f let h(a) = w_ii f (f - 1), where w_ii is the mass
of the half cell on the diagonal. Then

    E(a, b) = bilinear(T; a, b) + h(a) + h(b)

exactly. The half cells make E quadratic near the diagonal: without h the output jumps at every
reversal, since E(a, a) must be 0 while bilinear(T; a, a) = 2 w_ii f (1 - f).
"""

from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._registry import register

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
