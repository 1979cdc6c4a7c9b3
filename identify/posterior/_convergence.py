"""Whether chains agree, how many draws they are worth, and whether they know one mode or several."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from .._levels import FEW

# What a sampler hands over, whichever it was.


Progress = Callable[[int, int, str], None]
"""Called now and then with steps done, steps in all as far as they are known, and a few words."""


class Chains(NamedTuple):
    """Draws in the free space after burn-in. Chains are independent; walkers of one are not.

    - `points`, `log_probability`: (chains, steps, walkers, parameters), (chains, steps, walkers).
    - `rhat`, `ess`: of every parameter. `autocorrelation`: the longest, in steps.
    - `thin`: steps between draws worth keeping.
    - `long_enough`: whether the chains hold so many autocorrelation times that those can be believed.
    - `acceptance`: part of the proposals taken; `statistics`: more of it, (chains, ...).
    - `method`, `notes`: what was done, and what to mind, in words.
    """

    points: Float[np.ndarray, "chains steps walkers parameters"]
    log_probability: Float[np.ndarray, "chains steps walkers"]
    rhat: Float[np.ndarray, " parameters"]
    ess: Float[np.ndarray, " parameters"]
    thin: int
    autocorrelation: float
    long_enough: bool
    acceptance: float
    statistics: dict[str, np.ndarray]
    method: str
    notes: tuple[str, ...]

    @property
    def thinned(self) -> Float[np.ndarray, "chains draws parameters"]:
        """The draws worth keeping of each chain, over all its walkers."""
        chains, _, _, parameters = self.points.shape
        return self.points[:, :: self.thin].reshape(chains, -1, parameters)


VALLEY, ASIDE = 0.5, 0.05
"""A valley counts below this part of the lower peak, and with this part of the draws, and `FEW` effective
ones, on either side."""


def rhat(chains: Float[np.ndarray, "chains draws"]) -> float:
    """Rank-normalised split R-hat, a chain being an ensemble, never one of its walkers.

    The larger of that of the draws and of their distances from the median, which sees chains of
    unequal width; infinite where chains do not move.

    Source: Vehtari and others, Rank-normalization, folding, and localization, Bayesian Analysis 2021.
    """
    half = chains.shape[1] // 2
    split = np.concatenate([chains[:, :half], chains[:, -half:]])
    folded = np.abs(split - np.median(split))
    return max(_rhat_of(_normal_scores(split)), _rhat_of(_normal_scores(folded)))


def has_two_modes(draws: Float[np.ndarray, " draws"], effective: float) -> bool:
    """Whether draws of one number lie about more than one place.

    The density is estimated with a Gaussian kernel of Silverman's width,
    0.9 min(sd, interquartile range / 1.34) / effective^(1/5). There are two modes where it falls below half
    of the lower of two peaks, with a twentieth of the draws, and twenty effective ones, on either
    side; so walkers stuck in separate places count too. Modes that part in several numbers at once, but in
    none of them alone, are not seen, and neither is a mode in which no draw is.

    Source: Silverman, Density Estimation for Statistics and Data Analysis, 1986, section 3.4.
    """
    q1, q3 = np.quantile(draws, [0.25, 0.75])
    sd = draws.std()
    width = 0.9 * min(sd, (q3 - q1) / 1.34 or sd) * max(effective, 2.0) ** -0.2
    if not width > 0:
        return False
    cells = int(min(max(np.ptp(draws) / width * 8, 16), 100_000))
    counts, edges = np.histogram(draws, cells)
    sigma = width / (edges[1] - edges[0])
    density = scipy.ndimage.gaussian_filter1d(counts.astype(float), sigma, mode="constant")
    below = np.cumsum(counts) / len(draws)
    lower = np.minimum(
        np.maximum.accumulate(density), np.maximum.accumulate(density[::-1])[::-1]
    )  # of the highest peaks on either side
    aside = max(ASIDE, FEW / effective)
    valleys = (density < VALLEY * lower) & (below > aside) & (below < 1 - aside)
    return bool(valleys.any())


def _normal_scores(chains: np.ndarray) -> np.ndarray:
    _, place, count = np.unique(chains, return_inverse=True, return_counts=True)
    # Equal draws share the mean of their ranks.
    ranks = (np.cumsum(count) - (count - 1) / 2)[place].reshape(chains.shape)
    return scipy.special.ndtri((ranks - 0.375) / (chains.size + 0.25))


def _rhat_of(z: np.ndarray) -> float:
    n = z.shape[1]
    within, between = z.var(axis=1, ddof=1).mean(), n * z.mean(axis=1).var(ddof=1)
    if not within > 0:
        return float("inf")
    return float(np.sqrt(((n - 1) / n * within + between / n) / within))
