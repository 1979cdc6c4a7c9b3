"""A spring and branches that relax, each on its own: what every viscoelastic model is underneath."""

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from .._registry import register

Hold = Literal["linear", "constant"]
if TYPE_CHECKING:
    Known = Any  # the operators of the two libraries have no type in common
else:
    Known = Array | np.ndarray | np.generic
"""An array, of NumPy where the parameters are known."""


@register
class Chain(NamedTuple):
    """A linear element with decoupled internal states, all at rest where it has had no input:

        x_0' = flow u,    x_k' = drives_k u - rates_k x_k,    y = direct u + sum of x

    - `direct`: the answer at once.
    - `rates` (n,): 1 / time constant, at least 0.
    - `drives` (n,): all positive, so that the output lags (creep), or all negative (relaxation).
    - `flow`: drive of a branch that keeps what it has, the first one; None for no such branch.
    """

    direct: Float[Known, ""]
    rates: Float[Known, " branches"]
    drives: Float[Known, " branches"]
    flow: Float[Known, ""] | None = None

    @property
    def all_rates(self) -> Known:
        """Rates of all branches, 0 for the one that flows."""
        if self.flow is None:
            return self.rates
        xp = self._module
        return xp.append(xp.zeros_like(self.flow), self.rates)

    @property
    def all_drives(self) -> Known:
        """Drives of all branches."""
        return self.drives if self.flow is None else self._module.append(self.flow, self.drives)

    @property
    def _module(self) -> Any:
        return jnp if isinstance(self.rates, jax.Array) else np

    def to_step(self, t: Any) -> Array:
        """Output after a unit step at t = 0: direct + sum of drive t phi(rate t)."""
        t = jnp.asarray(t, self.direct.dtype)
        return self.direct + self._sum(t, lambda r, d: d * t * moments(r * t)[1])

    def to_ramp(self, t: Any) -> Array:
        """Output under the input t from t = 0 on: direct t + sum of drive t^2 psi(rate t)."""
        t = jnp.asarray(t, self.direct.dtype)
        return self.direct * t + self._sum(t, lambda r, d: d * t**2 * moments(r * t)[2])

    def at_frequency(self, omega: Any) -> Array:
        """Complex output over input exp(i omega t): direct + sum of drive / (rate + i omega)."""
        w = jnp.asarray(omega, self.direct.dtype)
        real = self._sum(w, lambda r, d: d * r / (r**2 + w**2))
        imaginary = self._sum(w, lambda r, d: -d * w / (r**2 + w**2))
        return jax.lax.complex(self.direct + real, imaginary)

    def turned(self) -> "Chain":
        """The same element driven from its other side, u from y, decoupled again.

        Its states move by -(diag(rates) + drives 1^T / direct), which scaling by sqrt|drives| makes
        symmetric; with eigenvalues mu_k and orthonormal eigenvectors v_k of that,

            direct' = 1 / direct,    rates' = mu,    drives'_k = -+ (v_k . sqrt|drives|)^2 / direct^2.

        mu is right to rounding of its largest.
        """
        drives = self.all_drives
        root, sign = jnp.sqrt(jnp.abs(drives)), jnp.sign(drives)
        matrix = jnp.diag(self.all_rates) + jnp.outer(sign * root, root) / self.direct
        mu, v = jnp.linalg.eigh(matrix)
        turned = -sign * jnp.square((v * root[:, None]).sum(0) / self.direct)
        # What never relaxes, a dashpot by itself, comes out as rounding of either sign.
        return Chain(1 / self.direct, jnp.maximum(mu, 0.0), turned)

    def largest_stable_step(self, hold: Hold) -> float:
        """The largest even step at which running the other way round does not grow.

        Infinite for `hold="linear"`. For `hold="constant"` each step's matrix
        diag(decay) - before 1^T / direct passes the eigenvalue -1 where

            sum of before_k / (1 + decay_k) = sum of drive_k dt/2 tanhc(rate_k dt/2) = direct,

        tanhc(x) = tanh(x) / x. The left side grows with dt.
        """
        parts = self.direct, self.all_rates, self.all_drives
        direct, rates, drives = (np.asarray(part, float) for part in parts)
        still = rates == 0
        safe = np.where(still, 1.0, rates)

        def beyond(dt: float) -> float:
            return float(drives @ np.where(still, dt / 2, np.tanh(safe * dt / 2) / safe) - direct)

        bounded = not (drives * still).any() and (drives / safe).sum() <= direct
        if hold == "linear" or bounded:
            return float("inf")
        high = float(2 * direct / drives.sum())
        while beyond(high) <= 0:
            high *= 2
        return float(scipy.optimize.brentq(beyond, 0.0, high, xtol=1e-300, rtol=1e-15))

    def _sum(self, at: Array, answer: Callable[[Array, Array], Array]) -> Array:
        """Of every branch's answer, from its rate and its drive, of the shape of `at`."""
        return sum(map(answer, self.all_rates, self.all_drives), start=jnp.zeros_like(at))


