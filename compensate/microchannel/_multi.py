"""The forces of several contacts at once, from channels in which their readings add."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError, register

from .._contract import Status, scan_steps
from ._motion import AbstractSensor, Motion, MotionFilter

UNLIKE = 25.0
"""Squared surprise of a channel from which on a reading is none that these contacts make."""


class ContactForces(NamedTuple):
    """Forces (..., contacts) in N, their standard deviations, and a `Status` for each reading.

    `late`, `late_deviation`: of the forces `delay` readings ago, which by now are known better.
    EXTRAPOLATED says that no forces explain the reading, SATURATED that one is at the end of its range.
    """

    value: Float[Array, "*samples contacts"]
    deviation: Float[Array, "*samples contacts"]
    late: Float[Array, "*samples contacts"]
    late_deviation: Float[Array, "*samples contacts"]
    status: Int[Array, "*samples"]


class MultiContactState(NamedTuple):
    """What may have happened, and the last forces."""

    motion: Motion
    last: ContactForces


@register
class MultiContactEstimator(eqx.Module):
    """Forces of several contacts from a differentiable sensor model with memory, by Gauss-Newton:

        maximise  -sum_l (z_l - h_l(F))^2 / (2 sigma_l^2) + log p(F | before)      at every reading

    for each hypothesis about recent turns of the forces, see `MotionFilter`. With one contact and one
    channel it estimates the force from one reading; it is the best choice where noise matters.

    **Arguments:**

    - `sensor`: forces -> readings, such as `ChannelSensor` of models fitted to presses of one location.
    - `reading_sigma`: standard deviation of each channel's reading, its noise and the models' error.
    - `motion`: how forces move.

    **Raises:** `InputError` for deviations that are not positive.

    **Source:** the inverse for which Kim and Park (2018), section III D, use a grid search.

    **Example:**

        >>> motion = compensate.microchannel.MotionFilter(high=6.0, ways=3)
        >>> both = compensate.microchannel.MultiContactEstimator(channels, [0.01, 0.01], motion)
        >>> y = np.asarray(model.simulate(t, u))  # the first contact alone is pressed
        >>> both.simulate(0.1 * t, np.column_stack([y, 0.5 * y])).value[4].round(1).tolist()
        [4.0, 0.0]
    """

    sensor: AbstractSensor
    reading_sigma: Float[Array, " channels"]
    motion: MotionFilter

    def __init__(self, sensor: AbstractSensor, reading_sigma: ArrayLike, motion: MotionFilter):
        sigma = np.atleast_1d(np.asarray(reading_sigma, float))
        if sigma.ndim != 1 or not (np.isfinite(sigma) & (sigma > 0)).all():
            raise InputError(
                "bad-deviation", "reading_sigma is no standard deviation for each channel."
            )
        self.sensor, self.reading_sigma, self.motion = sensor, jnp.asarray(sigma), motion

    def init(self) -> MultiContactState:
        """At rest, no location pressed."""
        none = jnp.zeros(self.sensor.contacts)
        last = ContactForces(none, none, none, none, jnp.asarray(Status.OK, int))
        return MultiContactState(self.motion.init(self.sensor), last)

    def step(
        self, state: MultiContactState, t: ArrayLike | None, reading: ArrayLike
    ) -> tuple[MultiContactState, ContactForces]:
        """One reading (channels,) in V at time t in s. One with a NaN is INVALID: all is held."""
        z = jnp.asarray(reading, self.reading_sigma.dtype)
        t = jnp.asarray(t, z.dtype)
        valid = jnp.isfinite(z).all() & jnp.isfinite(t)
        motion, moved = self.motion.update(self.sensor, state.motion, t, z, self.reading_sigma**2)
        held = (moved.force >= self.motion.high).any()
        status = jnp.where(held, Status.SATURATED, Status.OK)
        status = jnp.where(moved.surprise > UNLIKE, Status.EXTRAPOLATED, status)
        found = ContactForces(
            moved.force, moved.deviation, moved.late, moved.late_deviation, status
        )
        after = MultiContactState(motion, found)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        status = jnp.where(valid, status, Status.INVALID)
        return after, after.last._replace(status=status)

    def simulate(
        self, t: ArrayLike | None, readings: ArrayLike, state: MultiContactState | None = None
    ) -> ContactForces:
        """`step` over readings (samples, channels)."""
        z = jnp.asarray(readings, float)
        if z.ndim != 2 or z.shape[1] != self.reading_sigma.shape[0]:
            raise InputError(
                "wrong-channels",
                f"readings of shape {z.shape} for {self.reading_sigma.shape[0]} channels.",
                fix="give (samples, channels).",
            )
        return scan_steps(self, t, z, self.init() if state is None else state)[1]
