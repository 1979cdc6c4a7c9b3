"""Foam curves and Bouc-Wen models are recovered from far away, and fit measurements."""

import csv
from pathlib import Path

import numpy as np
import pytest

from compensate import Status, invert
from hysteresis import (
    AbstractModel,
    BoucWen,
    FoamCurve,
    Record,
    parameters,
)
from identify import FitResult, fit, load, save

DATASETS = Path(__file__).resolve().parents[3] / "datasets"


def record_of(model: AbstractModel, u: np.ndarray, noise: float) -> Record:
    y = np.asarray(model.simulate(None, u))
    y = y + noise * np.ptp(y) * np.random.default_rng(0).normal(size=len(y))
    return Record.from_arrays(u, y, input_unit="mm", output_unit="N")


def assert_recovered(result: FitResult, truth: AbstractModel) -> None:
    assert result.success
    wanted = {name: float(value) for name, _, value in parameters(truth)}
    for p in result.parameters:
        # Four standard errors, once in 16,000 draws of a parameter.
        assert abs(p.value - wanted[p.name]) <= 4 * p.stderr


def columns(file: Path, *names: str) -> list[np.ndarray]:
    with file.open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    return [np.array([float(row[name]) for row in rows]) for name in names]


@pytest.mark.thorough
def test_foam_curve_is_recovered_from_afar(tmp_path: Path) -> None:
    truth = FoamCurve(1.0, 0.05, 0.2, 1.5, 5.0, 8.0, 0.8, 0.1, 0.3)
    u = np.concatenate([np.linspace(0.0, 22.0, 64), np.linspace(22.0, 0.0, 64)])
    far = FoamCurve(0.2, 0.5, 0.8, 5.0, 1.5, 3.0, 3.0, 0.5)
    result = fit(record_of(truth, u, 0.005), far, noise="gaussian", seed=1, starts=16)
    assert_recovered(result, truth)
    units = {p.name: p.unit for p in result.parameters}
    assert (units["linear"], units["densification"], units["toe"]) == ("N / mm", "1 / mm", "1")
    again = load(save(result, tmp_path / "foam")).model
    np.testing.assert_array_equal(again.simulate(None, u), result.model.simulate(None, u))


@pytest.mark.thorough
def test_bouc_wen_is_recovered_from_afar(tmp_path: Path) -> None:
    truth = BoucWen(10.0, 0.2, 0.5, 1.5, 0.3, 1.0)
    turns = [0, 1, -1, 1.5, -1.5, 2, -2, 1, -0.5, 1.5, 0]
    record = record_of(truth, np.interp(np.linspace(0, 10, 121), range(11), turns), 0.01)
    result = fit(record, BoucWen(40.0, 0.6, 0.1, 3.0, -0.5), noise="gaussian", seed=1, starts=4)
    assert_recovered(result, truth)
    again = load(save(result, tmp_path / "bouc-wen")).model
    u = np.asarray(record.input)
    np.testing.assert_array_equal(again.simulate(None, u), result.model.simulate(None, u))


def test_loading_branch_of_the_virtual_sponge() -> None:
    """Of another law than ours; the first of five cycles is another curve, and left out."""
    displacement, force = columns(
        DATASETS / "sponge-50mm-cycles.csv", "displacement (mm)", "force (N)"
    )
    record = Record.from_arrays(displacement, force, input_unit="mm", output_unit="N")
    loading = record.select(branch="loading")
    result = fit(loading, "FoamCurve", noise="gaussian", starts=6)
    assert result.metrics["train"] is not None
    assert result.metrics["train"].nrmse_percent < 0.5
    found = invert(result.model).simulate(None, force)
    assert np.all(found.status == Status.OK)
