"""Preisach models as elements: on a grid, with a first state or a dead band, and any density on a grid."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, InputError, Preisach
from hysteresis.preisach import AbstractGridDensity, GridDensity
from hysteresis.preisach._occupancy import occupancy_table

from ..inverses._preisach import PreisachCompensator
from ._node import Tree, node

CELLS = 120
"""Of the grid on which a density is tabulated that has none: its table is 117 kB in double."""


def preisach_node(model: Preisach, eps: float, depth: int) -> Tree:
    """A model on a grid, without a first state and a dead band: the element that has an inverse of its own.

    Raises `InputError` where the first staircase alone is deeper than the stack.
    """
    grid: Any = model.density
    compensator = PreisachCompensator(model)
    begin = compensator.init()
    held = int(begin.loops.depth)
    if held > depth:
        raise InputError(
            "bad-option",
            f"the first state alone has {held} reversals, and the stack holds {depth}.",
            fix=f"give a depth of {held} or more.",
        )
    table = compensator.table
    even = np.allclose(np.diff(grid.edges), (grid.high - grid.low) / grid.cells, rtol=1e-12)
    flat = max(1e-12, 64 * eps) * (compensator.ceiling - compensator.floor) / grid.cells
    return node(
        "preisach",
        {
            "cells": grid.cells, "scale": grid.cells / (grid.high - grid.low) if even else 0.0,
            "edges": grid.edges, "everett": table.node, "diagonal": table.diagonal,
            "reversible": compensator.begin, "orientation": float(model.orientation),
            "offset": model.offset, "floor": compensator.floor, "ceiling": compensator.ceiling,
            "flat": flat, "margin": 4 * eps * (compensator.ceiling - compensator.floor),
            "capacity": depth,
        },
        {
            "extremum": np.resize(np.asarray(begin.loops.extremum), depth),
            "level": np.resize(np.asarray(begin.loops.level), depth),
            "depth": held, "forgotten": 0, "rising": int(begin.rising > 0), "u": begin.u, "z": begin.z,
        },
    )  # fmt: skip


def preisach_parts(model: Preisach, eps: float, depth: int) -> list[Tree]:
    """The parts of a sum: relays behind their dead band, with a first state, and the reversible part."""
    grid: Any = model.density
    edges = np.asarray(grid.edges)
    increments = np.zeros(grid.cells) if model.reversible is None else np.asarray(model.reversible)
    alone = replace(model, up=None, dead_band=0.0, reversible=None, offset=jnp.zeros(()))
    relays = [preisach_node(alone, eps, depth)]
    if model.up is not None:
        mass = 2 * model.orientation * np.asarray(occupancy_table(jnp.asarray(model.up)))
        relays.append(
            node(
                "occupancy", {"cells": grid.cells, "edges": edges, "mass": mass},
                {"begun": 0, "least": 0.0, "greatest": 0.0},
            )
        )  # fmt: skip
    if model.dead_band:
        held = {"begun": 0, "held": 0.0}
        relays = [
            {"kind": "series", "parts": [node("dead_band", {"width": model.dead_band}, held), one]}
            for one in relays
        ]
    slopes = increments / np.diff(edges)
    outputs = float(model.offset) + np.append(0.0, np.cumsum(increments))
    reversible = node(
        "curve",
        {
            "cells": grid.cells, "nodes": edges, "outputs": outputs, "starts": slopes, "ends": slopes,
            "margin": 0.0, "flat": 0.0, "endless": 1,
        },
        {"value": 0.0},
    )  # fmt: skip
    return [reversible, *relays]


def on_a_grid(model: Preisach) -> Preisach:
    """The model with its density tabulated: exact at the nodes, even within the cells.

    Raises `InputError` where a cell would have a negative mass.
    """
    density: Any = model.density
    n = 1 if model.reversible is None else len(np.asarray(model.reversible))
    cells = n * -(-CELLS // n)
    edges = getattr(density, "edges", None)
    if edges is not None:
        # Cells of its own are cut alike, so that the reversible part stays what it is.
        own = np.asarray(edges)
        cut = -(-CELLS // (len(own) - 1))
        parts = own[:-1, None] + np.diff(own)[:, None] * np.arange(cut) / cut
        nodes, cells = np.append(parts.ravel(), own[-1]), cut * (len(own) - 1)
    else:
        nodes = np.linspace(density.low, density.high, cells + 1)
    i, j = np.tril_indices(cells + 1)
    found = density.everett(
        density.tabulate(), density.pair(jnp.asarray(nodes[i]), jnp.asarray(nodes[j]))
    )
    E = np.zeros((cells + 1, cells + 1))
    E[i, j] = np.asarray(found)
    # Of the cell between nodes i, i + 1 and j, j + 1; E is 0 above the diagonal.
    weights = np.tril(E[1:, :-1] - E[:-1, :-1] - E[1:, 1:] + E[:-1, 1:])
    least = float(weights.min())
    if least < -1e-9 * float(E.max()):
        raise InputError(
            "not-exportable",
            f"A {type(density).__name__} has cells of negative mass.",
            cause="its Everett function does not rise everywhere, so no grid of masses has it.",
            fix="Fit a GridDensity.",
        )
    weights = np.maximum(weights, 0.0)
    even = np.allclose(np.diff(nodes), (nodes[-1] - nodes[0]) / cells, rtol=1e-12)
    uneven = None if even else tuple(nodes.tolist())
    grid: AbstractGridDensity = GridDensity(density.low, density.high, weights, nodes=uneven)
    reversible = model.reversible
    if reversible is not None:
        reversible = np.repeat(np.asarray(reversible) / (cells // n), cells // n)
    return replace(model, density=grid, reversible=reversible)


def with_grids(model: AbstractModel) -> AbstractModel:
    """The model, every density in it that is not on a grid tabulated on one."""

    def is_off(part: Any) -> bool:
        return isinstance(part, Preisach) and not isinstance(part.density, AbstractGridDensity)

    if not any(map(is_off, jax.tree.leaves(model, is_leaf=is_off))):
        return model
    return jax.tree.map(lambda p: on_a_grid(p) if is_off(p) else p, model, is_leaf=is_off)
