"""A Preisach model on a grid as laws: along its branches, and the parts of one with a first state or a dead
band."""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Tree
from .._parameter import array_module, is_concrete
from ..trees import node, series
from ._everett import EverettTable

# Relays that are up before the first sample: what they add until the input has visited them.
#
# Of a model that starts with all relays down, let `up` be the mass of the relays of each cell that are
# up instead. A relay (alpha, beta) keeps its first state until the input reaches one of its thresholds;
# from then on it is where the model has it anyway. With the least and the greatest input so far, m and
# M, the output therefore differs by 2 Q,
#
#     Q(M, m) = mass of `up` in {alpha > M, beta < m},        m <= M.
#
# Q is bilinear between grid nodes. Let M be in cell I at the fraction F, m in cell J at f.
# If I > J the region has no part of a half cell, and the masses are even in whole cells. If I = J the
# half cell on the diagonal adds the rectangle alpha > F, beta < f, which lies inside its triangle since
# f <= F: a share of 2 (1 - F) f of its mass. The whole rest of row and column is bilinear as before. So
#
#     Q(M, m) = bilinear(S; M, m),    S[p, q] = sum of `up` in rows i >= p and columns j < q,
#
# but that the half cell in S[k, k+1] counts *twice*: its weight is (1 - F) f, and that entry is read for M
# and m in cell k alone. No other entry that is read has a half cell.


class Visited(NamedTuple):
    """The least and the greatest input since the start; (inf, -inf) before the first sample."""

    least: Array | np.ndarray
    greatest: Array | np.ndarray

    @classmethod
    def nothing(cls) -> "Visited":
        """Before the first sample."""
        return cls(jnp.asarray(jnp.inf, float), jnp.asarray(-jnp.inf, float))

    def also(self, u: Array) -> "Visited":
        """With one more input, or with each of many."""
        xp = jnp if isinstance(u, jax.Array) else np
        return Visited(xp.minimum(self.least, u), xp.maximum(self.greatest, u))


def running_extremes(u: Any, before: Visited, starts: tuple[int, ...]) -> Visited:
    """The least and greatest input up to every sample of every sequence; NumPy arrays stay NumPy."""
    traced = isinstance(u, jax.Array)
    least = jax.lax.cummin if traced else np.minimum.accumulate
    greatest = jax.lax.cummax if traced else np.maximum.accumulate
    xp = jnp if traced else np
    pieces = [u[a:b] for a, b in zip(starts, (*starts[1:], len(u)), strict=True)]
    return Visited(
        xp.minimum(before.least, xp.concatenate([least(piece) for piece in pieces])),
        xp.maximum(before.greatest, xp.concatenate([greatest(piece) for piece in pieces])),
    )


def occupancy_table(up: Float[Array, "cells cells"]) -> Float[Array, "nodes nodes"]:
    """S, to be read with `bilinear` at the pairs (M, m)."""
    lower = jnp.tril(up)
    rows_from = jnp.cumsum(lower[::-1], 0)[::-1]
    once = jnp.pad(jnp.cumsum(rows_from, 1), ((0, 1), (1, 0)))
    return once + jnp.diag(jnp.diagonal(lower), 1)


def check_up(up: Any, weights: Any) -> None:
    """Raises `InputError` unless 0 <= up <= weights in every cell, but for a billionth of the largest."""
    if up.shape != weights.shape:
        raise InputError("wrong-shape", f"`up` has shape {up.shape}, the weights {weights.shape}.")
    if not (is_concrete(up) and is_concrete(weights)):
        return
    up, weights = np.tril(np.asarray(up)), np.tril(np.asarray(weights))
    rounding = 1e-9 * np.abs(weights).max()
    wrong = ~((up >= -rounding) & (up <= weights + rounding))
    if wrong.any():
        i, j = np.argwhere(wrong)[0]
        said = f"in cell ({i}, {j}) a mass of {up[i, j]:g} is up, of {weights[i, j]:g}."
        raise InputError("bad-state", said, fix="give masses between 0 and the cell's weight.")


