"""An oscillator where `Program` expects a compensator."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from hysteresis import Oscillator

from .._contract import Estimate, Status

LONGEST = 10.0
"""Samples that one step may last: with longer steps Newmark's method no longer follows the motion."""


class Motion(NamedTuple):
    """An oscillator where a compensator is expected: readings are forces, estimates displacements."""

    model: Oscillator

    def simulate(self, t: Any, force: Any) -> Estimate:
        """The displacements from rest; at rest, where no force is known."""
        u = np.asarray(force, float)
        if not np.isfinite(u).all():
            return Estimate(jnp.zeros(len(u)), jnp.full(len(u), int(Status.INVALID)))
        found = self.model.displacement(np.asarray(t, float) - float(t[0]), u)
        return Estimate(jnp.asarray(found), jnp.full(len(u), int(Status.OK)))
