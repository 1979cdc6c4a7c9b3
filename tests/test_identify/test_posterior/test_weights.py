"""Posteriors of weights: marginal likelihood, resumed chains, sums that are kept."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from hysteresis import Preisach, Record, read_csv
from hysteresis.preisach import GridDensity
from hysteresis.rigs import SpongeRig
from identify import FitResult, fit, predictive, sample
from identify.posterior._weights_evidence import WeightsEvidence, basis_of, neighbour_sums

SEQUENCES = [slice(0, 30), slice(30, 31), slice(31, 80)]


def correlations(phi: float) -> np.ndarray:
    runs = [scipy.linalg.toeplitz(phi ** np.arange(s.stop - s.start)) for s in SEQUENCES]
    return np.asarray(scipy.linalg.block_diag(*runs))


def test_the_marginal_likelihood_is_that_of_the_dense_gaussian() -> None:
    """Differences between points, because the offset's flat prior leaves a constant open."""
    random, place = np.random.default_rng(1), np.linspace(0, 1, 80)
    A = np.column_stack([np.ones(80), *(np.cos(k * np.pi * place) for k in range(1, 9))])
    K = np.diag([1e-9, *np.arange(1.0, 9.0) ** 2])
    y = A @ random.normal(size=9) * 0.1 + 0.05 * random.normal(size=80)
    basis = basis_of(A.T @ A / 80, K)
    assert basis.known == 9
    rows = np.column_stack([A @ basis.directions, y])
    left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    evidence = WeightsEvidence(*(neighbour_sums([x], SEQUENCES) for x in (rows, left[:, None])))
    aside = [[0.0, 0, 0], [0.2, 0.3, 0.5], [-0.2, -0.2, -1], [0, 0.37, 2]]
    points = evidence.place + np.array(aside)
    found = evidence(points)

    def dense(point: np.ndarray) -> float:
        sigma, phi, strength = evidence.in_units(point, 1.0)
        prior = np.linalg.inv(K[1:, 1:]) / (80 * strength)
        whole = correlations(phi) + A[:, 1:] @ prior @ A[:, 1:].T
        # The offset is flat: generalised least squares, and half a log of its information.
        solved = np.linalg.solve(whole, np.column_stack([np.ones(80), y]))
        information, left = (
            solved[:, 0].sum(),
            y @ solved[:, 1] - solved[:, 0] @ y * (solved[:, 1].sum() / solved[:, 0].sum()),
        )
        log_det = np.linalg.slogdet(whole)[1]
        likelihood = -0.5 * (
            79 * np.log(sigma**2) + log_det + left / sigma**2 + np.log(information)
        )
        logs = np.log(sigma) ** 2 + np.log(strength / 1e-3) ** 2
        return likelihood - logs / (2 * np.log(1e3) ** 2) + np.log(1 - phi**2)

    wanted = np.array([dense(point) for point in points])
    np.testing.assert_allclose(found - found[0], wanted - wanted[0], rtol=0, atol=2e-3)


@pytest.fixture(scope="module")
def grid_fit() -> FitResult:
    cycles = SpongeRig().five_cycles(noise=0.05, seed=0)
    record = Record.from_arrays(cycles.force, cycles.displacement, cycles.time, input_unit="N")
    eight = Preisach(GridDensity(0.0, 20.0, np.tri(8)), np.ones(8))
    return fit(record, eight, test_cycles=1, seed=0)


def test_the_models_drawn_keep_their_signs_and_the_sums(grid_fit) -> None:
    drawn = sample(grid_fit, seed=3, ensembles=2)
    assert drawn.converged
    assert type(grid_fit.detail).__name__ == "GridWeights"
    meaning = grid_fit.detail.linear.meaning
    assert drawn.names == (*meaning.total_names, "sigma", "phi", "prior.strength")
    weights = np.asarray(drawn.model.density.weights)
    assert weights.min() >= 0
    n = weights.shape[-1]
    i, j = np.indices((n, n))
    apart = 2 * np.where(i == j, 1 / 3, i - j) / n
    width = np.where(i >= j, weights * apart, 0.0).sum((1, 2))
    sums = dict(zip(drawn.names, drawn.draws.reshape(-1, 6).T, strict=True))
    np.testing.assert_allclose(width, sums["loop.width"], rtol=1e-6)
    # The middle and the rise are those of the fit, within the error that both say.
    for summary, parameter in zip(drawn.summaries, grid_fit.parameters, strict=False):
        if parameter.stderr is not None:
            assert abs(summary.mean - parameter.value) < 3 * parameter.stderr
    assert 0.03 < sums["sigma"].mean() < 0.08  # of 0.05, from 80 rows


@pytest.mark.thorough
def test_draws_are_about_the_fit_where_signs_and_sums_disagree() -> None:
    """A sponge that relaxes for longer than it was measured: without signs its sums would be others."""
    file = Path(__file__).parents[3] / "datasets" / "sponge-50mm-mixed-cycles.csv"
    record = read_csv(file, input="force (N)", output="displacement (mm)", time="time (s)")
    found = fit(record, "Composition", test_cycles=3, seed=0)
    bands = predictive(found, found.train, sample(found, steps=20, seed=0))
    # Draws are about the fit: their median is a small part of what the fit leaves away from it.
    predicted = found.predict(found.train)[bands.rows]
    left, off = bands.measured - predicted, bands.middle - predicted
    assert np.sqrt(np.mean(off**2)) < 0.2 * np.sqrt(np.mean(left**2))
    assert bands.coverage[1] > 0.8