def grid_tree(model: Any, eps: float, depth: int) -> Tree:
    """Of a `Preisach` model on a grid without a first state and a dead band.

    Raises `InputError` where the first staircase alone is deeper than the stack.
    """
    grid, state, depth = model.density, model.init(), depth or model.capacity
    (extremum, levels, held, _), n = state.loops, grid.cells
    if is_concrete(held) and int(held) > depth:
        said = f"the first state alone has {held} reversals, and the stack holds {depth}."
        raise InputError("bad-option", said, fix=f"give a depth of {held} or more.")
    levels = jnp.append(levels, state.y)
    table, begin, outputs = _outputs(model, jnp.append(extremum, state.u), levels)
    floor = -model.orientation * grid.mass(table)
    ceiling = begin[-1] - floor
    even = np.allclose(np.diff(grid.edges), (grid.high - grid.low) / n, rtol=1e-12)
    return node(
        "preisach",
        {
            "cells": n, "scale": n / (grid.high - grid.low) if even else 0.0, "edges": grid.edges,
            "everett": table.node, "diagonal": table.diagonal,
            "reversible": np.zeros(n + 1) if model.reversible is None else begin,
            "orientation": float(model.orientation), "offset": model.offset, "floor": floor,
            "ceiling": ceiling, "flat": max(1e-12, 64 * eps) * (ceiling - floor) / n,
            "margin": 4 * eps * (ceiling - floor), "capacity": depth,
        },
        {
            "extremum": jnp.resize(extremum, (depth,)), "level": jnp.resize(outputs[:-1], (depth,)),
            "depth": held, "forgotten": 0, "rising": (state.rising > 0).astype(int), "u": state.u,
            "z": outputs[-1],
        },
    )  # fmt: skip


@eqx.filter_jit
def _outputs(model: Any, u: Array, relays: Array) -> tuple[EverettTable, Array, Array]:
    """E, the reversible part at the nodes, and the outputs without the offset where relays give so much."""
    none = model.reversible is None
    increment = jnp.zeros(model.density.cells) if none else jnp.asarray(model.reversible)
    begin = jnp.append(0.0, jnp.cumsum(increment))
    cell, fraction = model.density.locate(u)
    reversible = begin[cell] + fraction * increment[cell]
    return model.density.tabulate(), begin, reversible + model.orientation * relays


def parts_of(model: Any, eps: float, depth: int) -> list[Tree]:
    """The parts of a sum: the reversible part, and relays behind their dead band, with a first state."""
    edges, n = model.density.edges, model.density.cells
    increments: Any = np.zeros(n) if model.reversible is None else model.reversible
    alone = replace(model, up=None, dead_band=0.0, reversible=None, offset=jnp.zeros(()))
    relays = [grid_tree(alone, eps, depth)]
    if model.up is not None:
        mass = 2 * model.orientation * occupancy_table(jnp.asarray(model.up))
        first = {"begun": 0, "least": 0.0, "greatest": 0.0}
        relays.append(node("occupancy", {"cells": n, "edges": edges, "mass": mass}, first))
    if model.dead_band:
        band = {"width": model.dead_band}, {"begun": 0, "held": 0.0}
        relays = [series(node("dead_band", *band), one) for one in relays]
    xp = array_module(increments, model.offset)
    rises = xp.append(0.0, xp.cumsum(xp.asarray(increments)))
    slopes = increments / np.diff(edges)
    reversible = node(
        "curve",
        {
            "cells": n, "nodes": edges, "outputs": jnp.asarray(xp.asarray(model.offset) + rises),
            "starts": slopes, "ends": slopes, "margin": 0.0, "flat": 0.0, "endless": 1,
        },
        {"value": 0.0},
    )  # fmt: skip
    return [reversible, *relays]
