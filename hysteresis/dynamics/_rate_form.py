"""Hysteretic forces in rate form: of one state, whose rate goes with the velocity."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .._errors import InputError
from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import POSITIVE, Scalar, is_concrete, parameter
from .._registry import register
from ..trees import node

STEPS = 4
"""Of the Runge-Kutta method to a sample."""


def _law(**parameters: Any) -> Tree:
    table = {"knots": 0, "per": 0.0, "rate": np.zeros(2)}
    powers = {"alpha": 0.0, "gamma": 0.0, "delta": 0.0, "n": 1.0}
    known = {"steps": STEPS, **table, **powers} | parameters
    return node("rate_form", known, {"u": 0.0, "z": 0.0})


@register
class BoucWenForce(AbstractLawModel):
    """Bouc-Wen's hysteretic force in its original form, also of mixed sign.

        z' = alpha v - beta_gamma |v| |z|^(n-1) z - beta_delta v |z|^n

    v is the velocity of the input and z = 0 at the start. `BoucWen` is the normal form, whose z is
    bounded; here the coefficients may have either sign, so that z may also stiffen. Data show only the
    products beta gamma and beta delta.

    **Arguments:**

    - `alpha`: stiffness of z at z = 0.
    - `beta_gamma`, `beta_delta`: how it changes with |z|, while |z| falls and rises alike, and of opposite
      sign.
    - `n`: exponent, at least 0.5. A fit keeps it.

    Raises `InputError` where alpha <= 0 or n < 0.5.

    Source: Bouc 1967, Wen 1976; with these names Noël and Schoukens 2016.

    **Example:**

        >>> spring = hysteresis.BoucWenForce(alpha=2.0, beta_gamma=1.0, beta_delta=1.0)
        >>> np.asarray(spring.simulate(None, np.array([0.0, 0.5, 0.0]))).round(2).tolist()
        [0.0, 0.63, -0.31]
    """

    alpha: Scalar = parameter(unit="output / input", **POSITIVE, meaning="stiffness at z = 0")
    beta_gamma: Scalar = parameter(0.0, unit="1 / input", meaning="loss of stiffness by |v| z")
    beta_delta: Scalar = parameter(0.0, unit="1 / input", meaning="loss of stiffness by v |z|")
    n: Scalar = parameter(
        1.0, bounds=(0.5, float("inf")), at="low", fixed=True, meaning="exponent of |z|"
    )

    @property
    def with_knots(self) -> "DuhemForce | None":
        """The same by slopes at three knots: None where n is not 1, and NaN where n is not known yet."""
        if is_concrete(self.n) and float(self.n) != 1.0:
            return None
        a, g, d = (jnp.asarray(x, float) for x in (self.alpha, self.beta_gamma, self.beta_delta))
        rising = jnp.where(self.n == 1.0, jnp.stack([a + g - d, a, a - g - d]), jnp.nan)
        return DuhemForce(rising, jnp.stack([a - g - d, a, a + g - d]))

    def laws(self, eps: float, depth: int) -> Tree:
        return _law(alpha=self.alpha, gamma=self.beta_gamma, delta=self.beta_delta, n=self.n)


@register
class DuhemForce(AbstractLawModel):
    """Duhem operator: the slope of the force depends on the force and on the direction of motion.

        dz = rising(z) du  while u rises,     dz = falling(z) du  while u falls

    with straight lines between the values at even knots from -limit to limit, and on beyond them; z = 0 at
    the start. Bouc-Wen with n = 1 is one with three knots.

    **Arguments:**

    - `rising`, `falling`: slopes (knots,) at the knots; an odd number of at least 3, so that one is at 0.
    - `limit`: the outermost knot.

    Raises `InputError` for another number of knots, two different ones, or a limit that is not positive.

    Source: Duhem 1897; Macki, Nistri and Zecca 1993.

    **Example:**

        >>> friction = hysteresis.DuhemForce(rising=[2.0, 1.0, 0.0], falling=[0.0, 1.0, 2.0], limit=1.0)
        >>> np.asarray(friction.simulate(None, np.array([0.0, 1.0, 0.0]))).round(2).tolist()
        [0.0, 0.63, -0.4]
    """

    rising: Any = parameter(unit="output / input", meaning="slope while the input rises")
    falling: Any = parameter(unit="output / input", meaning="slope while it falls")
    limit: Scalar = parameter(1.0, unit="output", **POSITIVE, fixed=True, meaning="last knot")

    def __check_init__(self) -> None:
        shapes = jnp.shape(self.rising), jnp.shape(self.falling)
        count = shapes[0][-1] if shapes[0] else 0
        if shapes[0] != shapes[1] or count < 3 or count % 2 == 0:
            said = f"slopes of shapes {shapes[0]} and {shapes[1]}."
            mend = "give as many rising as falling slopes, an odd number of at least 3."
            raise InputError("length-mismatch", said, fix=mend)

    def laws(self, eps: float, depth: int) -> Tree:
        return _law(**self.slopes())

    def slopes(self) -> Tree:
        """As a law knows them."""
        knots = self.rising.shape[-1]
        rate = jnp.concatenate([jnp.asarray(x) for x in (self.rising, self.falling)])
        return {"knots": knots, "per": (knots - 1) / (2 * self.limit), "rate": rate}
