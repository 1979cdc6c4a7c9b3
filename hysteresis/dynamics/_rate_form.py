"""Operators in rate form: a hysteretic force whose rate is proportional to the velocity."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractSteppedModel
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..numerics._newton import root_of
from ._runge_kutta import runge_kutta

RUNGE_KUTTA_STEPS = 4


class RateState(NamedTuple):
    """The input and the hysteretic force."""

    u: Array
    z: Array


class AbstractRateForm(AbstractSteppedModel[RateState]):
    """A hysteretic force z of one state, z' = f+(z) v while the velocity v > 0 and f-(z) v while v < 0.

    By itself it is a rate-independent operator from u to z, integrated along the way of u. In an
    `Oscillator` it is integrated together with the motion.
    """

    @abc.abstractmethod
    def slope(self, z: Any, falling: Any) -> Array:
        """dz/du at z: f-(z) where `falling`, else f+(z)."""

    def init(self, t0: Any = None, u0: Any = None) -> RateState:
        zero = jnp.zeros_like(
            jnp.asarray(jax.tree.leaves(eqx.filter(self, eqx.is_array))[0]).ravel()[0]
        )
        return RateState(zero, zero)

    def step(self, state: RateState, t: Any, u: Any) -> tuple[RateState, Float[Array, ""]]:
        u = jnp.asarray(u, state.u.dtype)
        z = self.along(state.z, u - state.u)
        return RateState(u, z), z

    def along(self, z: Array, way: Array) -> Array:
        """z after a way of one direction, by the classical Runge-Kutta method."""
        falling, h = way < 0, way / RUNGE_KUTTA_STEPS
        for _ in range(RUNGE_KUTTA_STEPS):
            z = runge_kutta(lambda x, _: self.slope(x, falling), z, h)
        return z

    def after(self, z: Array, v: Array, v1: Array, h: Array) -> Array:
        """z one step later by the trapezoidal rule, z1 = z + h/2 (z'(v, z) + z'(v1, z1))."""
        before = z + 0.5 * h * v * self.slope(z, v < 0)
        found = root_of(
            lambda z1: z1 - before - 0.5 * h * v1 * self.slope(z1, v1 < 0), before[None]
        )
        return found[0]


@register
class BoucWenForce(AbstractRateForm):
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

    alpha: Scalar = parameter(
        unit="output / input", bounds=(0.0, float("inf")), meaning="stiffness at z = 0"
    )
    beta_gamma: Scalar = parameter(0.0, unit="1 / input", meaning="loss of stiffness by |v| z")
    beta_delta: Scalar = parameter(0.0, unit="1 / input", meaning="loss of stiffness by v |z|")
    n: Scalar = parameter(1.0, bounds=(0.5, float("inf")), fixed=True, meaning="exponent of |z|")

    def __check_init__(self) -> None:
        for name, least, strictly in (("alpha", 0.0, True), ("n", 0.5, False)):
            value = getattr(self, name)
            if is_concrete(value) and not np.all(value > least if strictly else value >= least):
                raise InputError(
                    "parameter-out-of-bounds",
                    f"{name} = {value}.",
                    fix=f"give a value {'above' if strictly else 'of at least'} {least:g}.",
                )

    def slope(self, z: Any, falling: Any) -> Array:
        size = jnp.abs(z)
        safe = jnp.where(size > 0, size, 1.0)
        power = jnp.where(size > 0, safe**self.n, 0.0)
        side = jnp.where(falling, -1.0, 1.0) * jnp.sign(z)
        return self.alpha - (side * self.beta_gamma + self.beta_delta) * power


@register
class DuhemForce(AbstractRateForm):
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
    limit: Scalar = parameter(
        1.0, unit="output", bounds=(0.0, float("inf")), fixed=True, meaning="last knot"
    )

    def __check_init__(self) -> None:
        shapes = jnp.shape(self.rising), jnp.shape(self.falling)
        count = shapes[0][-1] if shapes[0] else 0
        if shapes[0] != shapes[1] or count < 3 or count % 2 == 0:
            raise InputError(
                "length-mismatch",
                f"slopes of shapes {shapes[0]} and {shapes[1]}.",
                fix="give as many rising as falling slopes, an odd number of at least 3.",
            )
        if is_concrete(self.limit) and not np.all(np.asarray(self.limit) > 0):
            raise InputError(
                "parameter-out-of-bounds", f"limit = {self.limit}.", fix="give a positive one."
            )

    def slope(self, z: Any, falling: Any) -> Array:
        values = jnp.where(falling, self.falling, self.rising)
        count = values.shape[-1]
        place = (z + self.limit) * (count - 1) / (2 * self.limit)
        cell = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0.0, count - 2.0)
        at = cell.astype(int)
        return values[at] + (values[at + 1] - values[at]) * (place - cell)
