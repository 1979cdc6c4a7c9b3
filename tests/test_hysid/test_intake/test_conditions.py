"""A condition on the command line: fitted, predicted between trained values, run backwards, reported."""

from pathlib import Path

import numpy as np
import pytest

import hysid
from compensate import estimate
from compensate.runtime import load
from tests.test_hysid.command import run, text
from tests.test_identify.test_conditions import ROWS, C, U, Y, rig

TRAINED = (280.0, 300.0, 320.0)


def written(file: Path, temperatures: tuple[float, ...], turned: float = 1.0) -> Path:
    columns = rig(temperatures, turned=turned)
    rows = [[f"{value:.9g}" for value in row] for row in zip(*columns.values(), strict=True)]
    file.write_text(text(rows, columns))
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("conditions")
    written(place / "runs.csv", (*TRAINED, 290.0))
    written(place / "warm.csv", (290.0,))
    written(place / "hot.csv", (330.0,))
    return place


@pytest.fixture(scope="module")
def fitted(folder) -> dict:
    """The condition is given as a second input; that it stays in every run tells it."""
    held_out = ("--group", "run", "--test-where", "run=3")
    return run(
        "fit", folder / "runs.csv", "--input", U, "--input", C, "--output", Y, *held_out,
        "--model", "Composition", "--out", folder / "out", "--json",
    ).json()  # fmt: skip


def test_a_condition_between_trained_ones_is_predicted(fitted):
    assert fitted["selection"]["input"] == U
    assert fitted["selection"]["condition"] == [C]
    assert fitted["condition"]["values"] == list(TRAINED)
    assert fitted["condition"]["unit"] == "K"
    assert fitted["metrics"]["test"]["nrmse_percent"] < 4
    assert any(
        said.startswith("'temperature (K)' is constant") for said in fitted["data"]["history"]
    )


def test_a_new_file_of_one_condition_is_predicted_and_run_backwards(folder, fitted):
    found = run("predict", folder / "out", folder / "warm.csv", "--json").json()
    assert found["nrmse_percent"] < 4
    assert found["flagged"] == 0
    assert "between the trained values" in found["notes"][-1]
    back = run("predict", folder / "out", folder / "warm.csv", "--inverse", "--json").json()
    assert back["nrmse_percent"] < 4


def test_a_condition_beyond_the_trained_ones_is_flagged(folder, fitted):
    for options in ((), ("--inverse",)):
        found = run("predict", folder / "out", folder / "hot.csv", *options, "--json").json()
        assert found["flagged"] == found["rows"] == ROWS


@pytest.mark.thorough
def test_the_report_names_the_condition(folder, fitted):
    assert run("report", folder / "out").code == 0
    page = (folder / "out" / "report.html").read_text("utf-8")
    assert "depends on temperature (K)" in page
    assert hysid.load(folder / "out").condition.name == C


def test_the_exported_compensator_takes_the_condition(folder, fitted):
    """As `predict --inverse` does, from a known first state."""
    target = folder / "sensor.json"
    assert run("export", folder / "out", "--runtime", target, "--start", "known").code == 0
    compensator = load(target)
    fresh = hysid.read_csv(folder / "warm.csv", input=U, output=Y, condition=(C,))
    wanted = estimate(hysid.invert(hysid.load(folder / "out")), fresh).value
    pairs = zip(fresh.output.tolist(), fresh.columns[C].tolist(), strict=True)
    found = [compensator.step(0.01, y, c).value for y, c in pairs]
    np.testing.assert_allclose(found, wanted, atol=1e-6 * np.ptp(fresh.input))
