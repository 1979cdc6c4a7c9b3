"""The Bouc-Wen model, integrated exactly along its input's path."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import NOT_NEGATIVE, POSITIVE, Scalar, array_module, check_bounds, parameter
from .._registry import register
from ..trees import ROUNDING, node

NODES = 40


@register
class BoucWen(AbstractLawModel):
    """Bouc-Wen model: a spring beside one that yields.

        y = offset + alpha k x + (1 - alpha) k z
        dz = dx - beta |dx| |z|^(n-1) z - gamma dx |z|^n

    x is the input, and z = x = 0 at the start. The output depends on the path alone, not on its rate,
    and leads the input. |z| approaches yield_at = (beta + gamma)^(-1/n) and stays below it. The
    parameters are yield_at and gamma / beta, because data separate these two whatever the unit and n.

    **Arguments:**

    - `k`: initial stiffness.
    - `alpha`: the part of it that remains after yield, from 0 to 1.
    - `yield_at`: the largest |z|.
    - `n`: sharpness of yield: 1 is an exponential, 2 a hyperbolic tangent; from 0.5 to 10.
    - `gamma_over_beta`: above -1, because z is not bounded otherwise, and at most 1, because a closed
      cycle could give energy otherwise. At 1 unloading is straight.
    - `offset`: the output's constant.

    Raises `InputError` where an argument does not meet these conditions.

    Source: Bouc 1967, Wen 1976; admissible parameters and normal form: Ikhouane and Rodellar 2007.

    **Example:**

        >>> spring = hysteresis.BoucWen(k=2.0, alpha=0.25, yield_at=1.0)
        >>> np.asarray(spring.simulate(None, np.array([0.0, 2.0, 4.0, 2.0, 0.0]))).round(2).tolist()
        [0.0, 2.3, 3.47, -0.1, -1.45]
    """

    k: Scalar = parameter(unit="output / input", **POSITIVE, meaning="stiffness at first")
    alpha: Scalar = parameter(
        bounds=(0.0, 1.0), at="low high", meaning="part of the stiffness left after yield"
    )
    yield_at: Scalar = parameter(
        unit="input", **POSITIVE, meaning="largest z, where the first line yields"
    )
    n: Scalar = parameter(1.0, bounds=(0.5, 10.0), at="low high", meaning="sharpness of yield")
    gamma_over_beta: Scalar = parameter(
        0.0, bounds=(-1.0, 1.0), at="high", meaning="shape of unloading"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")

    @classmethod
    def of_coefficients(
        cls, *, k: float, alpha: float, beta: float, gamma: float, n: float, A: float = 1.0,
        offset: float = 0.0,
    ) -> "BoucWen":  # fmt: skip
        """From the coefficients of dz = A dx - beta |dx| |z|^(n-1) z - gamma dx |z|^n.

        A is scaled away, because k and alpha can express it. Raises `InputError` unless A > 0,
        beta + gamma > 0 and beta >= gamma.
        """
        if not (A > 0 and beta + gamma > 0 and beta >= gamma):
            raise InputError(
                "parameter-out-of-bounds",
                f"A = {A}, beta = {beta}, gamma = {gamma}.",
                cause="z would not be bounded, or a closed cycle could give energy.",
                fix="keep A > 0, beta + gamma > 0 and beta >= gamma.",
            )
        first = alpha + (1 - alpha) * A
        limit = (A / (beta + gamma)) ** (1 / n) / A
        return cls(k * first, alpha / first, limit, n, gamma / beta, offset)

    def coefficients(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """beta and gamma, for A = 1."""
        beta = self.yield_at**-self.n / (1 + self.gamma_over_beta)
        return beta, self.gamma_over_beta * beta

    def laws(self, eps: float, depth: int) -> Tree:
        x, weights = _gauss()
        xp = array_module(self.n)
        return node(
            "bouc_wen",
            {
                "nodes": NODES, "powers": jnp.asarray(x ** (3 * xp.asarray(self.n))), "cubes": x**3,
                "weights": weights, "k": self.k, "alpha": self.alpha, "yield_at": self.yield_at,
                "n": self.n, "descent": self.descent(), "offset": self.offset,
                "rounding": ROUNDING * eps, "finest": max(1e-12, 32 * eps),
            },
            {"u": 0.0, "w": 0.0},
        )  # fmt: skip

    def descent(self) -> Scalar:
        """q: how much steeper z is at -yield_at, on the way up, than at 0."""
        return (1 - self.gamma_over_beta) / (1 + self.gamma_over_beta)


def _gauss() -> tuple[np.ndarray, np.ndarray]:
    """Nodes x in (0, 1) and weights 3 x^2 dx: of s = x^3, so that s^n is smooth in x."""
    x, weights = np.polynomial.legendre.leggauss(NODES)
    x = (1 + x) / 2
    return x, 1.5 * x**2 * weights


# The Bouc-Wen model that loses strength and stiffness and slips, integrated by a relaxing Runge-Kutta.

SUBSTEPS = 16
"""Of every sample's way, however long: see `DegradingBoucWen` for what they leave."""

