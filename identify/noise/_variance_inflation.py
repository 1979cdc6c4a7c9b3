"""How much wider errors are because the noise itself is known only so well."""

import numpy as np
from jaxtyping import Float

from ._reml import PARTS, Linearised, of_free


def widening(
    at: Linearised, free: Float[np.ndarray, " parts"], kind: tuple[str, ...]
) -> Float[np.ndarray, " parameters"]:
    """Standard errors averaged over what the noise may be, over those under the likeliest one.

    The average variance is v + sum over j of (v(f + L_j) + v(f - L_j) - 2 v) / 2, L L' the covariance of
    the noise's free numbers f, from the outer product of their scores: exact to second order. Correlation
    multiplies a variance by exp(f) or so, which at the likeliest f is less than its average.
    """
    moves = [k for k, part in enumerate(PARTS) if part in kind]
    ways = np.eye(len(PARTS))[moves]

    def pointwise(f: np.ndarray) -> np.ndarray:
        return np.asarray(of_free(f, kind).pointwise(at.residuals, at.rows))

    h = 1e-5
    scores = np.array([(pointwise(free + h * e) - pointwise(free - h * e)) / (2 * h) for e in ways])
    # A unit of information from elsewhere: a number that the data do not tell does not run away.
    L = np.linalg.cholesky(np.linalg.inv(scores @ scores.T + np.eye(len(moves))))
    steps = L.T @ ways

    def variances(f: np.ndarray) -> np.ndarray:
        H = np.asarray(of_free(f, kind).information_of(at.jacobian, at.rows)) + at.precision
        size = np.sqrt(np.diagonal(H))
        used = size > 0
        size = np.where(used, size, 1.0)
        H = H / np.outer(size, size) + np.diag(np.where(used, 1e-12, 1.0))
        return np.diagonal(np.linalg.inv(H)) / size**2

    v = variances(free)
    others = sum(variances(free + way) for way in (*steps, *-steps))
    average = v + (others - 2 * len(steps) * v) / 2
    return np.sqrt(np.clip(average / v, 1.0, 4.0))
