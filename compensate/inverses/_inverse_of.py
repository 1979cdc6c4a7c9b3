"""`inverse_of`: the inverse of one model, by its kind, and that of a model that has no own."""

from collections.abc import Callable
from functools import singledispatch
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import (
    AbstractModel,
    BoucWenForce,
    Conditioned,
    CyclicDrift,
    DegradingBoucWen,
    DuhemForce,
    GeneralizedPlays,
    InputError,
    LinearSponge,
    Mixture,
    MonotoneCurve,
    Oscillator,
    Preisach,
    Scaled,
    Series,
    StopsAndPowers,
    Sum,
    TimeDrift,
    parameters,
    register,
)
from hysteresis._parameter import PyTree, is_concrete
from hysteresis._registry import OURS
from hysteresis.curves import MonotoneSpline, PolynomialCurve
from hysteresis.models._conditioned import condition_of, last_factor
from hysteresis.preisach import GridDensity
from hysteresis.trees import FLAT_WIDTH, ROUNDING, input_range, search_range, size_of

from .._contract import AbstractCompensator, Estimate, Status, scanned
from .._readings import reading_of, with_reading
from ._law import LawCompensator, has_laws, looks_of, require_columns, told_of_condition

# Inverse of any model whose output rises with its input: by bisection, sample by sample.


