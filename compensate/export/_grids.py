"""Densities without a grid, tabulated on one: the elements know those on grids alone."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, InputError, Preisach
from hysteresis.preisach import GridDensity

CELLS = 120
"""Of the grid on which a density is tabulated that has none: its table is 117 kB in double."""


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
    grid = GridDensity(density.low, density.high, weights, nodes=uneven)
    reversible = model.reversible
    if reversible is not None:
        reversible = np.repeat(np.asarray(reversible) / (cells // n), cells // n)
    return replace(model, density=grid, reversible=reversible)


def with_grids(model: AbstractModel) -> AbstractModel:
    """The model, every density in it that is not on a grid tabulated on one."""

    def is_off(part: Any) -> bool:
        return isinstance(part, Preisach) and not isinstance(part.density, GridDensity)

    if not any(map(is_off, jax.tree.leaves(model, is_leaf=is_off))):
        return model
    return jax.tree.map(lambda p: on_a_grid(p) if is_off(p) else p, model, is_leaf=is_off)
