"""`inverse_of`: the inverse of one model, by its kind, and that of a model that has no own."""

from functools import singledispatch

import numpy as np

from hysteresis import AbstractModel, InputError, parameters
from hysteresis._parameter import is_concrete
from hysteresis._registry import OURS
from hysteresis.trees import ROUNDING, search_range

from .._contract import AbstractCompensator
from ._bisection import BracketedCompensator
from ._law import LawCompensator, has_laws
from ._looks import looks_of

WALKS, STEPS, GRID = 16, 24, 65
"""Histories of the check, samples of each, and inputs whose outputs are compared at every sample."""


@singledispatch
def inverse_of(model: AbstractModel) -> AbstractCompensator:
    """`invert` of one model; a function of `functools.singledispatch`, by the class of the model.

    Register the inverse of a model of your own with `inverse_of.register`, as a decorator of a function
    from the model to an `AbstractCompensator`. A model without one gets a `BracketedCompensator`, after a
    check that its output rises with its input.

    Raises `InputError` `not-invertible` where the output does not rise.

    **Example:**

        >>> from compensate import inverse_of
        >>> from hysteresis import LinearSponge
        >>> type(inverse_of(LinearSponge(K=2.0))).__name__
        'LawCompensator'
    """
    raise InputError("not-a-model", f"a {type(model).__name__} is not a model.")


@inverse_of.register
def _(model: AbstractModel) -> AbstractCompensator:
    """Between the ends that the model names (`low`, `high`, `nodes`), else as far as its parameters reach.
    Laws of ours rise by the bounds of their parameters, which are not looked at again.

    The check is no proof: it looks at random histories of every size. Raises `InputError` where one
    of them shows a falling output, and where the parameters are not known yet, under `jit` or `vmap`.
    """
    laws = has_laws(model)
    if laws and type(model).__module__.partition(".")[0] in OURS:
        return LawCompensator(model)
    ends = check_rises(model)
    return LawCompensator(model) if laws else BracketedCompensator(model, *ends)


def inverse_of_rising(model: AbstractModel) -> AbstractCompensator:
    """By its laws, where all parts have some, else by bisection between the ends that it names."""
    if has_laws(model):
        return LawCompensator(model)
    return BracketedCompensator(model, *search_range(model))


def check_rises(model: AbstractModel) -> tuple[float, float]:
    """Raise `InputError` where the output of a model falls on a random history; else the ends between which
    it was looked at."""
    name = type(model).__name__
    values = [value for _, _, value in parameters(model) if value is not None]
    if not all(is_concrete(value) for value in values):
        raise InputError(
            "not-invertible",
            f"whether the output of {name} rises cannot be checked while it is traced.",
            fix="give the inverse: EnsembleCompensator(..., inverse=lambda m: BracketedCompensator(m, low,"
            " high)).",
        )
    low, high = map(float, search_range(model))
    times, inputs, grid = _histories(low, high)
    levels = np.broadcast_to(grid, (STEPS, GRID))
    y = np.stack([looks_of(model, *walk)(levels) for walk in zip(times, inputs, strict=True)])
    margin = ROUNDING * np.finfo(y.dtype).eps * np.abs(y).max(2, keepdims=True)
    falls = y[..., :-1] - y[..., 1:] - margin
    if not falls.max() <= 0:
        *at, k = np.unravel_index(falls.argmax(), falls.shape)
        before, after = y[(*at, slice(k, k + 2))]
        problem = (
            f"the output of {name} falls from {before:.4g} to {after:.4g} while its"
            f" input rises from {grid[k]:.4g} to {grid[k + 1]:.4g}."
            if np.isfinite(y).all()
            else f"the output of {name} is not finite for all inputs between {low:.4g} and {high:.4g}."
        )
        raise InputError(
            "not-invertible",
            problem,
            cause="only an output that rises with the input, whatever came before, belongs to one input.",
            fix="BracketedCompensator(model, low, high) between inputs where it rises, or register an"
            f" inverse of its own: compensate.inverse_of.register({name}, ...).",
        )
    return low, high


def _histories(low: float, high: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and inputs of the walks, and the inputs compared: close to the middle the closest."""
    random, middle, half = np.random.default_rng(0), (low + high) / 2, (high - low) / 2
    sizes = half * 10.0 ** -np.linspace(0, 4, WALKS)[:, None]
    inputs = middle + sizes * random.uniform(-1, 1, (WALKS, STEPS))
    times = np.cumsum(10.0 ** random.uniform(-3, 1, (WALKS, STEPS)), 1)
    return times, inputs, middle + half * np.sinh(np.linspace(-10, 10, GRID)) / np.sinh(10)
