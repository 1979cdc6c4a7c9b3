"""One step of a memory that relaxes while it is driven: q' = -q / tau + u'."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def decay_and_gain(x: Float[Array, "*steps"]) -> tuple[Array, Array]:
    """exp(-x), (1 - exp(-x)) / x with x = dt / tau; q becomes decay q + gain du, exact for a straight u."""
    small = x < 1e-3  # where the series is as exact (left out: x^4 / 120)
    series = 1 - x / 2 * (1 - x / 3 * (1 - x / 4))
    return jnp.exp(-x), jnp.where(small, series, -jnp.expm1(-x) / jnp.where(small, 1.0, x))
