"""Inverse of the Bouc-Wen model."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import BoucWen, BoucWenState, register
from hysteresis.trees import ROUNDING

from .._contract import AbstractCompensator, Estimate, Status, scan_steps
from ._inverse_of import inverse_of

NEWTON_STEPS = 16
LONGEST = 100.0
"""A way, in parts of yield_at, after which nothing is left to yield."""


@register
class BoucWenCompensator(AbstractCompensator[BoucWenState, Estimate]):
    """x from y: the way from the last x by Newton's method.

    An output that rises means an input that rises, and on that way the slope of y falls: a concave
    function, whose root Newton's method reaches from 0 without overshooting. The state is the model's
    own. Without a stiffness after yield (alpha = 0) y has limits; beyond them, SATURATED, the last
    estimate is held.
    """

    model: BoucWen

    def init(self) -> BoucWenState:
        return self.model.init()

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: BoucWenState | None = None
    ) -> Estimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, None, y, self.init() if state is None else state)[1]

    def step(
        self, state: BoucWenState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[BoucWenState, Estimate]:
        y = jnp.asarray(y, state.u.dtype)
        model, (u, w) = self.model, state
        rise = y - model.output(u, w)
        sign = jnp.where(rise < 0, -1.0, 1.0)
        # In parts of k yield_at.
        wanted = jnp.abs(rise) / (model.k * model.yield_at)
        yielding = 1 - model.alpha

        def newton(_: Any, way: Array) -> Array:
            there = model.after(sign * w, way)
            gap = wanted - model.alpha * way - yielding * (there - sign * w)
            slope = model.alpha + yielding * model.slope(there)
            return jnp.clip(way + gap / jnp.maximum(slope, 1e-300), 0.0, longest)

        # All that z can give is given after LONGEST; alpha alone brings the rest.
        longest = LONGEST + wanted / jnp.maximum(model.alpha, 1e-300)
        longest = jnp.where(model.alpha > 0, longest, LONGEST)
        way = jax.lax.fori_loop(0, NEWTON_STEPS, newton, jnp.zeros_like(wanted))
        found, output = model.step(state, t, u + sign * way * model.yield_at)

        size = jnp.abs(y) + jnp.abs(model.offset) + model.k * model.yield_at
        short = jnp.abs(y - output) > ROUNDING * jnp.finfo(y.dtype).eps * size
        beyond = short & (model.alpha == 0)
        valid = jnp.isfinite(y)
        after = jax.tree.map(lambda new, old: jnp.where(valid & ~beyond, new, old), found, state)
        status = jnp.where(beyond, Status.SATURATED, Status.OK)
        return after, Estimate(after.u, jnp.where(valid, status, Status.INVALID))


@inverse_of.register
def _(model: BoucWen) -> BoucWenCompensator:
    return BoucWenCompensator(model)
