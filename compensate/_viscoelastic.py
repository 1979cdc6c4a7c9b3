"""Inverse of the Burgers model: the same element driven from its other side."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import Burgers, BurgersState, InputError, is_concrete

from ._compensator import AbstractCompensator, Estimate, Status, inverse_of, last_valid


class BurgersCompensator(AbstractCompensator[BurgersState]):
    """Each step solves d = F / E1 + x1 + x2 for the side that was not measured: one division.

    `element` is the model with `leading` turned over and no offset.
    """

    element: Burgers
    offset: jax.Array

    def init(self) -> BurgersState:
        return self.element.init()

    def step(self, state: BurgersState, t: Any, y: Any) -> tuple[BurgersState, Estimate]:
        valid = jnp.isfinite(y)
        after, value = self.element.step(state, t, y - self.offset)
        held = self._now(state)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        status = jnp.where(valid, Status.OK, Status.INVALID)
        return after, Estimate(jnp.where(valid, value, held), status)

    def simulate(self, t: Any, y: Any, state: BurgersState | None = None) -> Estimate:
        y = jnp.asarray(y, float)
        state = self.init() if state is None else state
        valid, latest = last_valid(y)
        if t is not None:
            # A sample that is not finite repeats the one before it, time included: no step at all.
            held = jnp.where(latest < 0, jnp.argmax(valid), latest)
            t, y = jnp.asarray(t, y.dtype)[held], y[held]
            if self.element.leading and self.element.hold == "constant" and is_concrete(t):
                self._check_steps(np.asarray(t))
        value = self.element.simulate(t, y - self.offset, state)
        value = jnp.where(latest < 0, self._now(state), value[latest])
        return Estimate(value, jnp.where(valid, Status.OK, Status.INVALID))

    def _now(self, state: BurgersState) -> jax.Array:
        """The element's output in a state."""
        return state.force if self.element.leading else self.element.displacement(state)

    def _check_steps(self, t: np.ndarray) -> None:
        limit, largest = self.element.largest_stable_step(), float(np.diff(t).max(initial=0.0))
        if largest > limit:
            raise InputError(
                "unstable-step",
                f"the inverse grows without bound at time steps of {largest:g}.",
                cause='with hold="constant" a step must stay short beside the element\'s own times.',
                fix=f'sample at steps below {limit:.4g}, or use hold="linear".',
            )


@inverse_of.register
def _(model: Burgers) -> BurgersCompensator:
    turned = Burgers(
        model.E1, model.eta1, model.E2, model.eta2, leading=not model.leading, hold=model.hold
    )
    return BurgersCompensator(turned, jnp.asarray(model.offset))
