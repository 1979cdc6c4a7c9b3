"""Inverse of any model whose output rises with its input: by bisection, sample by sample."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, register
from hysteresis.trees import FLAT_WIDTH, ROUNDING, size_of

from .._contract import AbstractCompensator, Estimate, Status, scan_steps


def inputs_between(
    outputs: Callable[[Array], Array], ends: Float[Array, "2"], wanted: Float[Array, "2"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The first and the last input within `ends` whose output is within `wanted`, by bisection.

    `outputs`: of several inputs, none lower than that of a lower input.
    """

    def halve(_: Any, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        below, above = bracket
        middle = below + (above - below) / 2
        short = outputs(middle) < wanted
        return jnp.where(short, middle, below), jnp.where(short, above, middle)

    bracket = jnp.full_like(ends, ends[0]), jnp.full_like(ends, ends[1])
    below, above = jax.lax.fori_loop(0, jnp.finfo(ends.dtype).nmant + 2, halve, bracket)
    return above[0], jnp.maximum(above[0], below[1])


class BracketedState(NamedTuple):
    """The state of the model, and the last estimate."""

    model: Any
    value: Array


@register
class BracketedCompensator(AbstractCompensator[BracketedState, Estimate]):
    """u from y by bisection of u -> model.step(state, t, u) on [low, high], where that never falls.

    The inputs whose output is y but for rounding are an interval. The one nearest to the last
    estimate is taken, and is FLAT where the interval is wider than a millionth of the range. Outputs
    beyond those of `low` and `high` are SATURATED: the end is held.

    **Arguments:**

    - `model`: any model whose output does not fall while its input rises, whatever came before.
    - `low`, `high`: the inputs to look for.

    A step costs about 110 of the model's.

    **Example:**

        >>> search = compensate.BracketedCompensator(model, -10.0, 10.0)
        >>> search.simulate(t, model.simulate(t, u)).value.round(6).tolist() == u.tolist()
        True
    """

    model: AbstractModel
    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)

    @property
    def searches(self) -> bool:
        """As of a `LawCompensator`."""
        return True

    def init(self) -> BracketedState:
        return BracketedState(self.model.init(), jnp.asarray(self.low, float))

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: BracketedState | None = None
    ) -> Estimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, t, y, self.init() if state is None else state)[1]

    def step(
        self, state: BracketedState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[BracketedState, Estimate]:
        y = jnp.asarray(y, state.value.dtype)
        size = self.size(t).astype(y.dtype)
        return bracketed(
            lambda own, u: self.model.step(own, t, u), state, y, self.low, self.high, size
        )

    def size(self, t: ArrayLike | None = 0.0) -> Array:
        """Of the outputs of the virgin model at the ends, the largest one."""
        return size_of(self.model, t, self.low, self.high)


def bracketed(
    run: Callable[[Any, Array], tuple[Any, Array]],
    state: BracketedState,
    y: Float[Array, ""],
    low: float,
    high: float,
    size: Array,
) -> tuple[BracketedState, Estimate]:
    """One reading of a `BracketedCompensator`; `run` is one step of its model: (state, u) to (state, y).

    Outputs closer than `ROUNDING` roundings of the reading, or of `size`, are one output.
    """
    outputs = jax.vmap(lambda u: run(state.model, u)[1])
    ends = jnp.stack([jnp.full_like(y, low), jnp.full_like(y, high)])
    least, greatest = outputs(ends)
    eps = jnp.finfo(y.dtype).eps
    margin = ROUNDING * eps * jnp.maximum(jnp.abs(y), size)
    wanted = jnp.stack([y - margin, y + margin])
    first, last = inputs_between(outputs, ends, wanted)

    valid = jnp.isfinite(y)
    value = jnp.where(valid, jnp.clip(state.value, first, last), state.value)
    flat = last - first > FLAT_WIDTH * (high - low)
    beyond = (wanted[0] > greatest) | (wanted[1] < least)
    status = jnp.where(beyond, Status.SATURATED, jnp.where(flat, Status.FLAT, Status.OK))
    after, _ = run(state.model, value)
    after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state.model)
    status = jnp.where(valid, status, Status.INVALID)
    return BracketedState(after, value), Estimate(value, status)
