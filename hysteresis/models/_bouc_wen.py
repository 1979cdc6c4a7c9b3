"""The Bouc-Wen model, integrated exactly along its input's path."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import POSITIVE, Scalar, array_module, parameter
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
