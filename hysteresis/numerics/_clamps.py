"""Clamped memories z_k = clip(z_(k-1), low_k, high_k)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


@jax.jit
def clamps(
    low: Float[Array, "samples operators"],
    high: Float[Array, "samples operators"],
    begin: Float[Array, " operators"],
    start: Bool[Array, " samples"],
) -> Float[Array, "samples operators"]:
    """z_k = clip(z_(k-1), low_k, high_k) with low <= high; where `start`, z_(k-1) is `begin`.

    The first sample has to be a start. At a tie of z with a limit the derivative is that of z.
    """
    first = jnp.clip(begin[None], low, high)

    def move(z: Array, row: tuple[Array, ...]) -> tuple[Array, Array]:
        low, high, first, start = row
        # Twice as fast to differentiate as a clip, which shares derivatives out at a tie.
        held = jnp.where(z < low, low, jnp.where(z > high, high, z))
        z = jnp.where(start, first, held)
        return z, z

    return jax.lax.scan(move, first[0], (low, high, first, start))[1]
