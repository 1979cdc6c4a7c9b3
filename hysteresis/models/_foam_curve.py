"""Force over compression of a foam: toe, linear part, plateau, densification."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._model import Tree
from .._parameter import POSITIVE, Scalar, parameter
from .._registry import register
from ..trees import node
from ._curves import AbstractCurve


@register
class FoamCurve(AbstractCurve):
    """Force of a foam over its compression (or stress over strain). Its slope passes from the toe's
    stiffness to the linear part's and the plateau's, and grows from densification on:

        dy/du = linear (toe (1 - S(u - u1)) + S(u - u1) - S(u - u2) + plateau S(u - u2)
                        + densification r(u - u3)),          y(0) = offset

    where r(x) = (x + sqrt(x^2 + rounding^2)) / 2 is a ramp with a rounded corner and S = r' a rounded
    step. No term is negative, so y rises everywhere. The integral has a closed form.

    **Arguments:**

    - `linear`: stiffness of the linear part.
    - `toe`, `plateau`: stiffnesses of these parts divided by `linear`; `toe` is less than 1.
    - `toe_length`, `linear_length`, `plateau_length`: the compressions over which they hold:
      u1 = toe_length, u2 = u1 + linear_length, u3 = u2 + plateau_length.
    - `rounding`: the compression over which one part passes into the next.
    - `densification`: growth of the stiffness beyond u3 per unit of compression, divided by `linear`.
    - `offset`: force without compression.

    Raises `InputError` where an argument other than the offset is not positive, or `toe` is 1 or more.

    Source: Gibson and Ashby, Cellular Solids (1997), for the stages; the rounded passages are ours.

    **Example:**

        >>> foam = hysteresis.FoamCurve(
        ...     linear=2.0, toe=0.5, plateau=0.1, toe_length=1.0, linear_length=4.0,
        ...     plateau_length=10.0, rounding=0.5, densification=0.5)
        >>> np.asarray(foam.simulate(None, np.array([0.0, 1.0, 5.0, 15.0, 20.0]))).round(1).tolist()
        [0.0, 1.2, 8.6, 11.2, 25.0]
    """

    linear: Scalar = parameter(
        unit="output / input", **POSITIVE, meaning="stiffness of bending cell walls"
    )
    toe: Scalar = parameter(bounds=(0.0, 1.0), meaning="stiffness at first contact, in parts")
    plateau: Scalar = parameter(**POSITIVE, meaning="of buckling cell walls, in parts")
    toe_length: Scalar = parameter(unit="input", **POSITIVE, meaning="end of the toe")
    linear_length: Scalar = parameter(unit="input", **POSITIVE, meaning="of the linear part")
    plateau_length: Scalar = parameter(unit="input", **POSITIVE, meaning="of the plateau")
    rounding: Scalar = parameter(unit="input", **POSITIVE, meaning="width of the passages")
    densification: Scalar = parameter(
        unit="1 / input", **POSITIVE, meaning="growth of stiffness, in parts"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="force without compression")

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        risen = self._integral(u) - self._integral(jnp.zeros_like(u))
        return self.offset + self.linear * risen

    def laws(self, eps: float, depth: int) -> Tree:
        u1 = self.toe_length
        u2 = u1 + self.linear_length
        return node(
            "foam",
            {
                "linear": self.linear, "toe": self.toe, "plateau": self.plateau, "u1": u1, "u2": u2,
                "u3": u2 + self.plateau_length, "rounding": self.rounding,
                "densification": self.densification, "offset": self.offset,
                "least": self.linear * jnp.minimum(self.toe, self.plateau),
                "origin": self._integral(jnp.zeros(())),
            },
        )  # fmt: skip

    def _integral(self, u: Array) -> Array:
        w = self.rounding
        first, second = self.toe_length, self.toe_length + self.linear_length
        x = u - second - self.plateau_length
        dense = (x**2 + x * jnp.sqrt(x**2 + w**2) + w**2 * jnp.arcsinh(x / w)) / 4
        return (
            self.toe * u
            + (1 - self.toe) * _ramp(u - first, w)
            + (self.plateau - 1) * _ramp(u - second, w)
            + self.densification * dense
        )


def _ramp(x: Array, width: Scalar) -> Array:
    return (x + jnp.sqrt(x**2 + width**2)) / 2
