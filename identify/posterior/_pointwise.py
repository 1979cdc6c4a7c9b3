"""What draws of a posterior say of every row: its likelihood, and readings to be expected there."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._log_posterior import Target

NUMBERS, DRAWS = 1_000_000, 250
"""Draws of an ensemble that are evaluated, at most; fewer where rows times draws are more than so many."""


class PerRow(NamedTuple):
    """Draws for every counted row of the fitted record, thinned.

    - `log_likelihood`: log p(y_i | those before it), (ensembles, draws, rows).
    - `predictive`: readings to be expected, of the draw's model and noise, each row for itself.
    - `observed`, `rows`: the readings, and their places in the record.
    """

    log_likelihood: Float[np.ndarray, "ensembles draws rows"]
    predictive: Float[np.ndarray, "ensembles draws rows"]
    observed: Float[np.ndarray, " rows"]
    rows: Int[np.ndarray, " rows"]


def per_row(
    aim: Target, points: Float[np.ndarray, "ensembles draws parameters"], seed: int
) -> PerRow:
    """Of some of the draws, evenly taken."""
    rows = np.flatnonzero(np.asarray(aim.rows.counted))
    ensembles, draws, parameters = points.shape
    most = min(max(NUMBERS // (len(rows) * ensembles), 5), DRAWS, draws)
    some = points[:, np.linspace(0, draws - 1, most).astype(int)]
    told = _at_points(aim, jnp.asarray(some.reshape(-1, parameters)))
    likelihood, predicted, scale = (np.asarray(a)[:, rows] for a in told[:3])
    random = np.random.default_rng([seed, 3])
    noise = random.normal(size=predicted.shape)
    if aim.noise_template.tail is not None:
        degrees = 1 / np.asarray(told[3])[:, None]
        noise /= np.sqrt(random.chisquare(degrees, (len(degrees), len(rows))) / degrees)
    shape = (ensembles, -1, len(rows))
    predictive = (predicted + scale * noise).reshape(shape)
    return PerRow(likelihood.reshape(shape), predictive, np.asarray(aim.measured)[rows], rows)


@eqx.filter_jit
def _at_points(aim: Target, points: Float[Array, "points parameters"]) -> tuple[Array, ...]:
    """Of each: (log-likelihood, predicted, scale of the noise) by rows, and the tail."""

    def at(point: Array) -> tuple[Array, ...]:
        noise, predicted = aim.noise(point), aim.residuals(point) + aim.measured
        tail = jnp.zeros(()) if noise.tail is None else jnp.asarray(noise.tail)
        scale = noise.scale(aim.rows._replace(output=predicted))
        return aim.pointwise(point), predicted, scale, tail

    return jax.lax.map(at, points, batch_size=16)
