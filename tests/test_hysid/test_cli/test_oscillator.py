"""The road of an oscillator on the command line: fit, predict, report, export."""

import numpy as np
import pytest

import compensate
from benchmarks._dynamics.plants import RATE, training
from tests.test_hysid.command import read, refused, run, write

COLUMNS = ("--input", "force (N)", "--output", "displacement (m)", "--time", "time (s)")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("oscillator")
    u, y = training(3, samples=1024, periods=3)
    t = np.arange(len(u)) / RATE
    write(place / "train.csv", {"time (s)": t, "force (N)": u, "displacement (m)": y})
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
    rows = read(steady["file"])
    assert len(rows) == 3 * 1024
    assert "predicted displacement (m)" in rows[0]
    drawn = run("sample", out, "--steps", 20, "--ensembles", 2, "--walkers", 14, "--json").json()
    assert {p["name"] for p in drawn["parameters"]} > {p["name"] for p in found["parameters"]}
    assert run("report", out).code == 0
    page = (out / "report.html").read_text()
    assert "Frequency response" in page
    assert "Hysteretic force" in page
    assert "draws by emcee" in page
    plan = run("design", out, "--json").json()
    assert len(plan["multisines"]) > 4
    assert len(read(plan["file"])) == 1024
    assert "hysteresis" in run("design", out).out
    assert run("export", out, "--c", out / "plant.h", "--runtime", out / "plant.json").code == 0
    limited = run("export", out, "--c", out / "plant.h", "--limits", 0, 1)
    refused(limited, "--limits has no effect on an oscillator", "[bad-option]")
    made = run("export", out, "--to", "arduino", out / "plant", "--json").json()
    sensor = compensate.runtime.load(out / "plant" / "hysid-export.json")
    assert type(sensor).__name__ == "Compensator"
    assert (sensor.reading["unit"], sensor.estimate["unit"]) == ("N", "m")
    assert made["start"] == "known"
    assert "not-invertible" in run("predict", out, folder / "train.csv", "--inverse").err


@pytest.mark.thorough
def test_steady_is_for_what_has_a_mass(folder):
    out = folder / "line"
    line = (*COLUMNS, "--model", "LinearSponge", "--out", out)
    assert run("fit", folder / "train.csv", *line).code == 0
    refused(run("predict", out, folder / "train.csv", "--steady"), "bad-option")
    refused(run("design", out), "no-design")
