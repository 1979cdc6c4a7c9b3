"""A dense spectrum with the smoothness that the evidence prefers, and short series that come from it.

Strengths c >= 0 stand on a log-spaced grid of time constants. Of columns scaled to unit size, second
differences are small before any row is seen, and the spectrum ends at the grid's ends:

    minimise |y - A z|^2 + lambda |D z|^2,  z >= 0.

Given which z are positive that is Gaussian, with the evidence, the noise's size integrated out,

    2 log p = log |lambda D'D| - log |A'A + lambda D'D| - m log(|y - A z|^2 + lambda |D z|^2),

for m rows. Its maximum over lambda is the spectrum. A short series
starts from that: neighbours are merged, each time the two whose merging moves the columns least (Ward),
until so many are left, and all time constants are refined.

Held-out folds, by which `linear/_group_strengths.py` chooses, leave as much of a broad spectrum (0.2 %,
70 rows with 0.5 % of noise), but lambda then differs by 10^4 from noise to noise, in ten times the time.
There evidence is worse: on a knitted sleeve it leaves 12 % of held-out parts, and folds leave 7.7 %.

Source: MacKay, Bayesian interpolation, Neural Computation 4 (1992); Ward, J. Am. Stat. Assoc. 58 (1963);
Honerkamp and Weese, Rheologica Acta 32 (1993), for regularised spectra.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._levels import SOME_ROWS
from ..linear._nnls import SignedMinimum
from ._prony_series import Fitted, Problem, Times, to_unit

A_DECADE = 4
"""Time constants in a decade: one between two differs from a mixture of them by 1 %."""
SMOOTHNESS = tuple(10.0 ** np.arange(-10, 2, 0.5))
"""Values of lambda that are tried, over the square of a column's size."""


def dense_spectrum(problem: Problem, low: float, high: float) -> Fitted:
    """The spectrum of the greatest evidence, its log time constants from `low` to `high`."""
    decades = (high - low) / np.log(10)
    grid = np.linspace(low, high, 2 + int(np.ceil(A_DECADE * decades)))
    return smoothed(problem, grid).fitted


class Smoothed(NamedTuple):
    """Twice the logarithm of the evidence, the lambda that has it, and the spectrum."""

    evidence: float
    strength: float
    fitted: Fitted


def smoothed(problem: Problem, log_tau: Times, strengths: Sequence[float] = SMOOTHNESS) -> Smoothed:
    """The spectrum on one grid, with the lambda of those given that has the greatest evidence."""
    A, size = to_unit(problem.columns(log_tau))
    y, first, n = problem.target, len(problem.free), len(size)
    D = np.zeros((n, n))
    D[first:, first:] = 2 * np.eye(n - first) - np.eye(n - first, k=1) - np.eye(n - first, k=-1)
    G, b, R = A.T @ A, A.T @ y, D.T @ D
    free = np.append(problem.free, np.zeros(len(log_tau), bool))
    last = None
    best: tuple[float, float, float, np.ndarray, np.ndarray] | None = None
    for strength in strengths:
        # Neighbouring columns are alike: a weak prior keeps the factors.
        H = G + strength * R + 1e-13 * np.eye(n)
        z = SignedMinimum(H, free).of(b, last)
        at = np.flatnonzero(z)
        residuals = A @ z - y
        last = z != 0
        branches = at[at >= first]
        prior = np.linalg.slogdet(strength * R[np.ix_(branches, branches)])[1]
        square = max(residuals @ residuals + strength * z @ R @ z, 1e-16 * (y @ y))
        inner = H[np.ix_(at, at)]
        evidence = prior - np.linalg.slogdet(inner)[1] - len(y) * np.log(square)
        if best is None or evidence > best[0]:
            parameters = float(np.trace(np.linalg.solve(inner, G[np.ix_(at, at)])))
            best = evidence, strength, parameters, z, strength * R * np.outer(size, size)
    assert best is not None
    evidence, strength, parameters, z, prior = best
    there = (z != 0) | (np.arange(n) < first)
    found = problem.answer(
        log_tau[there[first:]], (z / size)[there], A @ z - y,
        times_known=True, prior=prior[np.ix_(there, there)], effective=parameters,
    )  # fmt: skip
    return Smoothed(evidence, strength, found)


def short_series(
    problem: Problem, dense: Fitted, counts: Iterable[int], bounds: tuple[float, float]
) -> dict[int, Fitted]:
    """The best series of so many time constants, by their number: `counts` fall."""
    found: dict[int, Fitted] = {}
    # The search looks at some rows of a unit step; the rest refine the times.
    few, more = problem.thinned(SOME_ROWS), dense
    for count in counts:
        starts = {tuple(_merged(few, one, count)) for one in (dense, more)}
        tries = [few.fit(np.array(start), bounds) for start in starts]
        best = min(tries, key=lambda fitted: fitted.mean_square)
        if few is not problem:
            best = problem.fit(best.log_tau, bounds, most=4)
        found[count] = more = _without_idle(best)
    return found


def _without_idle(fitted: Fitted) -> Fitted:
    """Without the time constants that came out with no strength."""
    first = fitted.memoryless
    there = (fitted.strengths != 0) | (np.arange(len(fitted.strengths)) < first)
    return fitted._replace(
        log_tau=fitted.log_tau[there[first:]],
        strengths=fitted.strengths[there],
        known=fitted.known[there],
    )


def _merged(problem: Problem, fitted: Fitted, count: int) -> Float[np.ndarray, " count"]:
    """Ward's merging of neighbours, weighed by what they are in the rows, until `count` are left."""
    weight = fitted.strengths[fitted.memoryless :]
    weight = weight * np.linalg.norm(problem.columns(fitted.log_tau), axis=0)[fitted.memoryless :]
    x, weight = fitted.log_tau[weight > 0], weight[weight > 0]
    while len(x) > max(count, 1):
        both = weight[1:] + weight[:-1]
        k = int(np.argmin(weight[1:] * weight[:-1] / both * np.diff(x) ** 2))
        joined = (x[k : k + 2] @ weight[k : k + 2]) / both[k]
        x = np.concatenate([x[:k], [joined], x[k + 2 :]])
        weight = np.concatenate([weight[:k], [both[k]], weight[k + 2 :]])
    return x[:count]
