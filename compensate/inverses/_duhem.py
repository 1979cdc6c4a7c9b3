"""Inverse of Duhem's operator."""

import jax
import jax.numpy as jnp
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import DuhemOperator, DuhemState, register

from .._contract import AbstractCompensator, Estimate, Status, scan_steps
from ._inverse_of import inverse_of


@register
class DuhemCompensator(AbstractCompensator[DuhemState, Estimate]):
    """u from y in closed form: the way of the input is the integral of dy over the slope.

    Slopes are positive, so the output says in which direction the input went. The state is the model's own.
    """

    model: DuhemOperator

    def init(self) -> DuhemState:
        return self.model.init()

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: DuhemState | None = None
    ) -> Estimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, None, y, self.init() if state is None else state)[1]

    def step(
        self, state: DuhemState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[DuhemState, Estimate]:
        reading: Array = jnp.asarray(y, state.u.dtype)
        valid = jnp.isfinite(reading)
        found = DuhemState(state.u + self.model.way_to(state.y, reading), reading)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), found, state)
        return after, Estimate(after.u, jnp.where(valid, Status.OK, Status.INVALID))


@inverse_of.register
def _(model: DuhemOperator) -> DuhemCompensator:
    return DuhemCompensator(model)
