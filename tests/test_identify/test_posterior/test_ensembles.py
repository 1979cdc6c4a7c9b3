"""Ensembles on known densities: their draws and autocorrelation, when they stop, and what R-hat sees."""

from typing import Any

import emcee
import numpy as np
import pytest

from identify.posterior._emcee import autocorrelation_times, sample_ensembles
from identify.posterior._posterior import has_two_modes, rhat
from identify.storage._checkpoint import Checkpoint

KEEPS_NOTHING = Checkpoint(None)


def two_places(points: np.ndarray) -> np.ndarray:
    """Half each at -4 and 4 in the first number, deviation 1."""
    x = points[:, 0]
    return np.logaddexp(-((x - 4) ** 2) / 2, -((x + 4) ** 2) / 2) - points[:, 1] ** 2 / 2


def draw(density, steps=None, most=20_000, scale=1.0, seed=0, progress=lambda *_: None) -> Any:
    first = scale * np.random.default_rng(seed).normal(size=(4, 12, 2)) * [1.0, 10.0]
    place, root = np.array([3.0, 0.0]), np.diag([1.0, 8.0])  # roughly, and of two places one
    return sample_ensembles(density, first, place, root, seed, steps, most, KEEPS_NOTHING, progress)


def test_autocorrelation_times_are_emcees() -> None:
    x = np.random.default_rng(0).normal(size=(2, 3000, 5, 2))
    for k in range(1, 3000):
        x[:, k] += [0.5, 0.9] * x[:, k - 1]
    found = autocorrelation_times(x)
    for ensemble, tau in zip(x, found, strict=True):
        exact = emcee.autocorr.integrated_time(ensemble, tol=0)
        np.testing.assert_allclose(tau, exact, rtol=1e-10)
    # (1 + a) / (1 - a); 15,000 numbers tell 19 to a tenth.
    np.testing.assert_allclose(found.mean(0), [3, 19], rtol=0.15)
    x[0, :, 2] = 1.0
    assert (autocorrelation_times(x)[0] == 3000).all()  # a walker that does not move


def test_two_modes_are_seen_whether_walkers_change_between_them_or_not() -> None:
    chains = draw(two_places, steps=600, scale=3.0)
    assert has_two_modes(chains.points[..., 0].ravel(), 1000.0)
    assert not has_two_modes(chains.points[..., 1].ravel(), 1000.0)
    # A tenth of the steps leads from one to the other.
    inside = (chains.points[..., 0] > 0).mean(axis=(1, 2))
    np.testing.assert_allclose(inside, 0.5, atol=0.15)
    stuck = np.random.default_rng(0).normal(size=(4, 500)) + np.array([[-9], [-9], [9], [9]])
    assert has_two_modes(stuck.ravel(), 200.0)


def test_rhat_tells_ensembles_that_disagree() -> None:
    same = np.random.default_rng(0).normal(size=(4, 2000))
    # sd of R-hat for independent draws is about 1 / draws.
    assert rhat(same) < 1.005
    assert rhat(same + np.arange(4)[:, None] * 0.5) > 1.05
    assert rhat(same * (1 + np.arange(4)[:, None])) > 1.05  # only the folded ranks see this
    assert rhat(np.ones((4, 20))) == np.inf


@pytest.mark.parametrize("memory", [-0.3, 0.0, 0.8])
def test_rhat_is_arvizs(memory: float) -> None:
    import arviz  # for two seconds

    x = np.random.default_rng(0).normal(size=(4, 501))
    for k in range(1, 501):
        x[:, k] += memory * x[:, k - 1]
    assert rhat(x) == pytest.approx(float(arviz.rhat(x)), rel=1e-12)
