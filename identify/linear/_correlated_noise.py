"""Correlated noise behind a linear fit whose many unknowns have followed part of it.

Residuals r = M e of a linear fit are smaller than the noise e, and less correlated, because the fit
follows the slow part of e: under AR(1) noise of 0.7 the residuals of a Preisach grid have a correlation of
0.53, and intervals made of them held 64 to 74 per cent of the truths at nominal 90. M is known. So the
noise is the one whose simulated residuals M e have the size and the correlation that were found.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

CORRELATIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95)
"""Of neighbouring rows, that are simulated; between them residuals are interpolated."""

SIMULATED = 32
"""Series of noise for each; the same random numbers for all, so that what is interpolated is smooth."""

Noises = Float[np.ndarray, "rows series"]


class CorrelatedNoise(NamedTuple):
    """AR(1) noise: e_i = phi e_(i-1) + w_i with the standard deviation `sigma`."""

    sigma: float
    phi: float

    @property
    def correlation_time(self) -> float:
        """Rows that carry the information of one independent row about a mean."""
        return (1 + self.phi) / (1 - self.phi)


def noise_behind(
    residuals: Float[np.ndarray, " rows"],
    left: Callable[[Noises], Noises],
    sequences: Sequence[slice],
) -> CorrelatedNoise:
    """The AR(1) noise whose residuals look like those of a fit.

    **Arguments:**

    - `residuals`: of the rows that were fitted.
    - `left`: M, what the fit leaves of series of noise in these rows.
    - `sequences`: rows that follow one another; noise does not go on from one sequence to the next.

    **Returns:** sigma, in the unit of the residuals, and phi between 0 and 0.95.
    """
    shape = len(residuals), SIMULATED
    squares, products = np.empty(len(CORRELATIONS)), np.empty(len(CORRELATIONS))
    for k, phi in enumerate(CORRELATIONS):
        noise = np.random.default_rng(0).normal(size=shape)
        for rows in sequences:
            noise[rows][1:] *= np.sqrt(1 - phi**2)
            noise[rows] = scipy.signal.lfilter([1.0], [1.0, -phi], noise[rows], axis=0)
        squares[k], products[k] = _moments(left(noise), sequences)
    found, neighbours = _moments(residuals[:, None], sequences)
    if found == 0:
        return CorrelatedNoise(0.0, 0.0)
    simulated = np.maximum.accumulate(products / squares)
    phi = float(np.interp(neighbours / found, simulated, CORRELATIONS))
    return CorrelatedNoise(float(np.sqrt(found / np.interp(phi, CORRELATIONS, squares))), phi)


def spread_over_rows(columns: Noises, phi: float, sequences: Sequence[slice]) -> Noises:
    """V times columns, V the covariance of AR(1) noise of unit variance: V_ij = phi^|i - j|."""
    spread = np.empty_like(columns)
    for rows in sequences:
        one = columns[rows]
        ahead = scipy.signal.lfilter([1.0], [1.0, -phi], one, axis=0)
        back = scipy.signal.lfilter([1.0], [1.0, -phi], one[::-1], axis=0)[::-1]
        spread[rows] = ahead + back - one
    return spread


def _moments(series: Noises, sequences: Sequence[slice]) -> tuple[float, float]:
    """Mean square, and mean product of neighbours."""
    products = sum(float((series[rows][1:] * series[rows][:-1]).sum()) for rows in sequences)
    return float(np.mean(series**2)), products / series.size
