"""Inverse of the Burgers model: the same element driven from its other side."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import Burgers, InputError, is_concrete

from ._compensator import AbstractCompensator, Estimate, Status, invert


class BurgersCompensator(AbstractCompensator[Any]):
    """Each step solves d = F / E1 + x1 + x2 for the side that was not measured: one division.

    `element` is the model with `leading` turned over and no offset.
    """

    element: Burgers
    offset: jax.Array

    def init(self) -> Any:
        return self.element.init()

    def step(self, state: Any, t: Any, y: Any) -> tuple[Any, Estimate]:
        valid = jnp.isfinite(y)
        after, value = self.element.step(state, t, y - self.offset)
        held = state.force if self.element.leading else self.element.displacement(state)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        status = jnp.where(valid, Status.OK, Status.INVALID)
        return after, Estimate(jnp.where(valid, value, held), status)

    def simulate(self, t: Any, y: Any, state: Any = None) -> Estimate:
        y = jnp.asarray(y, float)
        if self.element.leading and self.element.hold == "constant" and is_concrete(t):
            self._check_steps(np.asarray(t))
        value = self.element.simulate(t, y - self.offset, state)
        return Estimate(value, jnp.full(y.shape, Status.OK))

    def _check_steps(self, t: np.ndarray) -> None:
        limit, largest = self.element.largest_stable_step(), float(np.diff(t).max(initial=0.0))
        if largest > limit:
            raise InputError(
                "unstable-step",
                f"the inverse grows without bound at time steps of {largest:g}.",
                cause='with hold="constant" a step must stay short beside the element\'s own times.',
                fix=f'sample at steps below {limit:.4g}, or use hold="linear".',
            )


@invert.register
def _(model: Burgers) -> BurgersCompensator:
    turned = Burgers(
        model.E1, model.eta1, model.E2, model.eta2, leading=not model.leading, hold=model.hold
    )
    return BurgersCompensator(turned, model.offset)
