"""The posterior of linear weights: independent draws, each projected onto the models there can be."""

import time

import jax
import numpy as np

from ..linear._composition_fit import CompositionFit
from ..linear._preisach_fit import LinearFit
from ..linear._preisach_unknowns import TOTALS
from ..results._fit_result import FitResult
from ._chains import Progress
from ._posterior import Posterior, summary_of

MOST = 200
"""Draws of each ensemble: independent ones, each a quadratic problem."""


def sample_weights(
    fit: FitResult, steps: int, ensembles: int, seed: int, tell: Progress, begin: float
) -> Posterior:
    """Independent draws of linear unknowns, see `LinearFit.draws`; sigma from its own posterior."""
    linear: LinearFit | CompositionFit
    if "linear" in fit.internals:
        grid: LinearFit = fit.internals["linear"]
        linear, sums, model = grid, TOTALS, grid.meaning.model
    else:
        composed: CompositionFit = fit.internals["composition"]
        linear, sums = composed, composed.meaning.total_names
        model = jax.vmap(composed.meaning.model)
    draws = min(steps, MOST)
    found = [
        linear.draws(
            fit.noise,
            draws,
            np.random.default_rng([seed, k]),
            lambda d, k=k: tell(k * draws + d, ensembles * draws, f"ensemble {k + 1}"),
        )
        for k in range(ensembles)
    ]
    unknowns = np.concatenate(found)
    totals = unknowns @ linear.meaning.totals.T * linear.meaning.scale
    effective = max(fit.noise.effective, 2.0)
    random = np.random.default_rng([seed, ensembles])
    sigma = fit.noise.sigma * np.sqrt(effective / random.chisquare(effective, (len(unknowns), 1)))
    values = np.hstack([totals, sigma]).reshape(ensembles, draws, -1)
    names = (*sums, "sigma")
    summaries = tuple(
        summary_of(name, values[..., j], float(ensembles * draws)) for j, name in enumerate(names)
    )
    return Posterior(
        names, values, model(unknowns), summaries,
        f"projected Gaussian, {ensembles} x {draws} independent draws",
        1.0, float("nan"), time.perf_counter() - begin,
    )  # fmt: skip
