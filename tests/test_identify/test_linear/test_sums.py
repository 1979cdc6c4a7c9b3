"""Sums of a grid Preisach: what a record determines has an honest error, what it does not has a range."""

import numpy as np
import pytest

from benchmarks._identification.sums import noisy, truth
from identify import FitResult, fit


@pytest.fixture(scope="module")
def fits() -> list[tuple[dict[str, float], FitResult, FitResult]]:
    """Two truths that no grid can be, without noise and with 1 % of AR(1) noise."""
    found = []
    for seed in range(2):
        one, random = truth(np.random.default_rng(seed), side=50, each=12), np.random.default_rng(9)
        clean, rough = noisy(one, 0.0, random, 0.0), noisy(one, 0.7, random)
        found.append((one.sums, fit(clean, "Preisach"), fit(rough, "Preisach")))
    return found


def test_under_noise_no_sum_is_far_from_the_truth(fits) -> None:
    """Six intervals: one of 3.3 standard errors has a chance of 1 per cent."""
    for sums, _, rough in fits:
        for p in rough.parameters:
            if p.stderr is not None:
                assert abs(p.value - sums[p.name]) < 3.3 * p.stderr
                assert p.stderr < 0.02 * sums["output.rise"]
        assert rough.covariance.shape == (3, 3)
