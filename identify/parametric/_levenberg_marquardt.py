"""Levenberg-Marquardt: damped Gauss-Newton steps in a trust region."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

LEAST, GOOD = 0.01, 0.99
"""Share of the predicted decrease from which a step is taken, and from which the next may be longer."""

SHORTER, LONGER = 0.25, 3.5
"""Factors of the step size after a step that was refused, and after a good one (Gould et al. 2005)."""


class Solution(NamedTuple):
    """Where the search ended, whether it converged, and after how many steps."""

    value: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class _State(NamedTuple):
    at: Array
    residuals: Array
    slopes: Array
    """Jacobian of the residuals at `at`."""
    tried: Array
    """The next point."""
    size: Array
    first: Array
    converged: Array
    finite: Array
    steps: Array


def levenberg_marquardt(
    residuals: Callable[[Array], Array], start: Array, most: int, tolerance: float
) -> Solution:
    """The minimum of sum r(z)^2 / 2 nearest to `start`, after at most so many steps.

        (J' J + 1 / size) d = -J' r,  solved by the QR decomposition of [J; 1 / sqrt(size)]

    It converged where neither z nor any residual changes by more than `tolerance`, absolute and relative.
    It takes the same steps as optimistix's `LevenbergMarquardt`, which traces the residuals several times
    and needs twice the time to trace and compile: the wait before a first fit.

    **Source:** Gould, Orban, Sartenaer and Toint, "Sensitivity of trust-region algorithms to their
    parameters", 4OR 3, 2005.
    """
    count = start.shape[0]

    def with_slopes(z: Array) -> tuple[Array, Array]:
        def pair(z: Array) -> tuple[Array, Array]:
            found = residuals(z)
            return found, found

        slopes, found = jax.jacfwd(pair, has_aux=True)(z)
        return found, slopes

    def small(change: Array, value: Array) -> Array:
        return jnp.all(jnp.abs(change) < tolerance + tolerance * jnp.abs(value))

    def go_on(s: _State) -> Array:
        return (s.steps < most) & ~s.converged & s.finite

    def step(s: _State) -> _State:
        new, new_slopes = with_slopes(s.tried)
        move = s.tried - s.at
        least = (s.residuals**2).sum()
        predicted = ((s.slopes @ move + s.residuals) ** 2).sum() - least
        change = (new**2).sum() - least
        taken = s.first | (change <= LEAST * predicted)
        good = ~s.first & (change < GOOD * predicted) & (predicted < 0)
        size = s.size * jnp.where(taken, jnp.where(good, LONGER, 1.0), SHORTER)
        converged = taken & small(move, s.tried) & small(new - s.residuals, new)
        at = jnp.where(taken, s.tried, s.at)
        found = jnp.where(taken, new, s.residuals)
        slopes = jnp.where(taken, new_slopes, s.slopes)
        limits = jnp.finfo(size.dtype)
        # A step size of 0 is no division by 0.
        damping = jnp.where(size > limits.eps, 1 / jnp.maximum(size, limits.eps), limits.max)
        q, r = jnp.linalg.qr(jnp.concatenate([slopes, jnp.sqrt(damping) * jnp.eye(count)]))
        down = jax.scipy.linalg.solve_triangular(r, q[: len(found)].T @ found)
        finite = jnp.isfinite(down).all()
        return _State(
            at, found, slopes, at - down, size, jnp.array(False), converged, finite, s.steps + 1
        )

    shape = jax.eval_shape(residuals, start)
    none = jnp.zeros(shape.shape, shape.dtype)
    slopes = jnp.zeros((*shape.shape, count), shape.dtype)
    true, false = jnp.array(True), jnp.array(False)
    first = _State(
        start, none, slopes, start, jnp.ones((), start.dtype), true, false, true, jnp.array(0)
    )
    last = jax.lax.while_loop(go_on, step, first)
    return Solution(last.at, last.converged & last.finite, last.steps)
