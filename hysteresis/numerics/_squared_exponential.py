"""The squared-exponential covariance of a smooth function."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._registry import register


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
