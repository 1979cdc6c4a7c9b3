"""Sensor, shell and cover together: from readings to contacts."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._contact import Contact
from ._solver import ContactSolver
from ._wrench import WristSensor


class Armor(eqx.Module):
    """A force sensor and the shell that it carries: what a calibration calibrates as a whole.

    Its numbers have dotted names, "sensor.matrix", "solver.cover.factor.value".
    """

    sensor: WristSensor
    solver: ContactSolver

    def solve(self, readings: Any) -> Contact:
        """The contacts behind readings (..., 6), each by itself: no history of sensor or cover."""
        return self.solver.solve(*self.sensor.read(readings))

    def simulate(self, t: Any, readings: Any) -> Contact:
        """The contacts of a stream of readings (samples, 6), with the sensor's and the cover's history."""
        readings = jnp.asarray(readings, float)
        return _stream(self, jnp.asarray(t, readings.dtype), readings)


@eqx.filter_jit
def _stream(
    armor: Armor, t: Float[Array, " samples"], readings: Float[Array, "samples 6"]
) -> Contact:
    def step(state: tuple[Any, Any], now: tuple[Array, Array]) -> tuple[tuple[Any, Any], Contact]:
        wrist, touch = state
        wrist, wrench = armor.sensor.step(wrist, *now)
        touch, contact = armor.solver.step(touch, now[0], *wrench)
        return (wrist, touch), contact

    return jax.lax.scan(step, (armor.sensor.init(), armor.solver.init()), (t, readings))[1]