def inputs_between(
    outputs: Callable[[Array], Array], ends: Float[Array, "2"], wanted: Float[Array, "2"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The first and the last input within `ends` whose output is within `wanted`, by bisection.

    `outputs`: of several inputs, none lower than that of a lower input.
    """

    def halve(_: Array, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        below, above = bracket
        middle = below + (above - below) / 2
        short = outputs(middle) < wanted
        return jnp.where(short, middle, below), jnp.where(short, above, middle)

    bracket = jnp.full_like(ends, ends[0]), jnp.full_like(ends, ends[1])
    below, above = jax.lax.fori_loop(0, jnp.finfo(ends.dtype).nmant + 2, halve, bracket)
    return above[0], jnp.maximum(above[0], below[1])


class BracketedState(NamedTuple):
    """The state of the model, and the last estimate."""

    model: PyTree
    value: Array


@register
class BracketedCompensator(AbstractCompensator[BracketedState, Estimate]):
    """u from y by bisection of u -> model.step(state, t, u) on [low, high].

    The inputs whose output is y but for rounding are an interval. The one nearest to the last
    estimate is taken, and is FLAT where the interval is wider than a millionth of the range. Outputs
    beyond those of `low` and `high` are SATURATED: the end is held.

    Of a model that depends on a condition readings are the columns of an array (samples, 2) in `simulate`,
    and `step` takes the pair (y, c). Two per cent beyond the known conditions the status is EXTRAPOLATED.

    **Arguments:**

    - `model`: any model whose output does not fall while its input rises, or rise, whatever came before.
    - `low`, `high`: the inputs to look for.

    A step costs about 110 of the model's.

    **Example:**

        >>> search = compensate.internal.BracketedCompensator(model, -10.0, 10.0)
        >>> search.simulate(t, model.simulate(t, u)).value.round(6).tolist() == u.tolist()
        True
    """

    model: AbstractModel
    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    searches = True

    def init(self) -> BracketedState:
        return BracketedState(self.model.init(), jnp.asarray(self.low, float))

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: BracketedState
    ) -> tuple[BracketedState, Estimate]:
        require_columns(self.model, y)
        return scanned(self, t, jnp.asarray(y, float), state)

    def take(
        self, state: BracketedState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[BracketedState, Estimate]:
        """Outputs closer than `ROUNDING` roundings of the reading, or of the largest output of the virgin
        model at the ends, are one output."""
        y = jnp.asarray(y, state.value.dtype)

        def run(u: Array) -> tuple[PyTree, Array]:
            return self.model.step(state.model, t, with_reading(y, 0, u))

        def outputs(levels: Array) -> Array:
            return jax.vmap(lambda u: run(u)[1])(levels)

        ends = jnp.asarray([self.low, self.high], y.dtype)
        first, last = outputs(ends)
        way = jnp.where(last < first, -1.0, 1.0).astype(y.dtype)
        reading, valid = way * reading_of(y, 0), jnp.isfinite(y).all()
        size = jnp.maximum(jnp.abs(reading), self.size(t).astype(y.dtype))
        margin = ROUNDING * jnp.finfo(y.dtype).eps * size
        wanted = jnp.stack([reading - margin, reading + margin])
        least, most = inputs_between(lambda levels: way * outputs(levels), ends, wanted)

        value = jnp.where(valid, jnp.clip(state.value, least, most), state.value)
        flat = most - least > FLAT_WIDTH * (self.high - self.low)
        beyond = (wanted[0] > way * last) | (wanted[1] < way * first)
        status = jnp.where(beyond, Status.SATURATED, jnp.where(flat, Status.FLAT, Status.OK))
        status = told_of_condition(self.model, y[None], status[None])[0]
        after = jax.tree.map(
            lambda new, old: jnp.where(valid, new, old), run(value)[0], state.model
        )
        status = jnp.where(valid, status, Status.INVALID)
        return BracketedState(after, value), Estimate(value, status)

    def size(self, t: ArrayLike | None = 0.0) -> Array:
        """Of the outputs of the virgin model at the ends, the largest one."""
        conditioned = condition_of(self.model)
        models = (self.model,) if conditioned is None else conditioned.models
        return jnp.stack([size_of(one, t, self.low, self.high) for one in models]).max()


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


# Inverses of models that are composed or depend on a condition: by laws, or by bisection without one.


@inverse_of.register
def _(model: Series | Scaled) -> AbstractCompensator:
    parts = model.parts if isinstance(model, Series) else (model.inner,)
    laws = [isinstance(inverse_of(part), LawCompensator) for part in parts]  # refuses one without
    if all(laws):
        return LawCompensator(model)
    return BracketedCompensator(model, *search_range(parts[0]))


@inverse_of.register
def _(model: Sum) -> AbstractCompensator:
    if len(model.parts) == 1:
        return inverse_of(model.parts[0])
    ends = search_range(model)
    if not any(map(input_range, model.parts)) or not all(map(is_concrete, ends)):
        raise InputError(
            "not-invertible",
            "no part of the sum says over which inputs it holds, so none can be looked for.",
            fix="BracketedCompensator(model, low, high).",
        )
    return _checked(model, model.parts)


@inverse_of.register
def _(model: Mixture) -> AbstractCompensator:
    if len(model.models) == 1:
        return inverse_of(model.whole.parts[0])
    return _checked(model, model.models)


@inverse_of.register
def _(model: Conditioned) -> AbstractCompensator:
    for one in model.models:
        inverse_of(one)  # refuses a model that has no inverse
    factors = [last_factor(one) for one in model.models]
    if len({is_concrete(factor) and float(factor) < 0 for factor in factors}) > 1:
        raise InputError(
            "not-invertible",
            f"the output rises with the input at some values of {model.condition}, and falls at others.",
            fix="fit the conditions apart (--each COL).",
        )
    return inverse_of_rising(model)


def _checked(model: AbstractModel, parts: tuple[AbstractModel, ...]) -> AbstractCompensator:
    if any(map(_falls, parts)):
        check_rises(model)
    return inverse_of_rising(model)


def _falls(model: AbstractModel) -> bool:
    """Whether the output of a model falls as its input rises, by its scales."""
    if isinstance(model, Scaled):
        return _falls(model.inner) != bool(is_concrete(model.factor) and np.all(model.factor < 0))
    if isinstance(model, Series):
        return sum(map(_falls, model.parts)) % 2 == 1
    return isinstance(model, Sum) and any(map(_falls, model.parts))


# Which models have an inverse, and why others have none.


@inverse_of.register
def _(model: LinearSponge) -> AbstractCompensator:
    if is_concrete(model.K) and not np.all(np.asarray(model.K) != 0):
        raise InputError(
            "not-invertible",
            "the line's slope K is 0, so the output says nothing about the input.",
            fix="fit a record whose output changes with its input.",
        )
    return LawCompensator(model)


@inverse_of.register
def _(model: MonotoneCurve | MonotoneSpline) -> AbstractCompensator:
    rises = model.rises()
    if is_concrete(rises) and not np.any(np.asarray(rises) > 0):
        raise InputError(
            "not-invertible",
            "the curve does not rise, so the output says nothing about the input.",
            fix="fit a record whose output changes with its input.",
        )
    return LawCompensator(model)


@inverse_of.register
def _(model: PolynomialCurve) -> AbstractCompensator:
    """The least slope is at an end, or where the second derivative is 0."""
    if not all(is_concrete(value) for value in jax.tree.leaves(model)):
        return LawCompensator(model)
    slope = np.polynomial.Polynomial(np.asarray(model.coefficients)).deriv()
    roots = slope.deriv().roots()
    inner = roots.real[(np.abs(roots.imag) < 1e-9) & (np.abs(roots.real) < 1)]
    x = np.append(inner, [-1.0, 1.0])
    slopes, low, high = slope(x), float(model.low), float(model.high)
    size = np.abs(slope.coef).sum()
    # Of an inflection with a horizontal tangent, rounding makes a slope of either sign.
    if size == 0 or slopes.min() < -1e-12 * size:
        place = low + (high - low) * (x[slopes.argmin()] + 1) / 2
        raise InputError(
            "not-invertible",
            f"the polynomial does not rise at {place:.6g}, so an output there has several inputs.",
            fix="fit a lower degree, a narrower range, or a MonotoneCurve.",
        )
    return LawCompensator(model)


@inverse_of.register
def _(model: DegradingBoucWen) -> AbstractCompensator:
    least = model.least_slope()
    if is_concrete(least) and model.strength_loss is not None and float(least) <= 0:
        raise InputError(
            "not-invertible",
            f"alpha = {float(model.inner.alpha):.3g} with strength_loss ="
            f" {float(model.strength_loss):.3g}: strength may be lost faster than the line rises, and an"
            " output then has several inputs.",
            cause="what is left of the stiffness after yield is too small for this loss.",
            fix="fit with strength_loss < n alpha / (1 - alpha), or without strength_loss.",
        )
    return LawCompensator(model)


@inverse_of.register
def _(model: Preisach) -> AbstractCompensator:
    density = model.density
    if isinstance(density, GridDensity):
        if all(map(is_concrete, jax.tree.leaves(model))):  # else the fit has seen to its slopes
            _check_slopes(model)
        return LawCompensator(model)
    if model.leading:
        raise InputError(
            "not-invertible",
            f"nothing says that a leading model with a {type(density).__name__} rises with its input.",
            cause="its relays fall as the input rises, and their slope is known on a grid alone.",
            fix="fit a GridDensity, or swap input and output and fit the lagging direction.",
        )
    return BracketedCompensator(model, *model.search_range())


def _check_slopes(model: Preisach) -> None:
    """Raise `InputError` where the output of a model on a grid can fall while its input rises."""
    grid: Any = model.density
    slope, widths = np.asarray(model.least_slope()), np.diff(grid.edges)
    scale = float(np.abs(np.asarray(grid.weights)).max())
    if (slope * widths < -1e-9 * scale).any():
        k = int(slope.argmin())
        raise InputError(
            "not-invertible",
            f"the output can fall while the input rises from {grid.edges[k]:g} to {grid.edges[k + 1]:g}.",
            cause="a signed density, or a reversible part too flat for a leading model.",
            fix="fit the model with its slopes constrained, which identify.fit does.",
        )


@inverse_of.register
def _(model: StopsAndPowers | BoucWenForce | DuhemForce | GeneralizedPlays) -> AbstractCompensator:
    raise InputError(
        "not-invertible",
        f"the output of a {type(model).__name__} need not rise with its input.",
        cause="its stiffnesses may have either sign.",
        fix="fit PrandtlIshlinskii, or a sum of parts that rise.",
    )


@inverse_of.register
def _(model: CyclicDrift | TimeDrift) -> AbstractCompensator:
    raise InputError(
        "not-invertible",
        f"the output of a {type(model).__name__} does not depend on the present input.",
        fix="add a part that rises with it: Sum([part, drift]).",
    )


@inverse_of.register
def _(model: Oscillator) -> AbstractCompensator:
    raise InputError(
        "not-invertible",
        "the force of an oscillator cannot be recovered sample by sample.",
        cause="its mass answers with an acceleration, and the second derivative of a noisy displacement is"
        " noise.",
        fix="low-pass the displacement of a whole record to the band that is wanted, and take m y'' + c y'"
        " + k y + z[y] of it; invert(model.hysteresis) is the inverse without the mass.",
    )
