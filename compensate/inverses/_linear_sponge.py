"""Inverse of the linear sponge."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import InputError, LinearSponge, is_concrete, register

from .._contract import AbstractCompensator, Estimate, Status, last_valid
from ._inverse_of import inverse_of


@register
class LinearSpongeCompensator(AbstractCompensator[Array, Estimate]):
    """F = (d - b) / K where the sponge is touched; below its threshold F is not known, and 0.

    The state is the last estimate, for samples that are not finite.
    """

    model: LinearSponge

    def init(self) -> Array:
        return jnp.zeros_like(self.model.K)

    def step(self, state: Array, t: ArrayLike | None, y: ArrayLike) -> tuple[Array, Estimate]:
        y = jnp.asarray(y, state.dtype)
        estimate = self._line(y, state)
        return estimate.value, estimate

    def simulate(self, t: ArrayLike | None, y: ArrayLike, state: Array | None = None) -> Estimate:
        return self._lines(jnp.asarray(y, float), self.init() if state is None else state)

    @eqx.filter_jit
    def _lines(self, y: Array, state: Array) -> Estimate:
        estimate, (_, latest) = self._line(y, state), last_valid(y)
        return estimate._replace(value=jnp.where(latest < 0, state, estimate.value[latest]))

    @eqx.filter_jit
    def _line(self, y: Array, held: Array) -> Estimate:
        K, b, threshold = self.model.K, self.model.b, self.model.threshold
        touched = (y - b) / K
        # A reading at the threshold itself must not fall below it by rounding.
        contact = touched >= threshold - 1e-12 * jnp.abs(threshold)
        none = jnp.minimum(0.0, threshold - 1.0)
        value = jnp.where(
            contact, jnp.maximum(touched, threshold), jnp.where(threshold > 0, 0.0, none)
        )
        status = jnp.where(contact, Status.OK, Status.BELOW_THRESHOLD)
        valid = jnp.isfinite(y)
        return Estimate(jnp.where(valid, value, held), jnp.where(valid, status, Status.INVALID))


@inverse_of.register
def _(model: LinearSponge) -> LinearSpongeCompensator:
    if is_concrete(model.K) and not np.all(np.asarray(model.K) != 0):
        raise InputError(
            "not-invertible",
            "the line's slope K is 0, so the output says nothing about the input.",
            fix="fit a record whose output changes with its input.",
        )
    return LinearSpongeCompensator(model)
