"""Sums of a grid Preisach: what a record determines has an honest error."""

import numpy as np

from benchmarks._identification.sums import noisy, truth
from identify import fit


def test_under_noise_no_sum_is_far_from_the_truth():
    """Of two truths that no grid can be, with 1 % of AR(1) noise; six intervals: one of 3.3 standard errors
    has a chance of 1 per cent."""
    for seed in range(2):
        one, random = truth(np.random.default_rng(seed), side=50, each=12), np.random.default_rng(9)
        noisy(one, 0.0, random, 0.0)  # the same draws as of the run without noise
        found = fit(noisy(one, 0.7, random), "Preisach")
        for p in found.parameters:
            if p.stderr is not None:
                assert abs(p.value - one.sums[p.name]) < 3.3 * p.stderr
                assert p.stderr < 0.02 * one.sums["output.rise"]
        assert found.covariance.shape == (3, 3)
