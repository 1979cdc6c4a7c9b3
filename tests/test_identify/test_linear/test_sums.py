"""Sums of a grid Preisach: what a record determines has an honest error, what it does not has a range."""

import numpy as np
import pytest

from benchmarks._identification.sums import noisy, truth
from identify import FitResult, fit
from identify.linear._preisach_unknowns import SUMS, GridUnknowns
from identify.linear._unknown_vectors import in_units
from identify.noise._correlated_noise import noise_behind


def ar1(phi: float, rows: int, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=rows)
    for k in range(1, rows):
        noise[k] = phi * noise[k - 1] + np.sqrt(1 - phi**2) * noise[k]
    return noise


def test_the_noise_is_found_behind_residuals_that_a_fit_has_smoothed() -> None:
    """600 rows, 60 smooth columns: residuals lose a fifth of the size and look less correlated."""
    rows, phi = 600, 0.7
    place = np.arange(rows) / rows
    Q, _ = np.linalg.qr(np.cos(np.pi * np.arange(60) * place[:, None]))
    noise = 2.0 * ar1(phi, rows, seed=3)
    residuals = noise - Q @ (Q.T @ noise)
    assert np.corrcoef(residuals[1:], residuals[:-1])[0, 1] < 0.55
    found = noise_behind(residuals, lambda e: e - Q @ (Q.T @ e), [slice(0, rows)])
    # Of 600 rows: phi is known to 0.04, sigma to 7 per cent.
    assert found.phi == pytest.approx(phi, abs=0.09)
    assert found.sigma == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize(("leading", "scale"), [(False, 2.0), (True, 2.0), (False, -2.0)])
def test_the_sums_are_what_the_model_does_between_its_ends(leading: bool, scale: float) -> None:
    """Lagging, leading, and an output that falls."""
    meaning = GridUnknowns(6, -1.0, 3.0, leading, "negative", scale, centre=7.0)
    x = np.random.default_rng(1).uniform(size=meaning.count)
    x[1:7] += 20.0  # slacks that keep a leading model from falling
    model = meaning.model(x)
    u = np.interp(np.linspace(0, 2, 4001), [0, 1, 2], [-1.0, 3.0, -1.0])
    y = np.asarray(model.simulate(None, u))
    up, down = y[:2001], y[:1999:-1]
    z = in_units(meaning, x)
    found = dict(zip(SUMS, meaning.totals @ z, strict=True))
    assert found["output.middle"] == pytest.approx((up[-1] + up[0]) / 2, abs=1e-9)
    assert found["output.rise"] == pytest.approx(up[-1] - up[0], abs=1e-9)
    # 2,000 steps; the loop is closed at both ends.
    assert found["loop.width"] == pytest.approx(np.abs(np.mean((down - up)[1:])), rel=1e-4)
    offset, rise, mass = meaning.shares @ z
    assert offset == pytest.approx(7.0 + x[0] * meaning.scale)
    assert found["output.rise"] == pytest.approx(rise + (-2 if leading else 2) * mass)


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
