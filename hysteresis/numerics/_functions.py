"""Clamped memories z_k = clip(z_(k-1), low_k, high_k)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._registry import register


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


# Hat functions: the weights of linear interpolation.


def hats(x: Float[Array, "*x"], nodes: Float[Array, " nodes"]) -> Float[Array, "*x nodes"]:
    """h_k(x): 1 at node k, 0 at the others, straight between, constant beyond the ends; their sum is 1."""
    first, width = (
        jnp.broadcast_to(each, (*x.shape, len(each))) for each in (nodes[:-1], jnp.diff(nodes))
    )
    rise = jnp.clip((x[..., None] - first) / width, 0.0, 1.0)
    # Up to node k its rise is that to it, after it the next one takes away.
    one = jnp.ones((*x.shape, 1), rise.dtype)
    return jnp.concatenate([one, rise], -1) - jnp.concatenate([rise, 0 * one], -1)


def hats_of(
    x: Float[np.ndarray, " samples"], nodes: np.ndarray
) -> Float[np.ndarray, "samples nodes"]:
    """h_k of many numbers, in NumPy."""
    return np.column_stack([np.interp(x, nodes, each) for each in np.eye(len(nodes))])


# Quantiles of the normal distribution.

NORMAL_95 = 1.6448536269514722
"""The 95 % quantile: 90 % of a normal distribution lie within this many standard deviations of its mean."""


# The squared-exponential covariance of a smooth function.


@register
class Kernel(NamedTuple):
    """Squared-exponential covariance of a function's values, plus noise^2 on each value:

    k(x, x') = size^2 exp(-sum_j (x_j - x'_j)^2 / (2 length_j^2))
    """

    size: Float[Array, ""]
    length: Float[Array, " features"]
    noise: Float[Array, ""]

    def between(
        self, x: Float[Array, "n features"], other: Float[Array, "m features"]
    ) -> Float[Array, "n m"]:
        """The covariances between two sets of points, without the noise."""
        a, b = x / self.length[None], other / self.length[None]
        square = (a**2).sum(1)[:, None] + (b**2).sum(1)[None] - 2 * a @ b.T
        return self.size**2 * jnp.exp(-jnp.maximum(square, 0) / 2)

    def among(self, x: Float[Array, "n features"]) -> Float[Array, "n n"]:
        """The covariances of values at these points, with their noise and with what rounding makes of all
        rows: values without noise would leave a matrix that has no factor."""
        rounding = len(x) ** 2 * jnp.finfo(x.dtype).eps * self.size**2
        return self.between(x, x) + (self.noise**2 + rounding) * jnp.eye(len(x))
