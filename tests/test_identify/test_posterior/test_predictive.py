"""Predictive bands, their coverage, and profiles of the likelihood."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from identify import LEVELS, predictive, profile
from identify.internal import profiles
from identify.noise._model import NoiseModel
from tests.refusals import refuses
from tests.test_identify.lines import THRESHOLD, line, pressed


@pytest.mark.thorough
def test_bands_hold_as_many_new_readings_as_they_say() -> None:
    """Held-out cycles of 10 lines: 10 x 39 rows, of which those below first contact are noise alone too."""
    inside, effective = [], []
    for seed in range(10):
        found = predictive(line(*pressed(1.5, 2.0, seed)))
        inside.append(found.coverage)
        effective.append(found.effective)
        assert list(found.cycles) == ["cycle 6"]
        np.testing.assert_array_equal(found.cycles["cycle 6"], found.coverage)
    # sd of a share of 390: 0.025, 0.015 and 0.005; the line's own error is shared by a record's rows,
    # which makes them wider by 1.5. Three of them.
    share = np.mean(inside, 0)
    np.testing.assert_allclose(share, LEVELS, atol=3 * 1.5 * 0.025)
    assert abs(share[1] - 0.9) < 3 * 1.5 * 0.015
    assert abs(share[2] - 0.99) < 3 * 1.5 * 0.005
    # White residuals: most rows are facts of their own.
    assert np.mean(effective) > 20


def test_bands_widen_with_noise_that_grows_and_lie_inside_each_other() -> None:
    fit = line(*pressed(1.5, 2.0, 0, noise=0.02))
    more = 1 + 0.05 * np.random.default_rng(1).normal(size=len(fit.train))
    grown = line(replace(fit.train, output=fit.train.output * more), fit.test)
    found = predictive(replace(grown, noise_model=NoiseModel(0.1, growth=0.05)))
    for inner, outer in ((0, 1), (1, 2)):
        assert (found.low[outer] < found.low[inner]).all()
        assert (found.high[inner] < found.high[outer]).all()
        assert (found.clean_low[outer] <= found.clean_low[inner]).all()
    assert (found.low[1] < found.clean_low[1]).all()
    width = found.high[1] - found.low[1]
    assert np.corrcoef(width, found.middle)[0, 1] > 0.9


def test_rows_that_were_not_fitted_err_as_held_out_parts_do() -> None:
    fit = line(*pressed(1.5, 2.0, 0))
    off = replace(fit, blocks=np.full(10, 3.0**2))
    found = predictive(off)
    # Ten blocks of one part count as two facts. Of the 3 noise and the line's error are known: 1 to 2 %.
    half = (found.high[1] - found.low[1]) / 2
    np.testing.assert_allclose(half, scipy.stats.t.ppf(0.95, 2) * 3.0, rtol=0.02)
    for name in ("low", "high"):
        own, same = (getattr(predictive(one, fit.train), name) for one in (off, fit))
        np.testing.assert_array_equal(own, same)


def test_coverage_is_said_with_what_it_is_worth() -> None:
    fit = line(*pressed(1.5, 2.0, 0))
    found = predictive(fit)
    assert "The 90 % band holds" in found.said
    assert "held-out rows, which count as" in found.said
    assert "would be no surprise" in found.said
    assert "These rows were fitted" in predictive(replace(fit, test=None)).said
    # A held-out cycle that lies elsewhere.
    off = predictive(replace(fit, test=replace(fit.test, output=fit.test.output + 2.0)))
    assert "too narrow" in off.said
    assert off.coverage[1] == pytest.approx(0.0, abs=0.1)


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
            name, low, _, high, *_ = found.said.replace(":", "").split()
            assert name == found.name
            assert [float(low), float(high)] == pytest.approx(
                [found.low, found.high], abs=half / 50
            )
    assert [p.name for p in profiles(line(train, test))] == ["K", "b"]


def test_a_parameter_that_is_not_free_has_no_profile() -> None:
    fitted = line(*pressed(1.5, 2.0, 0))
    refuses("unknown-parameter", lambda: profile(fitted, "threshold"))
