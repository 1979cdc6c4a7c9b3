"""A whole armor (sensor, shell and cover): from sensor readings to contacts."""

import equinox as eqx
from numpy.typing import ArrayLike

from ._contact import Contact
from ._solver import ContactSolver
from ._wrench import AT_REST, Motion, WristSensor


class Armor(eqx.Module):
    """A force sensor and the shell that it carries: what a calibration calibrates as a whole.

    Its numbers have dotted names, "sensor.matrix", "solver.cover.factor.value".

    **Example:**

        >>> contact = armor.solve([10.0, 0.0, 0.0, 0.0, 2.0, 0.0])
        >>> contact.status.shape
        ()
    """

    sensor: WristSensor
    solver: ContactSolver

    def solve(self, readings: ArrayLike, motion: Motion = AT_REST) -> Contact:
        """The contacts behind readings (..., 6), each by itself: no history of sensor or cover.

        `motion`: of the shell, whose weight and inertia the sensor feels.
        """
        return self.solver.solve(*self.sensor.read(readings, motion))

    def simulate(
        self, t: ArrayLike | None, readings: ArrayLike, motion: Motion = AT_REST
    ) -> Contact:
        """The contacts of a stream of readings (samples, 6), with the sensor's and the cover's history."""
        return self.solver.simulate(t, *self.sensor.simulate(t, readings, motion))
