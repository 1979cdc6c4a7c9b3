"""The linear sponge: a line above a contact threshold."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._model import Tree
from .._parameter import Scalar, parameter
from .._registry import register
from ..trees import node
from ._curves import AbstractCurve


@register
class LinearSponge(AbstractCurve):
    """Displacement of a soft cover under a normal force, as a line:

        d = K F + b   where F >= threshold,   else d = 0

    **Arguments:** `K` (mm/N), `b` (mm), `threshold` (N; the force of first contact). Any
    other pair of quantities works the same way, in the units of its record.

    Source: Tsuji 2014, equation (8); its threshold is 1.5 N.

    **Example:**

        >>> sponge = hysteresis.LinearSponge(K=1.5, b=6.0, threshold=1.5)
        >>> sponge.simulate(None, np.array([0.0, 2.0, 4.0])).tolist()
        [0.0, 9.0, 12.0]
    """

    K: Scalar = parameter(unit="output / input", meaning="compliance")
    b: Scalar = parameter(0.0, unit="output", meaning="displacement at no force")
    threshold: Scalar = parameter(
        -float("inf"), unit="input", fixed=True, meaning="input of first contact"
    )

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        return jnp.where(u >= self.threshold, self.K * u + self.b, 0.0)

    def laws(self, eps: float, depth: int) -> Tree:
        threshold = jnp.maximum(self.threshold, -1e30)
        least = threshold - max(1e-12, 8 * eps) * jnp.abs(threshold)
        return node("line", {"K": self.K, "b": self.b, "threshold": threshold, "least": least})
