"""Draws from the posterior of a linear model whose unknowns have signs to keep."""

from collections.abc import Callable

import numpy as np
import scipy.linalg
from jaxtyping import Float

from ..noise._residual_statistics import Noise

Tell = Callable[[int], None]
Minimum = Callable[[Float[np.ndarray, " unknowns"]], Float[np.ndarray, " unknowns"]]


def projected_draws(
    H: Float[np.ndarray, "unknowns unknowns"],
    b: Float[np.ndarray, " unknowns"],
    minimum: Minimum,
    variance: float,
    count: int,
    random: np.random.Generator,
    tell: Tell = lambda done: None,
) -> Float[np.ndarray, "count unknowns"]:
    """Draws from the projected Gaussian posterior: independent, and each a model there can be.

    x = argmin over those models of (x - z)'Q(x - z), z Gaussian about the unconstrained minimum of
    x'Hx/2 - b'x with precision Q = H / variance. That moves b by a Gaussian with covariance
    H variance, and the solver of the fit, `minimum` of a moved b, projects.

    Source: Everink, Dong, Andersen, Bayesian inference with projected densities, SIAM/ASA J.
    Uncertainty Quantification 11 (2023).
    """
    factor = scipy.linalg.cholesky(H, lower=True) * np.sqrt(variance)
    found = np.empty((count, len(b)))
    for k in range(count):
        found[k] = minimum(b + factor @ random.normal(size=len(b)))
        tell(k + 1)
    return found


def variance_of_unknowns(noise: Noise, scale: float, rows: int) -> float:
    """What divides H to a precision: H is a mean over `rows` rows, in squares of `scale`."""
    return noise.sigma**2 * noise.correlation_time / scale**2 / rows
