"""The Duhem model: dy = alpha |du| (beta u - y) + gamma du."""

import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractSteppedModel, parameter, register


def guess(record):
    """Start values: the slope of the record, and a memory of a tenth of its input's span."""
    slope = np.polyfit(record.input[record.mask], record.output[record.mask], 1)[0]
    return Duhem(10 / np.ptp(record.input[record.mask]), slope, 0.7 * slope)


@register(guess=guess)
class Duhem(AbstractSteppedModel):
    """Between two samples y follows a straight line and an exponential, exactly."""

    alpha: float = parameter(unit="1 / input", bounds=(0, jnp.inf), meaning="forgetting per input")
    beta: float = parameter(unit="output / input", bounds=(0, jnp.inf), meaning="slope far away")
    gamma: float = parameter(unit="output / input", bounds=(0, jnp.inf), meaning="slope at first")

    def init(self, t0=None, u0=None):
        return jnp.zeros_like(self.alpha), jnp.zeros_like(self.alpha)  # input and output

    def step(self, state, t, u):
        before, y = state
        gap = jnp.sign(u - before) * (self.gamma - self.beta) / self.alpha
        far = jnp.exp(-self.alpha * jnp.abs(u - before))
        y = self.beta * u + gap + (y - self.beta * before - gap) * far
        return (u, y), y
