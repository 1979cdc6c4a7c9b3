"""Predictive bands: exact quantiles, and the coverage that they promise."""

from dataclasses import replace

import numpy as np
import pytest

from identify import LEVELS, predictive
from identify.noise._model import NoiseModel
from tests.test_identify.lines import line, pressed


@pytest.mark.thorough
def test_bands_hold_as_many_new_readings_as_they_say() -> None:
    """Held-out cycles of 10 lines: 10 x 39 rows, of which those below first contact are noise alone too."""
    inside, effective = [], []
    for seed in range(10):
        fit = line(*pressed(1.5, 2.0, seed))
        found = predictive(fit)
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
    train = replace(fit.train, output=fit.train.output * more)
    grown = line(train, fit.test)
    found = predictive(replace(grown, noise_model=NoiseModel(0.1, growth=0.05)))
    for inner, outer in ((0, 1), (1, 2)):
        assert (found.low[outer] < found.low[inner]).all()
        assert (found.high[inner] < found.high[outer]).all()
        assert (found.clean_low[outer] <= found.clean_low[inner]).all()
    assert (found.low[1] < found.clean_low[1]).all()
    width = found.high[1] - found.low[1]
    assert np.corrcoef(width, found.middle)[0, 1] > 0.9


def test_coverage_is_said_with_what_it_is_worth() -> None:
    fit = line(*pressed(1.5, 2.0, 0))
    found = predictive(fit)
    assert "The 90 % band holds" in found.said
    assert "held-out rows, which count as" in found.said
    assert "would be no surprise" in found.said
    assert "These rows were fitted" in predictive(replace(fit, test=None)).said
    # A held-out cycle that lies elsewhere.
    moved = replace(fit.test, output=fit.test.output + 2.0)
    off = predictive(replace(fit, test=moved))
    assert "too narrow" in off.said
    assert off.coverage[1] == pytest.approx(0.0, abs=0.1)
