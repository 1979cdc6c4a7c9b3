"""The Duhem model: dy = alpha |du| (beta u - y) + gamma du."""

import hysid_duhem_law
import jax.numpy as jnp
import numpy as np

from hysteresis import parameter, register
from hysteresis.trees import AbstractSearchedModel, node


def guess(record):
    """Start values: the slope of the record, and a memory of a tenth of its input's span."""
    slope = np.polyfit(record.input[record.mask], record.output[record.mask], 1)[0]
    return Duhem(10 / np.ptp(record.input[record.mask]), slope, 0.7 * slope)


@register(guess=guess, law=hysid_duhem_law)
class Duhem(AbstractSearchedModel):
    """Between two samples y follows a straight line and an exponential, exactly."""

    alpha: float = parameter(unit="1 / input", bounds=(0, jnp.inf), meaning="forgetting per input")
    beta: float = parameter(unit="output / input", bounds=(0, jnp.inf), meaning="slope far away")
    gamma: float = parameter(unit="output / input", bounds=(0, jnp.inf), meaning="slope at first")

    def forwards(self):
        numbers = {"alpha": self.alpha, "beta": self.beta, "gamma": self.gamma}
        return node("hysid_duhem_law", numbers, {"u": 0.0, "y": 0.0})
