"""Densities with a few parameters each: coercivity and bias of the relays are independent.

A relay with thresholds alpha, beta has the coercivity h = (alpha - beta)/2 >= 0 and the bias
m = (alpha + beta)/2. With the density p of h and the distribution function F of m

    I(a, b) = integral over 0 <= h <= H of p(h) [F(a - h) - F(b + h)] dh,    H = (a - b)/2,  b <= a,
    E(a, b) = total * I(a, b) / I(high, low).

Source: Mayergoyz, Mathematical Models of Hysteresis; Della Torre, Magnetic Hysteresis.
"""

import abc
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._parameter import POSITIVE, Scalar, is_concrete, parameter
from .._registry import register
from ._density import AbstractDensity

# The distribution function of two correlated normal numbers.


Each = Float[Array, "*pairs"]

ROUND = 2 * np.pi


def normal_below(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """P(X < x) of a standard normal number: erfc(-x / sqrt 2) / 2.

    XLA spells an erfc out in a hundred operations, and `jax.scipy.special.ndtr` asks for three.
    """
    return jax.lax.erfc(x * -(0.5**0.5)) / 2


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def opposed_normal(order: int, x: Each, y: Each, v: Float[Array, ""]) -> Each:
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


class InputPairs(NamedTuple):
    """Pairs (a, b) of inputs as they are."""

    a: Each
    b: Each


class AbstractCoerciveDensity(AbstractDensity[InputPairs, Float[Array, ""]]):
    """A density whose coercivity and bias are independent.

    Raises `InputError` for an empty range, a width or an order that is not positive.
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    total: Scalar = parameter(unit="output", **POSITIVE, meaning="half the output's range")
    coercivity: Scalar = parameter(unit="input", **POSITIVE, meaning="centre of the coercivity")
    coercivity_width: Scalar = parameter(
        unit="input", **POSITIVE, meaning="width of the coercivity"
    )
    bias: Scalar = parameter(unit="input", meaning="centre of the bias")
    bias_width: Scalar = parameter(unit="input", **POSITIVE, meaning="width of the bias")
    order: int = eqx.field(default=24, static=True, kw_only=True)

    def __check_init__(self) -> None:
        for name in ("coercivity_width", "bias_width", "order"):
            value = getattr(self, name)
            if is_concrete(value) and not bool(np.all(value > 0)):
                raise InputError(
                    "parameter-out-of-bounds", f"{name} is {value}.", fix="give more than 0."
                )

    @abc.abstractmethod
    def integral(self, a: Each, b: Each) -> Each:
        """I(a, b) for b <= a, up to a constant factor."""

    def pair(self, a: Any, b: Any) -> InputPairs:
        return InputPairs(a, b)

    def tabulate(self) -> Float[Array, ""]:
        """total / I(high, low)."""
        low, high = (jnp.full_like(self.total, u) for u in (self.low, self.high))
        return self.total / self.integral(high, low)

    def everett(self, table: Float[Array, ""], pairs: InputPairs) -> Each:
        a, b = jnp.maximum(pairs.a, pairs.b), jnp.minimum(pairs.a, pairs.b)
        return table * self.integral(a, b)

    def mass(self, table: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.asarray(self.total)


@register
class GaussianDensity(AbstractCoerciveDensity):
    """A density of normal coercivity and bias; the coercivity is cut off below 0.

        mu ~ exp(-((h - coercivity) / coercivity_width)^2 / 2 - ((m - bias) / bias_width)^2 / 2)

    I(a, b) is the probability of the triangle {h >= 0, m + h <= a, m - h >= b}: 1, minus that of the three
    half planes outside, plus that of the three wedges in which two of these overlap. The wedges are
    bivariate normal integrals (`opposed_normal`).

    **Arguments:**

    - `low`, `high`: the inputs where all relays are down, and up; the density is cut off there.
    - `total`: its mass, E(high, low).
    - `coercivity`, `coercivity_width`: mean and standard deviation of h before the cut.
    - `bias`, `bias_width`: mean and standard deviation of m.

    **Other arguments:**

    - `order`: of the quadrature. With 24 the error is 1e-13 of the mass of the two distributions before the
      cut, and 2e-11 where the coercivity is 16 times as wide as the bias. If only a part of that mass lies
      in the range, divide by that part.

    Raises `InputError` as `AbstractCoerciveDensity`.

    **Example:**

        >>> density = hysteresis.preisach.GaussianDensity(
        ...     0.0, 10.0, total=5.0, coercivity=1.0, coercivity_width=0.5, bias=5.0, bias_width=2.0)
        >>> y = hysteresis.Preisach(density).simulate(None, np.array([0.0, 10, 5, 0]))
        >>> np.asarray(y).round(2).tolist()
        [-5.0, 5.0, 2.02, -5.0]
    """

    def integral(self, a: Each, b: Each) -> Each:
        centre, width, bias_width = map(
            jnp.asarray, (self.coercivity, self.coercivity_width, self.bias_width)
        )
        spread = jnp.sqrt(width**2 + bias_width**2)
        above = (self.bias + centre - a) / spread
        below = (b - self.bias + centre) / spread
        no_relay = jnp.broadcast_to(-centre / width, jnp.shape(above))
        # Two of the three boundaries have the correlation -tanh v. For m + h = a and m - h = b that is
        # tanh(log(s_m / s_h)) = (s_m^2 - s_h^2) / spread^2; for either and h = 0 it is
        # tanh(arcsinh(s_h / s_m)) = s_h / spread.
        both = jnp.log(bias_width / width), jnp.arcsinh(width / bias_width)
        # Three calls instead of one on stacked arguments, because XLA runs them in parallel.
        corners = (above, below, both[0]), (above, no_relay, both[1]), (below, no_relay, both[1])
        outside = (
            normal_below(above)
            + normal_below(below)
            - sum(opposed_normal(self.order, *each) for each in corners)
        )
        # At a = b nothing is enclosed, but the differences above leave a rounding error.
        return jnp.where(a > b, normal_below(-no_relay) - outside, 0.0)


@register
class LorentzianDensity(AbstractCoerciveDensity):
    """A density whose coercivity and bias have Cauchy distributions, with heavy tails.

        mu ~ 1 / ((1 + ((h - coercivity) / coercivity_width)^2) (1 + ((m - bias) / bias_width)^2))

    The integral over the coercivity is a quadrature in z, h = coercivity + coercivity_width sinh z, which
    is logarithmic in the distance and so resolves tails of any length. A Gauss-Legendre rule runs on each
    of three pieces, cut at the centre of p and where F jumps. A narrow peak or step is then at the end of a
    piece, where the rule's nodes are dense, so the error falls exponentially with the order for any ratio
    of the two widths. The integrand vanishes at H, where F's arguments meet.

    **Arguments:**

    - `low`, `high`: the inputs where all relays are down, and up; the density is cut off there.
    - `total`: its mass, E(high, low).
    - `coercivity`, `coercivity_width`: centre and half width at half height of h.
    - `bias`, `bias_width`: centre and half width at half height of m.

    **Other arguments:**

    - `order`: of the quadrature. With 24 the error is 1e-10 of the mass where the bias is wider than 5 % of
      the range, and 1e-6 at 1 %, for ratios of the widths from 1/16 to 16.

    Raises `InputError` as `AbstractCoerciveDensity`.

    **Example:**

        >>> density = hysteresis.preisach.LorentzianDensity(
        ...     0.0, 10.0, total=5.0, coercivity=1.0, coercivity_width=0.5, bias=5.0, bias_width=2.0)
        >>> y = hysteresis.Preisach(density).simulate(None, np.array([0.0, 10, 5, 0]))
        >>> np.asarray(y).round(2).tolist()
        [-5.0, 5.0, 2.29, -5.0]
    """

    def integral(self, a: Each, b: Each) -> Each:
        half = (a - b) / 2
        step = jnp.clip(jnp.minimum(a - self.bias, self.bias - b), 0.0, half)
        begin, jump, end = (
            jnp.arcsinh((h - self.coercivity) / self.coercivity_width)
            for h in (jnp.zeros_like(half), step, half)
        )
        # The integral does not depend on where it is cut, so the cuts need no gradient.
        jump, peak = jax.lax.stop_gradient((jump, jnp.clip(0.0, begin, end)))
        cuts = jnp.stack([begin, jnp.minimum(jump, peak), jnp.maximum(jump, peak), end])
        left, length = cuts[:-1], jnp.diff(cuts, axis=0)
        nodes, weights = np.polynomial.legendre.leggauss(self.order)
        nodes, weights = (jnp.asarray(x / 2, half.dtype) for x in (nodes + 1, weights))

        # Recomputed for the gradient, whose memory would otherwise grow with the order.
        @jax.checkpoint
        def at_node(node: Array) -> Array:
            z = left + length * node
            h = self.coercivity + self.coercivity_width * jnp.sinh(z)
            upper, lower = ((m - self.bias) / self.bias_width for m in (a[None] - h, b[None] + h))
            return (length / jnp.cosh(z) * (jnp.arctan(upper) - jnp.arctan(lower))).sum(0)

        # A step of a stream: a loop over the nodes takes ten times as long as one mapped evaluation.
        if half.ndim == 0:
            return weights @ jax.vmap(at_node)(nodes)
        sum_up = lambda total, rule: (total + rule[1] * at_node(rule[0]), None)  # noqa: E731
        return jax.lax.scan(sum_up, jnp.zeros_like(half), (nodes, weights))[0]
