"""How much wider errors are because the noise itself is known only so well."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._reml import Linearised, of_free


def widening(
    at: Linearised,
    free: Float[Array, " parts"],
    kind: Bool[Array, " parts"],
    with_misfit: bool = False,
) -> Float[Array, " parameters"]:
    """Standard errors averaged over what the noise may be, over those under the likeliest one.

    The average variance is v + sum over j of (v(f + L_j) + v(f - L_j) - 2 v) / 2, L L' the covariance of
    the noise's free numbers f, from the outer product of their scores: exact to second order. Correlation
    multiplies a variance by exp(f) or so, which at the likeliest f is less than its average.
    """
    scores = jax.jacfwd(lambda f: of_free(f).pointwise(at.residuals, at.rows))(free)
    scores = jnp.where(kind[None], scores, 0.0)
    # A unit of information from elsewhere: a number that the data do not tell does not run away.
    L = jnp.linalg.cholesky(jnp.linalg.inv(scores.T @ scores + jnp.eye(len(kind))))
    steps = jnp.where(kind[:, None], L, 0.0).T

    def variances(f: Array) -> Array:
        noise = of_free(f, with_misfit=with_misfit)
        H = noise.information_of(at.jacobian, at.rows) + at.precision
        size = jnp.sqrt(jnp.diagonal(H))
        used = size > 0
        size = jnp.where(used, size, 1.0)
        H = H / jnp.outer(size, size) + jnp.diag(jnp.where(used, 1e-12, 1.0))
        return jnp.diagonal(jnp.linalg.inv(H)) / size**2

    about = jnp.concatenate([jnp.zeros_like(steps[:1]), steps, -steps])
    v, *others = jax.vmap(variances)(free[None] + about)
    average = v + (sum(others) - 2 * len(steps) * v) / 2
    return jnp.sqrt(jnp.clip(average / v, 1.0, 4.0))