class Step(NamedTuple):
    """An exact step of a branch: x = decay * x + before * (input before) + now * (input now)."""

    decay: Float[Array, " *steps"]
    before: Float[Array, " *steps"]
    now: Float[Array, " *steps"]


def exact_step(rate: Array, drive: Array, dt: Array, hold: Hold) -> Step:
    """The exact step over dt for an input that is linear, or keeps its first value, within it."""
    decay, phi, psi = moments(rate * dt)
    swept = drive * dt
    if hold == "constant":
        return Step(decay, swept * phi, jnp.zeros_like(swept))
    return Step(decay, swept * (phi - psi), swept * psi)


EvenSteps = tuple[tuple[Array, Array, Array], ...]
"""Of every branch an even step: z becomes a z + b (input before) + c (input now)."""


def along(rates: Array, drives: Array, dt: Array, hold: Hold) -> EvenSteps:
    """The steps of the branches of a chain under an even clock."""
    return tuple(zip(*exact_step(rates, drives, dt, hold), strict=True))


SOLVED = 2
"""Branches, at most, of which `against` knows the steps in closed form."""


def against(direct: Array, rates: Array, drives: Array, dt: Array, hold: Hold) -> EvenSteps:
    """The steps of a chain of one or two branches that is driven from its other side, under an even clock:

        load = u / direct + sum of z.

    With p and q the drives of a step by the load before and now, delta = 1 - decay, beta = p + q - delta q
    and d' = direct + sum of q, the states x - q load move by the symmetric matrix
    diag(delta) + sqrt(beta beta^T) / d', up to the sign of the drives. Its eigenvalues nu solve

        sum over branches of beta / (nu - delta) = d',

    and a = 1 - nu, c = -Q / (direct T), b = -(a c + 1 / T), with T = sum of beta / (nu - delta)^2 and
    Q = sum of q / (nu - delta). Differences nu - delta are formed without cancellation, so that steps far
    shorter than the time constants lose nothing.

    Source: Golub, Some modified matrix eigenvalue problems, SIAM Review 15 (1973), section 5.
    """
    _, before, now = exact_step(rates, drives, dt, hold)
    delta = -jnp.expm1(-rates * dt)
    beta = before + now - delta * now
    whole = direct + now.sum()

    def weights(nu: Array, over: Array, gain: Array) -> tuple[Array, Array, Array]:
        """From nu, Q / T and 1 / T."""
        a, c = 1 - nu, -over / direct
        return a, -(a * c + gain), c

    if len(rates) == 1:
        return (weights(delta[0] + beta[0] / whole, now[0] / whole, beta[0] / whole**2),)
    share, signs = beta / whole, np.array([1.0, -1.0])
    sign, half = jnp.sign(beta.sum()), (signs * (delta + share)).sum() / 2
    coupling = share.prod()
    root, turned = jnp.sqrt(half**2 + coupling), sign * half * signs
    # root - turned without cancellation: the farther root's distances from both deltas, but for the share.
    beyond = jnp.where(turned > 0, coupling / (root + jnp.abs(turned)), root - turned)
    far = sign * beyond + share
    part = share / far
    other, swapped = jnp.flip(part), jnp.flip(far)
    weight = whole * (part * swapped).sum()
    apart = -(signs * delta).sum()
    outer = weights((delta + far)[0], (now * swapped).sum() / weight, far.prod() / weight)
    # The nearer root lies between the deltas.
    inner = weights(
        (delta * other).sum(),
        apart * (signs * now * other).sum() / weight,
        apart**2 * part.prod() / weight,
    )
    return outer, inner


@jax.custom_jvp
def moments(x: Array) -> tuple[Array, Array, Array]:
    """exp(-x), phi(x) = (1 - exp(-x)) / x and psi(x) = (1 - phi(x)) / x to rounding, at any x >= 0."""
    return _moments(x)[:3]


@moments.defjvp
def _slopes(x: tuple[Array], dx: tuple[Array]) -> Any:
    """phi' = psi - phi and psi' = 2 chi - psi, with chi(x) = (1/2 - psi(x)) / x."""
    decay, phi, psi, chi = _moments(x[0])
    return (decay, phi, psi), (-decay * dx[0], (psi - phi) * dx[0], (2 * chi - psi) * dx[0])


@partial(jax.jit, inline=True)
def _moments(x: Array) -> tuple[Array, Array, Array, Array]:
    # Below 0.1 chi by its series, 1/3! - x/4! + ...: the first term left out is 0.1^9 / 12! = 2e-18.
    small = x < 0.1
    chi = jnp.full_like(x, 1 / math.factorial(11))
    for k in range(10, 2, -1):
        chi = 1 / math.factorial(k) - x * chi
    over = 1 / jnp.where(small, 1.0, x)
    decay = jnp.exp(-x)
    psi = 0.5 - x * chi
    phi = jnp.where(small, 1 - x * psi, (1 - decay) * over)
    psi = jnp.where(small, psi, (1 - phi) * over)
    return decay, phi, psi, jnp.where(small, chi, (0.5 - psi) * over)
