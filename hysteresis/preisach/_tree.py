"""A Preisach model on a grid as laws: along its branches, and the parts of one with a first state or a dead
band."""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._errors import InputError
from .._model import Tree
from .._parameter import array_module, is_concrete
from ..trees import node, series
from ._everett import EverettTable
from ._occupancy import occupancy_table
from ._stack import OpenLoops


class Branches(NamedTuple):
    """What the branches of a model on a grid share: E, the reversible part R at the nodes, its rises over
    the cells, and the outputs in saturation without the offset."""

    table: EverettTable
    begin: Float[Array, " nodes"]
    increment: Float[Array, " cells"]
    floor: Float[Array, ""]
    ceiling: Float[Array, ""]


class Branch(NamedTuple):
    """The open loops, their levels outputs without the offset; input and output now; +1 or -1."""

    loops: OpenLoops
    u: Float[Array, ""]
    z: Float[Array, ""]
    rising: Int[Array, ""]


def branches_of(model: Any) -> Branches:
    """Of a `Preisach` model on a grid."""
    table = model.density.tabulate()
    none = model.reversible is None
    increment = jnp.zeros(model.density.cells) if none else jnp.asarray(model.reversible)
    begin = jnp.append(0.0, jnp.cumsum(increment))
    mass = model.density.mass(table)
    floor, ceiling = -model.orientation * mass, begin[-1] + model.orientation * mass
    return Branches(table, begin, increment, floor, ceiling)


def first_branch(model: Any, of: Branches) -> Branch:
    """Where a model begins."""
    past = model.init()
    whole = _whole(model, of, past.loops.extremum, past.loops.level)
    return Branch(
        past.loops._replace(level=whole), past.u, _whole(model, of, past.u, past.y), past.rising
    )


@eqx.filter_jit
def _whole(model: Any, of: Branches, u: Array, relays: Array) -> Array:
    """The output of relays and reversible part."""
    cell, fraction = model.density.locate(u)
    return of.begin[cell] + fraction * of.increment[cell] + model.orientation * relays


def grid_tree(model: Any, eps: float, depth: int) -> Tree:
    """Of a `Preisach` model on a grid without a first state and a dead band.

    Raises `InputError` where the first staircase alone is deeper than the stack.
    """
    grid, of, depth = model.density, branches_of(model), depth or model.capacity
    begin = first_branch(model, of)
    held, n = begin.loops.depth, grid.cells
    if is_concrete(held) and int(held) > depth:
        raise InputError(
            "bad-option",
            f"the first state alone has {held} reversals, and the stack holds {depth}.",
            fix=f"give a depth of {held} or more.",
        )
    even = np.allclose(np.diff(grid.edges), (grid.high - grid.low) / n, rtol=1e-12)
    return node(
        "preisach",
        {
            "cells": n, "scale": n / (grid.high - grid.low) if even else 0.0, "edges": grid.edges,
            "everett": of.table.node, "diagonal": of.table.diagonal,
            "reversible": np.zeros(n + 1) if model.reversible is None else of.begin,
            "orientation": float(model.orientation), "offset": model.offset, "floor": of.floor,
            "ceiling": of.ceiling, "flat": max(1e-12, 64 * eps) * (of.ceiling - of.floor) / n,
            "margin": 4 * eps * (of.ceiling - of.floor), "capacity": depth,
        },
        {
            "extremum": jnp.resize(begin.loops.extremum, (depth,)),
            "level": jnp.resize(begin.loops.level, (depth,)), "depth": held, "forgotten": 0,
            "rising": (begin.rising > 0).astype(int), "u": begin.u, "z": begin.z,
        },
    )  # fmt: skip


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
