"""A Preisach model on a grid as laws: along its branches, and the parts of one with a first state or a dead
band."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._errors import InputError
from .._model import Tree
from .._parameter import array_module, is_concrete
from ..trees import node, series
from ._everett import EverettTable
from ._occupancy import occupancy_table


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
