"""Residual statistics: standard deviation, correlation time, effective sample size."""

from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from ._reml import PARTS, Linearised, noise_fit, of_free

# How much wider errors are because the noise itself is known only so well.


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


class Noise(NamedTuple):
    """Gaussian residuals with a correlation time.

    Densely sampled residuals are not independent: `samples` of them, correlated over
    `correlation_time` samples, have the effective sample size `effective = samples / correlation_time`.
    Least squares weighs residuals with `sigma`, and the log-likelihood is

        log L = -(effective / samples) [ sum r^2 / (2 sigma^2) + samples log sigma ],

    so errors and posteriors widen by the square root of the correlation time.
    """

    sigma: float
    samples: int
    correlation_time: float

    @property
    def effective(self) -> float:
        """The effective sample size: the number of independent residuals with the same information."""
        return self.samples / self.correlation_time


def estimate_noise(residuals: list[Float[np.ndarray, " _"]], parameters: int = 0) -> Noise:
    """Standard deviation and correlation time of residuals.

    **Arguments:** `residuals`, one array for each independent sequence, in the output's unit;
    `parameters`, how many were fitted.

    The correlation time is the larger of two sums over the autocorrelations rho_k:

    - 1 + 2 sum rho_k up to Sokal's window, the smallest lag >= 5 times the sum so far: what widens the
      error of a mean. The mean is left in: an offset is an error too.
    - 1 + 2 sum rho_k^2 over those beyond three of their standard errors, 3 / sqrt(samples): what
      widens the error of parameters whose effect has the residuals' own rhythm, such as the cycle's.

    The effective sample size stays above the number of parameters, so errors stay finite.
    """
    samples = sum(len(r) for r in residuals)
    squares = sum(float(r @ r) for r in residuals)
    if samples == 0 or squares == 0:
        return Noise(0.0, samples, 1.0)
    rho = np.zeros(max(len(r) for r in residuals))
    for r in residuals:
        rho[: len(r)] += autocovariance(r)
    # Not divided by the shrinking count of products, which biases the noisy tail to 0.
    rho /= rho[0]
    of_rhythm = 2 * np.sum(rho[rho**2 > 9 / samples] ** 2) - 1
    tau = float(max(integrated_time(rho), of_rhythm))
    tau = min(tau, samples / (parameters + 1.0))
    sigma = np.sqrt(squares / max(samples - parameters, 1))
    return Noise(float(sigma), samples, max(tau, 1.0))


def lasting_noise(at: Linearised, plain: Noise, parameters: int) -> Noise:
    """Noise behind the residuals of a model of so many parameters, where it lasts from row to row.

    A flexible model takes in a part of what lasts, so that the residuals show too little of it. Restricted
    likelihood counts that, here of an AR(1) process, of the correlation time (1 + phi) / (1 - phi); each
    parameter takes in one independent residual. The `plain` noise stays where the evidence of phi, with
    half a log of the rows, is against it.
    """
    white, found = (noise_fit(at, kind) for kind in (("sigma",), ("sigma", "phi")))
    phi = float(of_free(found.free, ("sigma", "phi")).phi)
    if white.cost - found.cost < np.log(plain.samples) / 2 or phi < 0:
        return plain
    tau = max((1 + phi) / (1 - phi), plain.correlation_time)
    tau = min(tau, plain.samples / (parameters + 1.0))
    effective, before = plain.samples / tau, max(plain.samples - parameters, 1)
    square = plain.sigma**2 * before / plain.samples * effective / (effective - parameters)
    return Noise(float(np.sqrt(square)), plain.samples, tau)


def integrated_time(rho: Float[np.ndarray, "lags *series"]) -> Float[np.ndarray, "*series"]:
    """1 + 2 sum of rho_k up to the first lag k >= 5 times that, Sokal's window, or to the last one."""
    sums = 2 * np.cumsum(rho, axis=0) - 1
    inside = (np.arange(len(rho)) >= sums.T * 5).T
    window = np.where(inside.any(axis=0), inside.argmax(axis=0), len(rho) - 1)
    return np.asarray(np.take_along_axis(sums, window[None], axis=0)[0])


def autocovariance(x: Float[np.ndarray, "rows *series"]) -> Float[np.ndarray, "rows *series"]:
    """sum_i x_i x_(i+k) at every lag k, along the first axis."""
    half = scipy.fft.next_fast_len(len(x), real=True)
    spectrum: Any = scipy.fft.rfft(x, 2 * half, axis=0)
    power = spectrum.real**2 + spectrum.imag**2
    del spectrum
    # A cosine transform holds half of what an inverse Fourier transform does.
    return np.asarray(scipy.fft.dct(power, 1, axis=0, overwrite_x=True))[: len(x)] / (2 * half)
