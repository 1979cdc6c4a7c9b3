"""What a noise model leaves of the residuals, and the chance that this is noise."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
import scipy.linalg
from jaxtyping import Array, Float

from hysteresis.records._arrays import pieces

from .._levels import FEW, HELD_AT_ONCE
from ._arithmetic import Rows

# Correlated noise behind a linear fit whose many unknowns have followed part of it.
#
# Residuals r = M e of a linear fit are smaller than the noise e, and less correlated, because the fit
# follows the slow part of e: under AR(1) noise of 0.7 the residuals of a Preisach grid have a correlation
# of 0.53, and intervals made of them held 64 to 74 per cent of the truths at nominal 90. M is known. So the
# noise is the one whose simulated residuals M e have the size and the correlation that were found.


CORRELATIONS = 1 - np.geomspace(1.0, 0.05, 10)
"""Of neighbouring rows, that are simulated: even steps of log(1 - phi). Residuals are interpolated."""

Noises = Float[np.ndarray, "rows series"]


class CorrelatedNoise(NamedTuple):
    """AR(1) noise: e_i = phi e_(i-1) + w_i with the standard deviation `sigma`."""

    sigma: float
    phi: float


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
    # The random numbers are the same for all, so that what is interpolated is smooth.
    count = int(np.clip(HELD_AT_ONCE // len(residuals), 1, FEW))
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


LAGS = 20
"""Lags over which innovations are looked at."""

BELIEVED = 1e-3
"""Chance of noise to leave what is left, below which it is not believed to be noise."""


class Left(NamedTuple):
    """What is left of a linearised model under one noise, all through the filter that makes it white.

    - `x` (rows,): innovations, of unit variance where the noise is the right one.
    - `W` (directions, parameters): the model's directions. `shapes` (rows, shapes): those of a misfit.
    - `information`: of a row of unit variance.
    """

    x: Float[Array | np.ndarray, " rows"]
    W: Float[Array | np.ndarray, "directions parameters"]
    shapes: Float[Array | np.ndarray, "rows shapes"]
    information: Float[Array | np.ndarray, ""]

    def root(self, precision: Float[np.ndarray, "parameters parameters"]) -> np.ndarray:
        """Rows with root'root = the information about the parameters, that of the prior below."""
        values, vectors = np.linalg.eigh(precision)
        of_prior = vectors.T * np.sqrt(np.maximum(values, 0.0))[:, None]
        return np.concatenate([np.asarray(self.W) * np.sqrt(self.information), of_prior])


def believed(left: Left, place: Float[Array | np.ndarray, " rows"], spent: int) -> float:
    """The smaller of two chances: of white innovations to be as coloured, and of noise to look as much like
    a function of the input. `place` as in `Rows`; `spent`: how many of phi and theta there are."""
    x, W, shapes = (np.asarray(a) for a in left[:3])
    return min(_white(x, np.asarray(place), spent), _shapeless(x, W, shapes))


def nothing_speaks_against(left: Left, rows: Rows, spent: int = 0) -> bool:
    """Whether Gaussian noise of one size can be believed without trying other kinds.

    Color, shapes, tails (Jarque and Bera's kurtosis) and growth (Breusch and Pagan's correlation of squares
    with the squared reading) are each as strong by chance in one of twenty cases at least. `spent` as for
    `believed`.
    """
    x, reading = np.asarray(left.x), np.asarray(rows.output) ** 2
    counted = np.asarray(rows.counted)
    squares, reading = x[counted] ** 2, reading[counted]
    count = len(squares)
    if count < FEW or not squares.any():
        return False
    tails = abs(np.mean(squares**2) / np.mean(squares) ** 2 - 3) * np.sqrt(count / 24)
    spread = np.std(squares) * np.std(reading)
    growth = np.cov(squares, reading)[0, 1] / spread * np.sqrt(count) if spread > 0 else 0.0
    chance = 2 * scipy.special.ndtr(-max(tails, abs(growth)))
    return bool(min(chance, believed(left, rows.place, spent)) > 0.05)


def _white(x: np.ndarray, place: np.ndarray, spent: int) -> float:
    """Ljung and Box: rows (rows + 2) sum over lags of rho_k^2 / (rows - k) is chi-square with as many
    degrees of freedom as lags, less those spent. Outliers count as four deviations."""
    x = np.clip(x, -4.0, 4.0)
    count = int(np.count_nonzero(x))
    lags = np.arange(1, min(LAGS, count // 4) + 1)
    if len(lags) <= spent:
        return 1.0
    rho = np.array([np.sum((x[k:] * x[:-k])[place[k:] >= k]) for k in lags]) / (x @ x)
    Q = count * (count + 2) * np.sum(rho**2 / (count - lags))
    return float(scipy.special.chdtrc(len(lags) - spent, Q))


def _shapeless(x: np.ndarray, W: np.ndarray, shapes: np.ndarray) -> float:
    """|P x|^2 is chi-square, P the projection onto what the shapes add to the model's own directions."""
    if not shapes.shape[1]:
        return 1.0
    own, rank = _explained(x, W)
    whole, ranks = _explained(x, W, shapes)
    return float(scipy.special.chdtrc(max(ranks - rank, 1), max(whole - own, 0.0)))


def _explained(x: np.ndarray, *columns: np.ndarray) -> tuple[float, int]:
    """|Q'x|^2, Q an orthonormal basis of the columns, and how many these are."""
    width = sum(A.shape[1] for A in columns)
    square, along = np.zeros((width, width)), np.zeros(width)
    for rows in pieces(len(x)):
        A = np.hstack([part[rows] for part in columns])
        square += A.T @ A
        along += A.T @ x[rows]
    size = np.sqrt(np.diagonal(square))
    size = size + (size == 0)
    values, vectors = np.linalg.eigh(square / np.outer(size, size))
    seen = values > 1e-9
    along = vectors[:, seen].T @ (along / size)
    return float(np.sum(along**2 / values[seen])), int(seen.sum())
