"""Inverse of the Bouc-Wen model that wears."""

import jax
import jax.numpy as jnp
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import DegradingBoucWen, DegradingState, InputError, is_concrete, register
from hysteresis.models._degrading_bouc_wen import LEAST_SLOPE
from hysteresis.trees import ROUNDING

from .._contract import AbstractCompensator, Estimate, Status, scan_steps
from ._inverse_of import inverse_of

MOST_STEPS = 200
"""Each halves the bounds or what is missing; ten do, as a rule."""


@register
class DegradingBoucWenCompensator(AbstractCompensator[DegradingState, Estimate]):
    """x from y: the way from the last x, by Newton's method between bounds that the least slope gives.

    The state is the model's own. Outputs that are not found are beyond what the model can have,
    SATURATED: the last estimate is held.
    """

    model: DegradingBoucWen

    def init(self) -> DegradingState:
        return self.model.init()

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: DegradingState | None = None
    ) -> Estimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, None, y, self.init() if state is None else state)[1]

    def step(
        self, state: DegradingState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[DegradingState, Estimate]:
        y = jnp.asarray(y, state.u.dtype)
        model, inner = self.model, self.model.inner
        valid = jnp.isfinite(y)
        wanted = jnp.where(valid, y, 0.0)
        rise = wanted - inner.output(state.u, state.w)
        sign = jnp.where(rise < 0, -1.0, 1.0)
        size = jnp.abs(wanted) + jnp.abs(inner.offset) + inner.k * inner.yield_at
        margin = ROUNDING * jnp.finfo(y.dtype).eps * size

        # The search carries no derivative: that of the root is that of one more step from where it is.
        search = jax.lax.stop_gradient((model, state, sign, wanted, margin / 4))
        root, slope = _search(*search)
        gap = sign * (wanted - model.step(state, t, state.u + sign * root)[1])
        found, output = model.step(state, t, state.u + sign * (root + gap / slope))

        short = jnp.abs(wanted - output) > margin
        after = jax.tree.map(lambda new, old: jnp.where(valid & ~short, new, old), found, state)
        status = jnp.where(short, Status.SATURATED, Status.OK)
        return after, Estimate(after.u, jnp.where(valid, status, Status.INVALID))


def _search(
    model: DegradingBoucWen, state: DegradingState, sign: Array, wanted: Array, margin: Array
) -> tuple[Array, Array]:
    """The way to an output, and the slope there: Newton's steps between bounds.

    Where one would lead out, or the last one has not halved what is missing, the bounds are halved.
    """

    def to_come(way: Array) -> Array:
        return sign * (wanted - model.step(state, None, state.u + sign * way)[1])

    def look(way: Array) -> tuple[Array, Array]:
        gap, slope = jax.jvp(to_come, (way,), (jnp.ones_like(way),))
        return gap, jnp.maximum(-slope, least)

    def going_on(at: tuple[Array, ...]) -> Array:
        count, gap = at[0], at[4]
        return (jnp.abs(gap) > margin) & (count < MOST_STEPS)

    def step(at: tuple[Array, ...]) -> tuple[Array, ...]:
        count, way, low, high, gap, slope, before = at
        low, high = jnp.where(gap > 0, way, low), jnp.where(gap < 0, way, high)
        there = way + gap / slope
        halve = (there <= low) | (there >= high) | (2 * jnp.abs(gap) > before)
        way = jnp.where(halve, low + (high - low) / 2, there)
        return count + 1, way, low, high, *look(way), jnp.abs(gap)

    least = jnp.maximum(model.least_slope(), LEAST_SLOPE * model.inner.k)
    none = jnp.zeros_like(wanted)
    rise = to_come(none)
    way = rise / model.inner.k
    start = jnp.asarray(0), way, none, rise / least, *look(way), jnp.full_like(rise, jnp.inf)
    found = jax.lax.while_loop(going_on, step, start)
    return found[1], found[5]


@inverse_of.register
def _(model: DegradingBoucWen) -> DegradingBoucWenCompensator:
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
    return DegradingBoucWenCompensator(model)
