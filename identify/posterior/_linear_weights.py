"""The posterior of linear weights: independent draws, each projected onto the possible models."""

import time

import numpy as np

from ..linear._linear_fit import LinearFit
from ..noise._residual_statistics import Noise
from ._chains import Progress
from ._posterior import Posterior, summary_of

MOST = 200
"""Draws of each ensemble: independent ones, each a quadratic problem."""


def sample_weights(
    linear: LinearFit,
    noise: Noise,
    steps: int,
    ensembles: int,
    seed: int,
    tell: Progress,
    begin: float,
) -> Posterior:
    """Independent draws of linear unknowns, see `LinearFit.draws`; sigma from its own posterior."""
    draws = min(steps, MOST)
    found = [
        linear.draws(
            noise,
            draws,
            np.random.default_rng([seed, k]),
            lambda d, k=k: tell(k * draws + d, ensembles * draws, f"ensemble {k + 1}"),
        )
        for k in range(ensembles)
    ]
    meaning, unknowns = linear.meaning, np.concatenate(found)
    totals = linear.sums_of(unknowns)
    effective = max(noise.effective, 2.0)
    random = np.random.default_rng([seed, ensembles])
    sigma = noise.sigma * np.sqrt(effective / random.chisquare(effective, (len(unknowns), 1)))
    values = np.hstack([totals, sigma]).reshape(ensembles, draws, -1)
    names = (*meaning.total_names, "sigma")
    summaries = tuple(
        summary_of(name, values[..., j], float(ensembles * draws)) for j, name in enumerate(names)
    )
    return Posterior(
        names, values, meaning.model(unknowns), summaries,
        f"projected Gaussian, {ensembles} x {draws} independent draws",
        1.0, float("nan"), time.perf_counter() - begin,
    )  # fmt: skip
