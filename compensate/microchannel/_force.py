"""The force of one contact from one hysteretic reading."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from hysteresis import AbstractModel, InputError, is_concrete

from .._compensator import AbstractCompensator, Status, scan_steps
from .._ensemble import UncertainEstimate


class ForceState(NamedTuple):
    """The model's own state, and the last force."""

    model: Any
    value: Float[Array, ""]


class ForceEstimator(AbstractCompensator[ForceState]):
    """Force from a model that runs from reading to force, learnt in that direction:

        F = clip(M[z], 0, high),     deviation: how far off it was on readings it did not learn from

    The model is the paper's network (`StaircaseNetwork`), a monotone Everett network (`EverettNetwork`), or
    any other. A model that was fitted from force to reading, as the sensor works, is run backwards
    by `invert`, or, with what is known of the reading's noise, by `MultiContactEstimator` of one contact.

    **Arguments:**

    - `model`: reading -> force in N. `deviation`: N. `high`: the largest force it was taught, N.
    - `low_reading`, `high_reading`: the readings it was taught; others are EXTRAPOLATED.

    Raises `InputError` for a deviation or range that is not positive.

    Source: Kim and Park (2018), section III A.
    """

    model: AbstractModel
    deviation: Float[Array, ""] = eqx.field(converter=lambda x: jnp.asarray(x, float))
    high: float = eqx.field(static=True, converter=float)
    low_reading: float = eqx.field(default=-jnp.inf, static=True, converter=float)
    high_reading: float = eqx.field(default=jnp.inf, static=True, converter=float)

    def __check_init__(self) -> None:
        deviation = float(self.deviation) if is_concrete(self.deviation) else 1.0
        if not (0 < deviation < jnp.inf and self.high > 0 and self.low_reading < self.high_reading):
            raise InputError(
                "estimator-range",
                f"deviation {deviation:g} N, forces to {self.high:g} N, readings from "
                f"{self.low_reading:g} to {self.high_reading:g}: none of them may be empty.",
            )

    def init(self) -> ForceState:
        return ForceState(self.model.init(), jnp.zeros_like(self.deviation))

    def step(self, state: ForceState, t: Any, y: Any) -> tuple[ForceState, UncertainEstimate]:
        y = jnp.asarray(y, self.deviation.dtype)
        t = jnp.asarray(0.0 if t is None else t, y.dtype)
        valid = jnp.isfinite(y) & jnp.isfinite(t)
        model, found = self.model.step(state.model, t, y)
        value = jnp.clip(found, 0.0, self.high)
        after = ForceState(model, value)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        beyond = (y < self.low_reading) | (y > self.high_reading)
        status = jnp.where(found > self.high, Status.SATURATED, Status.OK)
        status = jnp.where(beyond, Status.EXTRAPOLATED, status)
        status = jnp.where(valid, status, Status.INVALID)
        return after, UncertainEstimate(after.value, status, self.deviation)

    def simulate(self, t: Any, y: Any, state: ForceState | None = None) -> UncertainEstimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, t, y, self.init() if state is None else state)[1]
