"""The inverse of a model without laws: by bisection, after a check that its output rises."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from hysteresis import AbstractModel, InputError, is_concrete, parameters
from hysteresis._type_variables import PyTree
from hysteresis.trees import ROUNDING, search_range

from .._contract import AbstractCompensator
from ._bisection import BracketedCompensator
from ._inverse_of import inverse_of
from ._law import LawCompensator, has_laws

WALKS, STEPS, GRID = 16, 24, 65
"""Histories of the check, samples of each, and inputs whose outputs are compared at every sample."""


class _Fall(NamedTuple):
    """The largest fall of the output, of which inputs, and whether all outputs were finite."""

    size: Array
    inputs: Array
    outputs: Array
    finite: Array


@inverse_of.register
def _(model: AbstractModel) -> AbstractCompensator:
    """Between the ends that the model names (`low`, `high`, `nodes`), else as far as its parameters reach.

    The check is no proof: it looks at random histories of every size. Raises `InputError` where one
    of them shows a falling output, and where the parameters are not known yet, under `jit` or `vmap`.
    """
    name = type(model).__name__
    if has_laws(model):
        return LawCompensator(model)
    values = [value for _, _, value in parameters(model) if value is not None]
    if not all(is_concrete(value) for value in values):
        raise InputError(
            "not-invertible",
            f"whether the output of {name} rises cannot be checked while it is traced.",
            fix="give the inverse: EnsembleCompensator(..., inverse=lambda m: BracketedCompensator(m, low,"
            " high)).",
        )
    low, high = map(float, search_range(model))
    fall = _largest_fall(model, *_histories(low, high))
    if not fall.finite or fall.size > 0:
        problem = (
            f"the output of {name} falls from {fall.outputs[0]:.4g} to {fall.outputs[1]:.4g} while its"
            f" input rises from {fall.inputs[0]:.4g} to {fall.inputs[1]:.4g}."
            if fall.finite
            else f"the output of {name} is not finite for all inputs between {low:.4g} and {high:.4g}."
        )
        raise InputError(
            "not-invertible",
            problem,
            cause="only an output that rises with the input, whatever came before, belongs to one input.",
            fix="BracketedCompensator(model, low, high) between inputs where it rises, or register an"
            f" inverse of its own: compensate.inverse_of.register({name}, ...).",
        )
    return BracketedCompensator(model, low, high)


def _histories(low: float, high: float) -> tuple[Array, Array, Array]:
    """Times and inputs of the walks, and the inputs compared: close to the middle the closest."""
    random, middle, half = np.random.default_rng(0), (low + high) / 2, (high - low) / 2
    sizes = half * 10.0 ** -np.linspace(0, 4, WALKS)[:, None]
    inputs = middle + sizes * random.uniform(-1, 1, (WALKS, STEPS))
    times = np.cumsum(10.0 ** random.uniform(-3, 1, (WALKS, STEPS)), 1)
    grid = middle + half * np.sinh(np.linspace(-10, 10, GRID)) / np.sinh(10)
    return jnp.asarray(times, float), jnp.asarray(inputs, float), jnp.asarray(grid, float)


@eqx.filter_jit
def _largest_fall(model: AbstractModel, times: Array, inputs: Array, grid: Array) -> Any:
    def sample(state: PyTree, at: tuple[Array, Array]) -> tuple[PyTree, _Fall]:
        t, u = at
        y = jax.vmap(lambda x: model.step(state, t, x)[1])(grid)
        margin = ROUNDING * jnp.finfo(y.dtype).eps * jnp.abs(y).max()
        falls = y[:-1] - y[1:] - margin
        worst = jnp.argmax(falls)
        ends = jnp.stack([worst, worst + 1])
        return model.step(state, t, u)[0], _Fall(
            falls[worst], grid[ends], y[ends], jnp.isfinite(y).all()
        )

    def walk(t: Array, u: Array) -> _Fall:
        return jax.lax.scan(sample, model.init(), (t, u))[1]

    falls = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), jax.vmap(walk)(times, inputs))
    worst = jnp.argmax(falls.size)
    return _Fall(falls.size[worst], falls.inputs[worst], falls.outputs[worst], falls.finite.all())
