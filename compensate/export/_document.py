"""What exports are made of: trees of models and guards, first states, grids, and the file."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, Feedback, InputError, Oscillator, Preisach
from hysteresis._files import write_whole
from hysteresis.laws._tree import node_of
from hysteresis.preisach import GridDensity
from hysteresis.running import estimates, numbers_of
from hysteresis.trees import Tree, plain

from .._contract import Estimate, Status
from ..guards._guarded import ROUNDING as ROUNDING_OF_ENDS
from ..guards._guarded import GuardedCompensator
from ..guards._run_in import Start, outputs
from ..inverses import inverse_of
from ..runtime._compensator import replay
from ..runtime._file import checksum

# Double precision, without which a file's golden values are too far off for the file to load.


def require_double() -> None:
    """Raise `InputError` where JAX's double precision is off.

    Files are replayed when they are loaded, to 1e-9 of their range. Single precision is 1e-8 off at best.
    """
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise InputError(
            "single-precision",
            "JAX runs in single precision, and a file written so would be refused when it is loaded.",
            cause="The golden values of the file would be 1e-8 off, and have to be right to 1e-9.",
            fix="Call hysid.enable_x64() before any array is made, and make the model again.",
        )


Moved: TypeAlias = Oscillator | Feedback
"""Masses, which go from a force to the displacement."""
Model: TypeAlias = AbstractModel | Feedback
"""What can be exported."""


# Models and what is around their inverses as trees of plain numbers: what the runtimes without JAX run.


def program_of(model: AbstractModel) -> Tree:
    """The tree of a model that can be inverted.

    Raises `InputError` where the model has no inverse, or no element is known for one of its parts.
    """
    inverse_of(model)
    return tree_of(model)


def tree_of(model: Model, precision: type = np.float64, depth: int = 64) -> Tree:
    """The tree of a model for numbers of a precision, and so many reversals of a Preisach model."""
    return plain(model.tree(float(np.finfo(precision).eps), depth))


def nodes_of(tree: Tree) -> Iterator[Tree]:
    """A tree, node by node."""
    yield tree
    for part in tree.get("parts", ()):
        yield from nodes_of(part)


def guard_tree(guard: GuardedCompensator, precision: type = np.float64) -> Tree:
    """The guard of a compensator, as an element."""
    # In single precision an estimate just after a reversal is 1e-3 of the range off.
    part = 0.0 if precision is np.float64 else 1e3 * ROUNDING_OF_ENDS
    made = guard.law(part * float(guard.high - guard.low))
    return {"beyond": guard.beyond, **plain(made)}


# Other first states of a tree, which a file holds.


def starts_in(tree: Tree, model: Any, starts: Iterable[Start]) -> list[list[Tree]]:
    """For each start the states of the tree's elements, in the order of `node_of`."""
    found = []
    for history, _ in starts:
        read = np.asarray(outputs(model, history), float)
        times = np.zeros(len(read)) if history.times is None else np.asarray(history.times, float)
        dt = np.diff(times, prepend=times[0]).tolist()
        *_, states = states_over(tree, "find", dt, read.tolist())
        # Copies: CPython 3.13.0 empties lists of a `__dict__` that outlives its object.
        found.append([dict(vars(state)) for state in states])
    return found


def states_over(tree: Tree, way: str, dt: Sequence[float], y: Sequence[Any]) -> Iterator[list[Any]]:
    """The states of a tree's elements where it is run one way: at first, and after each reading, or pair
    with the condition."""
    states: list[Any] = []
    takes: list[Any] = []
    node = node_of(tree, states, takes)
    yield states
    for step, reading in zip(dt, y, strict=True):
        if takes:
            reading, condition = reading
            for take in takes:
                take(condition)
        getattr(node, way)(step, reading)
        yield states


# What moves under a force where `Program` expects a compensator.


LONGEST = 10.0
"""Samples that one step may last: with longer steps Newmark's method no longer follows the motion."""


class Motion(NamedTuple):
    """Masses where a compensator is expected: readings are forces, estimates displacements."""

    model: Moved

    def simulate(self, t: Any, force: Any) -> Estimate:
        """The displacements from rest; at rest, where no force is known."""
        u, dt = np.asarray(force, float), np.diff(np.asarray(t, float), prepend=t[0])
        if not np.isfinite(u).all():
            return Estimate(jnp.zeros(len(u)), jnp.full(len(u), int(Status.INVALID)))
        found = estimates(numbers_of(self.model.tree()), u, dt, 0.0)
        return Estimate(jnp.asarray(found.value), jnp.asarray(found.status))


# Densities without a grid, tabulated on one: the elements know those on grids alone.


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
    E, pairs = np.zeros((cells + 1, cells + 1)), density.pair(*map(jnp.asarray, nodes[[i, j]]))
    E[i, j] = np.asarray(density.everett(density.tabulate(), pairs))
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


def write(path: str | Path, document: Mapping[str, Any]) -> Path:
    """Write a document with its checksum, as the runtime reads it, whole or not at all."""
    path = Path(path)
    write_whole(path, json.dumps({**document, "checksum": checksum(document)}) + "\n")
    return path


def require_one_input(document: dict[str, Any], dropped: Sequence[str]) -> None:
    """Raise `InputError` `not-invertible`, `bad-option` where plain Python finds other inputs than JAX in
    the golden pair: both search, and only where reversals were `dropped` (the note on it), or a reading
    has several inputs, do they end at different ones."""
    _, off = replay(document)
    if off > document["golden"]["tolerance"]:
        raise InputError(
            "bad-option" if dropped else "not-invertible",
            f"plain Python finds an input {off:.3g} off that of JAX.",
            cause=" ".join(dropped)
            or "The model's output falls while its input rises, so that a reading has several inputs.",
            fix="" if dropped else "Export another model.",
        )
