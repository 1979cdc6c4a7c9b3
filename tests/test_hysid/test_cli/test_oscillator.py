"""The road of an oscillator on the command line: fit, predict, report, export."""

import csv

import numpy as np
import pytest

from benchmarks._dynamics.plants import RATE, training
from tests.test_hysid.command import run

COLUMNS = ("--input", "force (N)", "--output", "displacement (m)", "--time", "time (s)")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("oscillator")
    u, y = training(3, samples=1024, periods=3)
    with open(place / "train.csv", "w", newline="") as handle:
        writer = csv.writer(handle)
        writer.writerow(["time (s)", "force (N)", "displacement (m)"])
        writer.writerows(zip(np.arange(len(u)) / RATE, u, y, strict=True))
    return place


def test_fit_predict_report_and_export(folder):
    out = folder / "fit"
    found = run(
        "fit", folder / "train.csv", *COLUMNS, "--model", "oscillator(boucwen)", "--period", 1024,
        "--out", out, "--json",
    ).json()  # fmt: skip
    assert found["model"] == "Oscillator(BoucWen)"
    assert found["detail"]["kind"] == "motion"
    assert found["motion"]["period"] == 1024
    assert found["motion"]["chi2"] == pytest.approx(1.0, abs=0.2)
    assert [p["name"] for p in found["parameters"]][:3] == ["mass", "damping", "stiffness"]
    steady = run("predict", out, folder / "train.csv", "--steady", "--json").json()
    assert steady["rmse"] == pytest.approx(8e-6, rel=0.1)
    assert any("steady state" in note for note in steady["notes"])
    rest = run("predict", out, folder / "train.csv", "--json").json()
    assert rest["rmse"] > 2 * steady["rmse"]  # the record does not begin at rest
    with open(steady["file"], newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == 3 * 1024
    assert "predicted displacement (m)" in rows[0]
    assert run("report", out).code == 0
    page = (out / "report.html").read_text()
    assert "Frequency response" in page
    assert "Hysteretic force" in page
    assert run("export", out, "--c", out / "plant.h", "--runtime", out / "plant.json").code == 0
    refused = run("export", out, "--to", "fmu", out / "plant.fmu")
    assert refused.code == 2
    assert "bad-option" in refused.err
    assert "not-invertible" in run("predict", out, folder / "train.csv", "--inverse").err


def test_steady_is_for_what_has_a_mass(folder):
    out = folder / "line"
    assert (
        run("fit", folder / "train.csv", *COLUMNS, "--model", "LinearSponge", "--out", out).code
        == 0
    )
    refused = run("predict", out, folder / "train.csv", "--steady")
    assert refused.code == 2
    assert "bad-option" in refused.err
