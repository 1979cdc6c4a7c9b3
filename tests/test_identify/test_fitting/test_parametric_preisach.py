"""Preisach models with a density of few parameters: started from a grid, fitted, kept and inverted."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hysteresis import Preisach, Record, StandardLinearSolid
from hysteresis.internal import SumDensity
from hysteresis.preisach import GaussianDensity, GridDensity
from identify import FitResult, fit, load, save
from identify.fitting._parametric import INCREMENTS, SHAPES, of_grid

PLACE_AND_WIDTH = ("coercivity", "coercivity_width", "bias", "bias_width")

BELL = GaussianDensity(0.0, 20.0, 3.0, 2.0, 1.0, 9.0, 3.0)
TRUTH = Preisach(BELL, np.linspace(0.5, 1.0, INCREMENTS), 4.0)


def minor_loops() -> np.ndarray:
    turns = [0.0, 20, 0, 16, 2, 12, 4, 20, 8, 14, 6, 20, 0, 18, 3, 10, 5, 20, 0]
    return np.concatenate([np.linspace(a, b, 12)[:-1] for a, b in itertools.pairwise(turns)])


def record_of(truth: Preisach, sign: float = 1.0) -> Record:
    u = minor_loops()
    y = sign * np.asarray(truth.simulate(None, u))
    y += 0.01 * np.random.default_rng(0).normal(size=len(y))
    return Record.from_arrays(u, y, input_unit="N", output_unit="mm")


@pytest.fixture(scope="module")
def fitted() -> FitResult:
    return fit(record_of(TRUTH), "gaussianpreisach", test_tail=0.2, noise="gaussian", starts=1)


@pytest.mark.parametrize("leading", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_starts_have_the_moments_of_the_grid(name: str, leading: bool):
    """Mass and rise of the start are those of the grid, whatever its density is made of."""
    middle = np.arange(40) * 0.5 + 0.25
    alpha, beta = np.meshgrid(middle, middle, indexing="ij")
    h, m = (alpha - beta) / 2, (alpha + beta) / 2
    masses = np.tril(np.exp(-0.5 * ((h - 3) ** 2 + ((m - 9) / 2) ** 2)))
    density = GridDensity(0.0, 20.0, 3 * masses / masses.sum())
    grid = Preisach(density, np.full(40, 0.5), 1.0, leading=leading)
    starts = of_grid(grid, SHAPES[name])
    assert len(starts) == (3 if SHAPES[name].count == 2 else 1)
    for start in starts:
        density: Any = start.density
        parts: Any = density.parts if isinstance(density, SumDensity) else [density]
        assert sum(float(part.total) for part in parts) == pytest.approx(3, rel=0.01)
        assert start.leading is leading
        assert np.sum(np.asarray(start.reversible)) == pytest.approx(20, rel=0.01)
        if name == "GaussianPreisach":
            found = [getattr(density, each) for each in PLACE_AND_WIDTH]
            np.testing.assert_allclose(found, (3, 1, 9, 2), rtol=0.05)


def test_the_density_of_a_record_is_found(fitted: FitResult):
    assert fitted.success
    assert type(fitted.detail).__name__ == "Parametric"
    assert fitted.name == "GaussianPreisach"
    assert isinstance(fitted.model, Preisach)
    density = fitted.model.density
    for name in PLACE_AND_WIDTH:
        (found,) = (p for p in fitted.parameters if p.name == f"density.{name}")
        assert abs(found.value - getattr(TRUTH.density, name)) < 4 * found.stderr
        assert float(getattr(density, name)) == found.value
    assert fitted.metrics["test"].nrmse_percent < 0.2


def test_it_is_kept(fitted: FitResult, tmp_path: Path):
    again, u = load(save(fitted, tmp_path / "fit")), minor_loops()
    y = np.asarray(again.model.simulate(None, u))
    np.testing.assert_array_equal(y, fitted.model.simulate(None, u))


@pytest.mark.thorough
def test_a_parameter_that_ran_to_its_bound_under_a_misfit_is_no_constant() -> None:
    """The foam creeps a little, which relays cannot: their coercivity goes to 0 to make room."""
    sizes = [0, 1, 0.1, 0.85, 0.25, 0.7, 0.4, 0.6, 0.3, 0.9, 0, 1, 0, 1]
    u = 20 * np.interp(np.linspace(0, 13, 260), np.arange(14), sizes)
    truth = Preisach(GaussianDensity(0.0, 20.0, 3.0, 1.09, 0.5, 9.0, 4.0), np.full(8, 1.5))
    creep = StandardLinearSolid(1e9, 10.0, 300.0).simulate(np.arange(260.0), u)
    y = np.asarray(truth.simulate(None, u)) + np.asarray(creep)
    y = y + np.random.default_rng(0).normal(0, 0.03, len(u))
    found = fit(Record.from_arrays(u, y), "GaussianPreisach", purpose="constants", starts=1)
    told = {p.name: p for p in found.parameters}
    assert told["density.coercivity"].status == "at bound"
    assert found.verdict.level != "PASS"
    assert {"at-bound", "model-error"} <= set(found.verdict.codes)