LEAST_SLOPE = 1e-6
"""In parts of k: where there is no more, z gives nothing more either."""


@register
class Pinching(eqx.Module):
    """Slip of a joint around a level of z, beyond which it bears again. dz is multiplied by

        h = 1 - zeta1 exp(-((z sign(dx) - level z_u) / (zeta2 yield_at))^2)
        zeta1 = slip (1 - exp(-onset eps)),    zeta2 = (spread + widening eps) (severity + zeta1)

    where z_u is the present limit of z, and eps is the energy of `DegradingBoucWen`.

    **Arguments:**

    - `slip` (zeta_10): the part of its slope that z loses in the end, from 0 to below 1.
    - `onset` (p): how soon slip comes. `level` (q): where it comes, from 0 to below 1.
    - `spread` (psi_0), `severity` (lambda): how far around the level.
    - `widening` (delta_psi): growth of the spread; None for none.

    Most records cannot identify all six. Raises `InputError` where one does not meet these conditions.

    Source: Foliente, J. Struct. Eng. 121 (1995).

    **Example:**

        >>> slip = hysteresis.Pinching(slip=0.8, onset=1.0, level=0.0, spread=0.5, severity=1.0)
        >>> w = jnp.array([-1.0, 0.0, 1.0])
        >>> y = slip.factor(w, limit=jnp.array(1.0), energy=jnp.array(3.0))
        >>> np.asarray(y).round(2).tolist()
        [0.79, 0.24, 0.79]
    """

    slip: Scalar = parameter(bounds=(0.0, 1.0), at="low", meaning="slope that z loses by slip")
    onset: Scalar = parameter(**NOT_NEGATIVE, meaning="how soon slip comes, per energy")
    level: Scalar = parameter(
        bounds=(0.0, 1.0), at="low", meaning="where it slips, in parts of z's limit"
    )
    spread: Scalar = parameter(**POSITIVE, meaning="how far around, in parts of yield_at")
    severity: Scalar = parameter(**POSITIVE, meaning="width without slip, in parts")
    widening: Scalar | None = parameter(
        None, **NOT_NEGATIVE, meaning="growth of the spread, per energy"
    )

    def __check_init__(self) -> None:
        check_bounds(self)

    def factor(self, w: Array, limit: Array, energy: Array) -> Array:
        """h on the way up."""
        lost = self.slip * -jnp.expm1(-self.onset * energy)
        spread = jnp.asarray(self.spread)
        if self.widening is not None:
            spread = spread + self.widening * energy
        away = (w - self.level * limit) / (spread * (self.severity + lost))
        return jnp.asarray(1 - lost * jnp.exp(-jnp.square(away)))


