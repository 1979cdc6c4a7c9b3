"""Creep and relaxation on the command line: --step instead of --input."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hysid
from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell
from tests.test_hysid.command import read, run, write

CREEP = GeneralizedKelvinVoigt(2.0, [1.0, 4.0], [0.5, 80.0], 500.0)
RELAXING = GeneralizedMaxwell(0.5, [1.0, 4.0], [0.4, 20.0])
SECONDS, X, F = "time (s)", "displacement (mm)", "force (N)"
CREEPS = ("--step", 5, "--input-unit", "N", "--output", X, "--time", SECONDS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Creep twice read at some times, relaxation, and creep of two samples."""
    place, rng = tmp_path_factory.mktemp("step"), np.random.default_rng(0)
    t = np.geomspace(0.02, 200.0, 240)
    noise = 1 + 0.002 * rng.normal(size=(3, len(t)))
    x = 5 * np.asarray(CREEP.creep_compliance(t)) * noise[0]
    twice = np.repeat(np.arange(len(t)), 1 + (np.arange(len(t)) % 5 == 0))
    write(place / "creep.csv", {SECONDS: t[twice], X: x[twice]})
    force = 0.5 * np.asarray(RELAXING.relaxation_modulus(t)) * noise[1]
    write(place / "relaxation.csv", {SECONDS: t, F: force})
    names, both = np.repeat(["soft", "hard"], len(t)), np.append(x, x / 3)
    write(place / "samples.csv", {SECONDS: np.tile(t, 2), X: both, "sample": names})
    write(place / "later.csv", {SECONDS: [100.0, 1000.0, 1010.0]})
    return place


@pytest.fixture(scope="module")
def creep(folder: Path) -> dict[str, Any]:
    out = ("--test-tail", 0.2, "--out", folder / "out")
    return run("fit", folder / "creep.csv", *CREEPS, *out, "--json").json()


def test_fit_writes_what_every_fit_writes(creep: dict[str, Any], folder: Path):
    assert creep["schema"] == 1
    assert creep["model"] == "GeneralizedKelvinVoigt of order 2"
    assert creep["candidates"][0]["model"] == creep["model"]
    assert len(creep["candidates"]) == len(creep["spectrum"]["table"]) > 3
    assert {p["name"] for p in creep["parameters"]} >= {"E0", "E1", "eta1", "E2", "eta2"}
    E1 = next(p for p in creep["parameters"] if p["name"] == "E1")
    assert (E1["unit"], E1["status"]) == ("N / mm", "free")
    assert abs(E1["value"] - 1.0) < 4 * E1["stderr"] < 1.0
    assert creep["metrics"]["train"]["nrmse_percent"] < 1
    assert creep["metrics"]["test"]["rmse"] > 0
    # Every fifth time was read twice: one row each.
    assert creep["data"]["rows"] == 240
    assert any("Averaged 288 rows to 240" in said for said in creep["data"]["history"])
    assert set(creep) > {"verdict", "seed", "versions", "selection"}
    loaded = hysid.load(folder / "out")
    assert isinstance(loaded.model, GeneralizedKelvinVoigt)
    assert loaded.detail.spectrum.order == 2


def test_report_shows_curve_spectrum_and_range(creep: dict[str, Any], folder: Path):
    page = Path(run("report", folder / "out", "--json").json()["file"]).read_text()
    for heading in ("Creep", "Spectrum", "Parameters", "Residuals", "Data"):
        assert f">{heading}</h2>" in page
    assert page.count("<img") == 4
    assert "Predictions of later times" in page
    rows = re.findall(r"<tr>.*?</tr>", page.replace("\n", " "))
    assert any("mm" in row and row.count("<td") == 3 for row in rows)


def test_predict_gives_the_range(creep: dict[str, Any], folder: Path):
    found = run("predict", folder / "out", folder / "creep.csv", "--json").json()
    rows = read(found["file"])
    assert len(rows) == 240
    assert found["nrmse_percent"] < 5
    late = [row for row in rows if row["status"] != "OK"]
    assert found["flagged"] == len(late) == 48
    for row in rows:
        assert float(row["low"]) <= float(row[f"predicted {X}"]) <= float(row["high"])
    inside = [float(row["low"]) <= float(row[X]) <= float(row["high"]) for row in late]
    # Rows have noise, which is not in the range of the curve: near the seam that is as wide.
    assert np.mean(inside) > 0.7


def test_predict_at_times_alone(creep: dict[str, Any], folder: Path):
    """Counted from the step, though they begin late."""
    found = run("predict", folder / "out", folder / "later.csv", "--json").json()
    assert found["rmse"] is None
    first, *rest = read(found["file"])
    for row in (first, *rest):
        truth = 5 * float(CREEP.creep_compliance(float(row["since the step"])))
        assert float(row["low"]) < truth < float(row["high"])
    assert [row["status"] for row in rest] == ["beyond the trained times"] * 2


T = np.arange(1.0, 41.0)
Y = 1 + np.log(T)


@pytest.mark.parametrize(("t", "y", "options", "code"), [
    (T, Y, ("--step", 1, "--input", "y", "--time", "t"), "conflicting-options"),
    (T, Y, ("--time", "t"), "conflicting-options"),
    (T, Y, ("--step", "nan", "--time", "t"), "not-a-step"),
    (T, Y, ("--step", 1), "no-time"),
    (T, Y, ("--step", -1, "--time", "t"), "not-a-step"),
    (np.roll(T, 1), Y, ("--step", 1, "--time", "t"), "time-backwards"),
    (T, Y, ("--step", 1, "--time", "t", "--group", "y"), "not-a-step"),
    (T, Y, ("--step", 1, "--time", "t", "--model", "Burgers"), "bad-option"),
    (T, Y, ("--step", 1, "--time", "t", "--test-cycles", 1), "too-few-cycles"),
])  # fmt: skip
def test_bad_steps_are_answered(tmp_path: Path, t: Any, y: Any, options: Any, code: str):
    file = write(tmp_path / "a.csv", {"t": t, "y": y})
    said = run("fit", file, "--output", "y", *options, "--out", tmp_path / "out")
    assert (said.code, said.out) == (2, "")
    assert f"[{code}]" in said.err
    assert "Traceback" not in said.err
    assert not (tmp_path / "out").exists()
