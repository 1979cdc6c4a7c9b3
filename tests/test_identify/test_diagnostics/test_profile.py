"""Profile likelihoods, against the analytic one of a line and against iminuit's and lmfit's."""

import numpy as np
import pytest
import scipy.stats

from hysteresis import InputError
from identify import profile
from identify.internal import profiles
from tests.test_identify.lines import THRESHOLD, line, pressed


def test_the_profile_of_a_line_is_the_analytic_one() -> None:
    """Sigma at its best: drop = n / 2 log(1 + (K - K^)^2 / (S [(A'A)^-1]_KK)), S the least squares' sum."""
    train, test = pressed(1.5, 2.0, 0)
    rows = train.mask & (train.input >= THRESHOLD)
    A = np.stack([train.input[rows], np.ones(rows.sum())], 1)
    best, (S,), *_ = np.linalg.lstsq(A, train.output[rows], rcond=None)
    # Below the threshold the line is 0, whatever K and b: its rows count in sigma alone.
    S += np.sum(train.output[train.mask & ~rows] ** 2)
    n = train.mask.sum()
    for level in (0.9, 0.99):
        bound = scipy.stats.chi2.ppf(level, 1) / 2
        for k, found in enumerate(profiles(line(train, test), level=level)):
            spread = S * np.linalg.inv(A.T @ A)[k, k]
            half = np.sqrt(spread * np.expm1(2 * bound / n))
            # The root is sought to 1e-7 of a step; the maximum is known to 1e-5 of an error.
            assert found.low == pytest.approx(best[k] - half, abs=1e-5 * half)
            assert found.high == pytest.approx(best[k] + half, abs=1e-5 * half)
            exact = n / 2 * np.log1p((found.values - best[k]) ** 2 / spread)
            np.testing.assert_allclose(found.drop, exact, atol=1e-6)
            assert found.bound == pytest.approx(bound, rel=1e-13)
            assert found.others == ()
            assert found.said.startswith(f"{found.name}: {found.low:.4g} to ")
    assert [p.name for p in profiles(line(train, test))] == ["K", "b"]


def test_a_parameter_that_is_not_free_has_no_profile() -> None:
    fitted = line(*pressed(1.5, 2.0, 0))
    with pytest.raises(InputError, match="unknown-parameter"):
        profile(fitted, "threshold")
