"""The distribution function of two correlated normal numbers."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

ROUND = 2 * np.pi


def normal_below(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """P(X < x) of a standard normal number: erfc(-x / sqrt 2) / 2.

    XLA spells an erfc out in a hundred operations, and `jax.scipy.special.ndtr` asks for three.
    """
    return jax.lax.erfc(x * -(0.5**0.5)) / 2


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def opposed_normal(
    order: int, x: Float[Array, "*pairs"], y: Float[Array, "*pairs"], v: Float[Array, ""]
) -> Float[Array, "*pairs"]:
    """P(X < x, Y < y) of standard normal numbers whose correlation is -tanh v, |v| up to 3 and more:

        F(x) F(y) - 1/(2 pi) * integral over 0 <= w <= v of
                    sech w exp(-((x^2 + y^2) cosh^2 w + 2 x y sinh w cosh w) / 2) dw.

    Plackett's integral over the correlation, in a variable in which it stays smooth where that comes near
    to +-1. The rule is Gauss-Legendre's, of so many nodes; the derivatives are closed forms.

    Source: Plackett, A reduction formula for normal multivariate integrals, Biometrika 41 (1954); Drezner,
    Wesolowsky, On the computation of the bivariate normal integral, J. Statist. Comput. Simul. 35 (1990).
    """
    nodes, weights = np.polynomial.legendre.leggauss(order)
    nodes, weights = (
        jnp.asarray(each, x.dtype) for each in ((nodes + 1) / 2, weights / (2 * ROUND))
    )
    w = v * nodes
    cosh, tanh = jnp.cosh(w), jnp.tanh(w)
    squares, product = -(x * x + y * y) / 2, -x * y

    def add(total: Array, node: tuple[Array, Array, Array]) -> tuple[Array, None]:
        weight, even, odd = node
        return total - weight * jnp.exp(even * squares + odd * product), None

    rule = v * weights / cosh, cosh * cosh, cosh * cosh * tanh
    return jax.lax.scan(add, normal_below(x) * normal_below(y), rule)[0]


@opposed_normal.defjvp
def _slopes(order: int, at: tuple[Array, Array, Array], moved: tuple[Array, Array, Array]) -> Any:
    (x, y, v), (dx, dy, dv) = at, moved
    cosh, sinh = jnp.cosh(v), jnp.sinh(v)
    of_x = jnp.exp(-x * x / 2) * normal_below(y * cosh + x * sinh) / ROUND**0.5
    of_y = jnp.exp(-y * y / 2) * normal_below(x * cosh + y * sinh) / ROUND**0.5
    of_v = jnp.exp(-((x * x + y * y) * cosh**2 / 2 + x * y * sinh * cosh)) / (-ROUND * cosh)
    return opposed_normal(order, x, y, v), of_x * dx + of_y * dy + of_v * dv
