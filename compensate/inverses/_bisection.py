"""Inverse of any model whose output rises with its input: by bisection, sample by sample."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, register
from hysteresis._type_variables import PyTree
from hysteresis.models._conditioned import condition_of
from hysteresis.trees import FLAT_WIDTH, ROUNDING, size_of

from .._contract import AbstractCompensator, Estimate, Status, scanned
from .._readings import reading_of, with_reading
from ._law import require_columns, told_of_condition


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
