"""Leave-one-out cross-validation from one posterior, by Pareto-smoothed importance sampling (PSIS-LOO)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

RELIABLE = 0.7
"""Pareto shape up to which smoothed weights are reliable."""

CHUNK = 500
"""Rows whose weights are smoothed at a time, which bounds the memory."""


class Loo(NamedTuple):
    """Expected log density of a new row, each row predicted by the draws of a posterior without it.

    - `elpd`, `error`: the sum over rows and its standard error.
    - `effective_parameters`: the loss of log density against a posterior that has seen the row.
    - `pointwise`: the log density of each row; `k`: its Pareto shape.
    """

    elpd: float
    error: float
    effective_parameters: float
    pointwise: Float[np.ndarray, " rows"]
    k: Float[np.ndarray, " rows"]

    @property
    def unreliable(self) -> int:
        """The number of rows with a Pareto shape above 0.7, whose weight rests on too few draws."""
        return int((self.k > RELIABLE).sum())


def loo(log_likelihood: Float[np.ndarray, "draws rows"]) -> Loo:
    """PSIS-LOO from the log-likelihood of every row under every draw:

        elpd_i = log sum_s w_is p(y_i | theta_s),    w_is  smoothed from  1 / p(y_i | theta_s)

    Rows must be independent given the parameters. If residuals are autocorrelated, the neighbours of a row
    predict most of it, so the result is too good.

    **Arguments:** `log_likelihood`: log p(y_i | theta_s) of every row i under every draw s.

    Source: Vehtari, Gelman, Gabry, Practical Bayesian model evaluation using leave-one-out
    cross-validation and WAIC, Statistics and Computing 27 (2017).
    """
    draws, rows = log_likelihood.shape
    pointwise, k = np.empty(rows), np.empty(rows)
    for begin in range(0, rows, CHUNK):
        part = slice(begin, begin + CHUNK)
        terms = log_likelihood[:, part]
        weights, k[part] = smoothed(-terms)
        pointwise[part] = logsumexp(terms + weights, axis=0)
    with_it = logsumexp(log_likelihood, axis=0) - np.log(draws)
    return Loo(
        float(pointwise.sum()),
        float(np.sqrt(rows) * pointwise.std()),
        float((with_it - pointwise).sum()),
        pointwise,
        k,
    )


def smoothed(
    log_ratios: Float[np.ndarray, "draws rows"],
) -> tuple[Float[np.ndarray, "draws rows"], Float[np.ndarray, " rows"]]:
    """Log weights that sum to 1 over the draws, and the Pareto shape of each row.

    The largest ratios, 3 sqrt(draws) of them or a fifth, are replaced by the quantiles of the generalised
    Pareto distribution fitted to them, none above the largest. If the draws are too few or too similar for
    a tail, the shape is infinite and the weights are the ratios themselves.

    Source: Vehtari, Simpson, Gelman, Yao, Gabry, Pareto smoothed importance sampling, JMLR 25 (2024).
    """
    draws, rows = log_ratios.shape
    x, k = log_ratios - log_ratios.max(0), np.full(rows, np.inf)
    tail = int(np.ceil(min(draws / 5, 3 * np.sqrt(draws))))
    if tail > 4:
        order = np.argsort(x, axis=0)[-tail - 1 :]
        largest = np.exp(np.take_along_axis(x, order, 0))
        above = largest[1:] - largest[0]
        fits = above[int(tail / 4 + 0.5) - 1] > 0
        k[fits], sigma = pareto(above[:, fits])
        chance = (np.arange(tail)[:, None] + 0.5) / tail
        quantile = sigma * np.expm1(-k[fits] * np.log1p(-chance)) / k[fits]
        value = np.minimum(np.log(quantile + largest[0, fits]), 0.0)
        x[order[1:, fits], np.flatnonzero(fits)] = value
    return x - logsumexp(x, axis=0), k


def pareto(
    x: Float[np.ndarray, "tail rows"],
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, " rows"]]:
    """Shape k and scale sigma of p(x) = (1 + k x / sigma)^(-1/k - 1) / sigma, for sorted x of each row.

    With b = -k / sigma the likelihood is profiled to one number. Its mean under a weak prior is a sum over
    a few quantiles of that prior. The shape is shrunk towards 0.5 as if by ten more observations.

    Source: Zhang, Stephens, A new and efficient estimation method for the generalized Pareto
    distribution, Technometrics 51 (2009); the last step from Vehtari and others (2024).
    """
    n = len(x)
    m = 30 + int(np.sqrt(n))
    steps = 1 - np.sqrt(m / (np.arange(1, m + 1) - 0.5))
    b = 1 / x[-1] + steps[:, None] / (3 * x[int(n / 4 + 0.5) - 1])
    k = np.log1p(-b[:, None] * x).mean(1)
    profile = n * (np.log(-b / k) - k - 1)
    weight = np.exp(profile - logsumexp(profile, axis=0))
    b = (b * weight).sum(0)
    k = np.log1p(-b * x).mean(0)
    return (n * k + 5) / (n + 10), -k / b
