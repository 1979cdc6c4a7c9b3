"""Inverse of a viscoelastic model: the same element driven from its other side."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import (
    AbstractModel,
    AbstractViscoelastic,
    InputError,
    ViscoelasticState,
    is_concrete,
    register,
)

from .._contract import AbstractCompensator, Estimate, Status, last_valid
from ._inverse_of import inverse_of


@register
class ViscoelasticCompensator(AbstractCompensator[ViscoelasticState, Estimate]):
    """Exact inverse of a viscoelastic model: the element driven from its other side.

    Each step solves y = direct u + sum of x for the side that was not measured: one division.

    `element` is the model with `leading` turned over and no offset.
    """

    element: AbstractViscoelastic
    offset: jax.Array

    def init(self) -> ViscoelasticState:
        return self.element.init()

    def step(
        self, state: ViscoelasticState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[ViscoelasticState, Estimate]:
        y = jnp.asarray(y, float)
        valid = jnp.isfinite(y)
        after, value = self.element.step(state, t, y - self.offset)
        held = self.element.output(state)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        status = jnp.where(valid, Status.OK, Status.INVALID)
        return after, Estimate(jnp.where(valid, value, held), status)

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: ViscoelasticState | None = None
    ) -> Estimate:
        readings: Array = jnp.asarray(y, float)
        state = self.init() if state is None else state
        valid, latest = last_valid(readings)
        if t is not None:
            t, readings = _repeated(jnp.asarray(t, readings.dtype), readings)
            if self.element.against_chain and is_concrete(t):
                self._check_steps(np.asarray(t))
        value = self.element.simulate(t, readings - self.offset, state)
        return _held(value, self.element.output(state), valid, latest)

    def _check_steps(self, t: np.ndarray) -> None:
        limit, largest = self.element.largest_stable_step(), float(np.diff(t).max(initial=0.0))
        if largest > limit:
            raise InputError(
                "unstable-step",
                f"the inverse grows without bound at time steps of {largest:g}.",
                cause='with hold="constant" a step must stay short beside the element\'s own times.',
                fix=f'sample at steps below {limit:.4g}, or use hold="linear".',
            )


def stable_step(model: AbstractModel) -> float:
    """The largest step at which estimates do not grow without bound; infinite of other models."""
    found = inverse_of(model) if isinstance(model, AbstractViscoelastic) else None
    if isinstance(found, ViscoelasticCompensator) and found.element.against_chain:
        return found.element.largest_stable_step()
    return float("inf")


@jax.jit
def _repeated(
    t: Float[Array, " samples"], y: Float[Array, " samples"]
) -> tuple[Float[Array, " samples"], Float[Array, " samples"]]:
    """A sample that is not finite repeats the one before it, time included: no step at all."""
    valid, latest = last_valid(y)
    held = jnp.where(latest < 0, jnp.argmax(valid), latest)
    return t[held], y[held]


@jax.jit
def _held(value: Array, first: Array, valid: Array, latest: Array) -> Estimate:
    """Values at the latest finite samples, `first` before them."""
    value = jnp.where(latest < 0, first, value[latest])
    return Estimate(value, jnp.where(valid, Status.OK, Status.INVALID))


@inverse_of.register
def _(model: AbstractViscoelastic) -> ViscoelasticCompensator:
    turned = replace(model, leading=not model.leading, offset=jnp.zeros_like(model.offset))
    return ViscoelasticCompensator(turned, jnp.asarray(model.offset))
