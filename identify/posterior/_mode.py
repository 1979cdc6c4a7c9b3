"""The greatest value of a smooth function, of a fit's likelihood above all: Newton's method, never
downwards."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._levels import ROUNDING, STEPS
from ._log_posterior import Target

Function = Callable[[Float[Array, " numbers"]], Float[Array, ""]]


class Maximum(NamedTuple):
    """Where the function is greatest, its value and minus its Hessian there (1 on the diagonal of numbers
    that do not move)."""

    point: Float[Array, " numbers"]
    value: Float[Array, ""]
    curvature: Float[Array, "numbers numbers"]


def maximise(
    function: Function,
    point: Float[Array, " numbers"],
    moves: Bool[Array, " numbers"],
) -> Maximum:
    """The maximum near `point` over those numbers that move; pure JAX.

    Newton's step in the eigenvectors of the Hessian, each by its size whatever its sign, so that a saddle
    is left upwards; at most 1 along each, which in a logarithm is a factor of e; a quarter of it after a
    step that did not rise. Directions whose curvature is rounding, 1e-13 of the largest, barely move.
    """
    both, fixed = moves[:, None] & moves[None], jnp.diag(jnp.where(moves, 0.0, 1.0))

    def looked_at(point: Array) -> tuple[Array, Array, Array]:
        """Value, gradient and Hessian by one program: compiling it is most of the work."""

        def slope(point: Array) -> Any:
            # Forwards twice: half as much to compile as backwards and forwards.
            gradient, value = jax.jacfwd(lambda z: (function(z),) * 2, has_aux=True)(point)
            return gradient, (value, gradient)

        hessian, (value, gradient) = jax.jacfwd(slope, has_aux=True)(point)
        return value, jnp.where(moves, gradient, 0.0), jnp.where(both, -hessian, fixed)

    def step(carry: Any) -> Any:
        point, value, gradient, curvature, shrink, gain, count = carry
        values, vectors = jnp.linalg.eigh(curvature)
        sizes = jnp.maximum(jnp.abs(values), 1e-13 * jnp.max(jnp.abs(values)))
        along = vectors.T @ gradient
        gain = jnp.where(count > 0, jnp.sum(along**2 / sizes), gain)
        away = vectors @ jnp.clip(along / sizes, -1.0, 1.0)
        new = jnp.where(moves, point + shrink * away, point)
        found = looked_at(new)
        # At the top the value differs by rounding alone.
        better = (found[0] > value) | ((gain < ROUNDING) & jnp.isfinite(found[0]))
        kept = [
            jnp.where(better, *x) for x in zip(found, (value, gradient, curvature), strict=True)
        ]
        shrink = jnp.where(better, jnp.minimum(4 * shrink, 1.0), shrink / 4)
        return jnp.where(better, new, point), *kept, shrink, gain, count + 1

    def goes_on(carry: Any) -> Array:
        *_, shrink, gain, count = carry
        return (gain > ROUNDING) & (shrink > 1e-7) & (count <= STEPS)

    # The first step goes nowhere: it looks at the beginning.
    begin = (jnp.full((), -jnp.inf), jnp.zeros_like(point), jnp.eye(len(point)))
    infinite = jnp.full((), jnp.inf)
    point, value, _, curvature, *_ = jax.lax.while_loop(
        goes_on, step, (point, *begin, jnp.ones(()), infinite, 0)
    )
    return Maximum(point, value, curvature)


class Top(NamedTuple):
    """Of a log-posterior: where it is greatest, its value there, and a root of Laplace's covariance,

    root root' = -(d2 log p)^-1; what the data leave open is as wide as the prior.
    """

    point: Float[Array, " parameters"]
    height: Float[Array, ""]
    root: Float[Array, "parameters parameters"]


@eqx.filter_jit
def top_of(aim: Target) -> Top:
    """The posterior's maximum next to the fit: priors that were not asked for, and noise that was
    estimated after the fit, move it a little."""
    found = maximise(aim.log_probability, aim.start, jnp.ones(len(aim.start), bool))
    of_prior = jnp.clip(-jnp.diagonal(jax.hessian(aim.log_prior)(found.point)), 1e-6)
    unit = jnp.sqrt(jnp.clip(jnp.diagonal(found.curvature), of_prior))
    values, vectors = jnp.linalg.eigh(found.curvature / jnp.outer(unit, unit))
    values = jnp.clip(values, jnp.min(of_prior / unit**2))
    return Top(found.point, found.value, vectors / jnp.sqrt(values)[None] / unit[:, None])


@eqx.filter_jit
def likeliest_near(
    aim: Target,
    begin: Float[Array, " parameters"],
    moves: Bool[Array, " parameters"],
    scored: Float[Array, " rows"],
) -> Maximum:
    """Where the log-likelihood of the `scored` rows (1, else 0) is greatest, near `begin`.

    Priors that were asked for count as data, as they do in the fit. Compiled once for every use.
    """

    def score(point: Array) -> Array:
        asked = aim.bounds.penalty(point[: len(aim.bounds.names)])
        return aim.weight * jnp.sum(scored * aim.pointwise(point)) - asked

    return maximise(score, begin, moves)
