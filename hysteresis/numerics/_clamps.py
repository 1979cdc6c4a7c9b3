"""Clamped memories z_k = clip(z_(k-1), low_k, high_k), as parallel in time as is worthwhile."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Clamp(NamedTuple):
    """The map z -> clip(z, low, high); where `fixed`, low == high and z does not matter.

    At a tie of z with a limit the derivative is that of z: hence the flag, which cuts off the past.
    """

    low: Array
    high: Array
    fixed: Array

    def __call__(self, z: Array) -> Array:
        # Twice as fast to differentiate as a clip, which shares derivatives out at a tie.
        below = self.fixed | (z < self.low)
        return jnp.where(below, self.low, jnp.where(z > self.high, self.high, z))

    def after(self, first: "Clamp") -> "Clamp":
        """Both maps in one: a clamp of a clamp is a clamp."""
        return Clamp(self(first.low), self(first.high), first.fixed | self.fixed)


@jax.jit
def clamps(
    low: Float[Array, "samples operators"],
    high: Float[Array, "samples operators"],
    begin: Float[Array, " operators"],
    start: Bool[Array, " samples"],
) -> Float[Array, "samples operators"]:
    """z_k = clip(z_(k-1), low_k, high_k) with low <= high; where `start`, z_(k-1) is `begin`.

    The first sample has to be a start. On a CPU a plain scan is the fastest way; an accelerator
    needs the associative form, whose depth is log(samples).
    """
    start = start[:, None]
    first = jnp.clip(begin[None], low, high)
    each = Clamp(jnp.where(start, first, low), jnp.where(start, first, high), start)
    return jax.lax.platform_dependent(each, cpu=by_scan, default=by_association)


def by_scan(each: Clamp) -> Array:
    """One clamp after the other."""

    def move(z: Array, clamp: Clamp) -> tuple[Array, Array]:
        z = clamp(z)
        return z, z

    return jax.lax.scan(move, each.low[0], each)[1]


def by_association(each: Clamp) -> Array:
    """Clamps joined in pairs, and pairs of pairs: the first is fixed, so all that start with it are."""
    return jax.lax.associative_scan(lambda first, then: then.after(first), each)[0]
