"""Inverse of the linear sponge."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from hysteresis import InputError, LinearSponge

from ._compensator import AbstractCompensator, Estimate, Status, invert


class LinearSpongeCompensator(AbstractCompensator[tuple[()]]):
    """F = (d - b) / K where the sponge is touched; below its threshold F is not known, and 0."""

    model: LinearSponge

    def init(self) -> tuple[()]:
        return ()

    def step(self, state: tuple[()], t: Any, y: Any) -> tuple[tuple[()], Estimate]:
        return (), self.simulate(t, y)

    def simulate(self, t: Any, y: Any, state: tuple[()] | None = None) -> Estimate:
        y = jnp.asarray(y, float)
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
        return Estimate(jnp.where(valid, value, 0.0), jnp.where(valid, status, Status.INVALID))


@invert.register
def _(model: LinearSponge) -> LinearSpongeCompensator:
    if not np.all(np.asarray(model.K) != 0):
        raise InputError(
            "not-invertible",
            "the line's slope K is 0, so the output says nothing about the input.",
            fix="fit a record whose output changes with its input.",
        )
    return LinearSpongeCompensator(model)
