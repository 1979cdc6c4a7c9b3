"""What a record determines of a grid Preisach: sums with honest errors, and the cells that are told."""

import numpy as np
import pytest

from benchmarks._identification.sums import noisy, truth
from hysteresis import Preisach, Record
from hysteresis.preisach import GridDensity
from identify import design, fit, identifiability
from tests.refusals import refuses


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


CELLS = 8


def record_of(turns: list[float], samples: int = 200) -> Record:
    u = np.interp(np.linspace(0, len(turns) - 1, samples), range(len(turns)), turns)
    return Record.from_arrays(u, u + 0.1 * np.sin(9 * u))


def test_told_is_the_variance_that_data_take_away() -> None:
    """Against many random densities with noise: the share of the variance a linear estimate removes."""
    turns, noise, random = [0.0, 1.0, 0.0, 0.6, 0.2, 1.0, 0.4], 0.002, np.random.default_rng(0)
    record = record_of(turns)
    found = identifiability(record, CELLS, noise=noise)
    used, prior = np.tril_indices(CELLS), 0.5 / (CELLS * (CELLS + 1) / 2)
    model = Preisach(GridDensity(0.0, 1.0, np.zeros((CELLS, CELLS)), signed=True))
    A = np.empty((len(record), len(used[0])))
    for k, (i, j) in enumerate(zip(*used, strict=True)):
        one = np.zeros((CELLS, CELLS))
        one[i, j] = 1.0
        A[:, k] = Preisach(GridDensity(0.0, 1.0, one)).simulate(None, record.input)
    hats = np.array([
        np.clip((record.input - p / CELLS) * CELLS, 0, 1) for p in range(CELLS)
    ]).T  # fmt: skip
    whole = np.hstack([np.ones((len(A), 1)), hats, A])
    scale = np.concatenate([[1.0], np.full(CELLS, 1 / CELLS), np.full(A.shape[1], prior)])
    draws = random.normal(size=(4000, len(scale))) * scale
    seen = draws @ whole.T + random.normal(0, noise, (4000, len(A)))
    # The best linear estimate, from the draws' own known covariances.
    seen_by = (whole * scale**2) @ whole.T + noise**2 * np.eye(len(A))
    gain = np.linalg.solve(seen_by, whole * scale**2)
    left = (draws - seen @ gain)[:, 1 + CELLS :].var(0) / prior**2
    # 4000 draws tell a variance to 2 x 2.2 %.
    np.testing.assert_allclose(found.told[used], 1 - left, atol=0.1)
    assert model.density.low == found.low


def test_a_design_tells_the_rest() -> None:
    record = record_of([0.0, 1.0, 0.0])
    assert identifiability(record, CELLS).share < 0.3  # the diagonal and a bit
    found, used = design(record, CELLS), np.tri(CELLS, dtype=bool)
    assert found.after.told[used].min() >= 0.5
    # The promise is kept by a record that follows the turns.
    u = np.concatenate([record.input, found.input(2 * CELLS)])
    kept = identifiability(Record.from_arrays(u, u + 0.1 * np.sin(9 * u)), CELLS)
    assert kept.told[used].min() >= 0.5
    nodes = found.turns / found.after.high * CELLS
    np.testing.assert_allclose(nodes, np.round(nodes), atol=1e-9)


@pytest.mark.parametrize("keywords", [{"cells": 0}, {"noise": 0.0}, {"noise": float("inf")}])
def test_bad_options(keywords: dict) -> None:
    refuses("bad-option", lambda: identifiability(record_of([0.0, 1.0]), **keywords))
