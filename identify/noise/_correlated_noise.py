"""Correlated noise behind a linear fit whose many unknowns have followed part of it.

Residuals r = M e of a linear fit are smaller than the noise e, and less correlated, because the fit
follows the slow part of e: under AR(1) noise of 0.7 the residuals of a Preisach grid have a correlation of
0.53, and intervals made of them held 64 to 74 per cent of the truths at nominal 90. M is known. So the
noise is the one whose simulated residuals M e have the size and the correlation that were found.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Float

CORRELATIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95)
"""Of neighbouring rows, that are simulated; between them residuals are interpolated."""

SIMULATED, VALUES = 32, 320_000
"""Series of noise for each, and fewer if there are so many rows that they have more values together. The
random numbers are the same for all, so that what is interpolated is smooth."""

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
    count = int(np.clip(VALUES // len(residuals), 1, SIMULATED))
    white = np.random.default_rng(0).normal(size=(len(residuals), count))
    noise = np.empty((len(residuals), len(CORRELATIONS), count))
    for k, phi in enumerate(CORRELATIONS):
        for rows in sequences:
            one = white[rows] * np.sqrt(1 - phi**2)
            one[0] = white[rows][0]
            noise[rows, k] = _followed(one, phi)
    followed = left(noise.reshape(len(residuals), -1)).reshape(noise.shape)
    moments = [_moments(followed[:, k], sequences) for k in range(len(CORRELATIONS))]
    squares, products = np.array(moments).T
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
        spread[rows] = _followed(one, phi) + _followed(one[::-1], phi)[::-1] - one
    return spread


def _followed(x: Noises, phi: float) -> Noises:
    """e_i = phi e_(i-1) + x_i of each column; scipy.signal has it too, and takes half a second to load."""
    band = np.stack([np.ones(len(x)), np.full(len(x), -phi)])
    return scipy.linalg.solve_banded((1, 0), band, x, check_finite=False)


def _moments(series: Noises, sequences: Sequence[slice]) -> tuple[float, float]:
    """Mean square, and mean product of neighbours."""
    products = sum(float((series[rows][1:] * series[rows][:-1]).sum()) for rows in sequences)
    return float(np.mean(series**2)), products / series.size
