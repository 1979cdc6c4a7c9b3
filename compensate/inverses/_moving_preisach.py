"""Inverse of the moving Preisach model: that of its inner model, less what the output adds."""

import jax.numpy as jnp
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import MovingPreisach, register
from hysteresis.preisach import saturated_outputs

from .._contract import AbstractCompensator, Estimate, State, Status, scan_steps
from ._inverse_of import inverse_of


@register
class MovingCompensator(AbstractCompensator[tuple[State, Array], Estimate]):
    """u = P^-1[y] - feedback y, explicitly: y is known, so nothing has to be solved for.

    Statuses are those of P^-1. The state is that of P^-1 and the last estimate.
    """

    model: MovingPreisach
    inner: AbstractCompensator[State, Estimate]

    def init(self) -> tuple[State, Array]:
        return self.inner.init(), self.model.init().u

    def step(
        self, state: tuple[State, Array], t: ArrayLike | None, y: ArrayLike
    ) -> tuple[tuple[State, Array], Estimate]:
        inner, held = state
        y = jnp.asarray(y, held.dtype)
        inner, (h, status) = self.inner.step(inner, t, y)
        # What is out of reach does not come back to the input either.
        reached = jnp.clip(y, *saturated_outputs(self.model.inner))
        reached = jnp.where(status == Status.SATURATED, reached, y)
        value = jnp.where(jnp.isfinite(y), h - self.model.feedback * reached, held)
        return (inner, value), Estimate(value, status)

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: tuple[State, Array] | None = None
    ) -> Estimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, None, y, self.init() if state is None else state)[1]


@inverse_of.register
def _(model: MovingPreisach) -> MovingCompensator:
    return MovingCompensator(model, inverse_of(model.inner))
