"""Inverse of the output-dependent Preisach model: its curve undone, then its relays."""

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hysteresis import InputError, OutputDependentPreisach, is_concrete, register

from .._contract import AbstractCompensator, Estimate, State
from ._inverse_of import inverse_of


@register
class OutputDependentCompensator(AbstractCompensator[State, Estimate]):
    """u = P^-1[g^-1(y)]; the state and the statuses are those of P^-1."""

    model: OutputDependentPreisach
    inner: AbstractCompensator[State, Estimate]

    def init(self) -> State:
        return self.inner.init()

    def step(self, state: State, t: ArrayLike | None, y: ArrayLike) -> tuple[State, Estimate]:
        return self.inner.step(state, t, self.model.unscale(jnp.asarray(y, float)))

    def simulate(self, t: ArrayLike | None, y: ArrayLike, state: State | None = None) -> Estimate:
        return self.inner.simulate(t, self.model.unscale(jnp.asarray(y, float)), state)


@inverse_of.register
def _(model: OutputDependentPreisach) -> OutputDependentCompensator:
    if is_concrete(model.increments) and not np.all(np.asarray(model.increments) > 0):
        raise InputError(
            "not-invertible",
            "the output stands still over part of the relays' range.",
            cause="an increment is 0.",
            fix="join that cell with its neighbour: fewer increments, all positive.",
        )
    return OutputDependentCompensator(model, inverse_of(model.inner))