@register
class DegradingBoucWen(AbstractLawModel):
    """Bouc-Wen model whose yielding spring wears (Bouc-Wen-Baber-Noori):

        y = offset + alpha k x + (1 - alpha) k z
        dz = (h / eta) (dx - nu (beta |dx| |z|^(n-1) z + gamma dx |z|^n))
        nu = 1 + strength_loss eps,    eta = 1 + stiffness_loss eps,    d eps = z dx / yield_at^2

    eps is the energy that went into z, divided by (1 - alpha) k yield_at^2. The output depends on the
    path alone, not on its rate; z approaches nu^(-1/n) yield_at.

    **Arguments:**

    - `inner`: the model when new.
    - `strength_loss`, `stiffness_loss`: not negative; None for none. To convert coefficients for
      another measure of energy, multiply them by its value at eps = 1: yield_at^2 for the integral of z dx.
    - `pinching`: `Pinching` for h, None for h = 1.

    No closed form is known, so every sample is integrated in 16 substeps. In a substep z relaxes towards
    a mean limit at a mean rate, both with the weights of the classical Runge-Kutta method. So a substep
    of any length is stable, and z does not pass its limit. Where samples lie up to yield_at / 5 apart,
    the error of z is below 4e-5 yield_at; up to yield_at apart, 5e-4; up to 4 yield_at, 2e-3 (n up to 3,
    gamma_over_beta from -0.5 on, losses up to 0.05).

    Raises `InputError` where an argument does not meet these conditions.

    Source: Baber and Wen, J. Eng. Mech. Div. 107 (1981); Baber and Noori, J. Eng. Mech. 111 (1985).

    **Example:**

        >>> new = hysteresis.BoucWen(k=1.0, alpha=0.0, yield_at=1.0)
        >>> worn = hysteresis.DegradingBoucWen(new, strength_loss=0.1)
        >>> np.asarray(worn.simulate(None, np.array([4.0, -4.0, 4.0, -4.0]))).round(2).tolist()
        [0.82, -0.6, 0.49, -0.42]
    """

    inner: BoucWen
    strength_loss: Scalar | None = parameter(
        None, **NOT_NEGATIVE, meaning="growth of nu, per energy"
    )
    stiffness_loss: Scalar | None = parameter(
        None, **NOT_NEGATIVE, meaning="growth of eta, per energy"
    )
    pinching: Pinching | None = None

    def laws(self, eps: float, depth: int) -> Tree:
        inner, slip = self.inner, self.pinching
        losses = {"strength_loss": self.strength_loss, "stiffness_loss": self.stiffness_loss}
        pinching = {
            "slip": 0.0, "onset": 0.0, "level": 0.0, "spread": 1.0, "severity": 1.0, "widening": 0.0,
        }  # fmt: skip
        if slip is not None:
            given = {name: getattr(slip, name) for name in pinching}
            pinching |= {name: x for name, x in given.items() if x is not None}
        return node(
            "degrading_bouc_wen",
            {
                "substeps": SUBSTEPS, "ahead": [0.5, 0.5, 1.0], "weights": [1 / 6, 1 / 3, 1 / 3, 1 / 6],
                "k": inner.k, "alpha": inner.alpha, "yield_at": inner.yield_at, "n": inner.n,
                "descent": inner.descent(), "offset": inner.offset,
                **{name: 0.0 if x is None else x for name, x in losses.items()}, **pinching,
                "least": jnp.maximum(self.least_slope(), LEAST_SLOPE * inner.k),
                "rounding": ROUNDING * eps,
            },
            {"u": 0.0, "w": 0.0, "energy": 0.0, "rate": 0.0, "drive": 0.0},
        )  # fmt: skip

    def least_slope(self) -> Float[Array, ""]:
        """A bound from below of dy/dx: strength is lost no faster than z falls by strength_loss / n.

        For X = -(h / eta) (1 - nu w^n), the fall of z beyond its limit on the way up, grows only while
        X < strength_loss w^2 / (n nu), and w <= 1 <= nu.
        """
        inner = self.inner
        loss = 0.0 if self.strength_loss is None else self.strength_loss
        return jnp.asarray(inner.k * (inner.alpha - (1 - inner.alpha) * loss / inner.n))
