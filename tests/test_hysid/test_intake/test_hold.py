"""Creep and relaxation in a file that shows the way there: --hold."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hysteresis import GeneralizedMaxwell
from tests.test_hysid.command import F, T, X, put, refused, run, sponge, text

TRUTH = GeneralizedMaxwell(0.5, [1.0, 4.0], [2.0, 40.0])
RAMP, HELD, DT, MM = 1.0, 120.0, 0.2, 5.0
SELECTED = ("--input", X, "--output", F, "--time", T, "--hold")


def relaxing(factor: float = 1.0, released: bool = False) -> list[list[str]]:
    """Cells of a ramp of a second and a hold of two minutes, and the way back if `released`."""
    t = np.arange(0.0, RAMP + HELD + DT / 2, DT)
    u = MM * np.minimum(t / RAMP, 1.0)
    if released:
        t = np.append(t, t[-1] + DT * np.arange(1, 21))
        u = np.append(u, MM * (1 - np.arange(1, 21) / 20))
    y = factor * np.asarray(TRUTH.simulate(t, u))
    y = y + 0.002 * np.random.default_rng(0).normal(size=len(y))
    return [[f"{a:.1f}", f"{b:.3f}", f"{c:.5f}"] for a, b, c in zip(t, u, y, strict=True)]


pytestmark = pytest.mark.usefixtures("empty_folder")


def numbers(fit: dict[str, Any]) -> dict[str, float]:
    return {p["name"]: p["value"] for p in fit["parameters"]}


def test_init_sees_the_hold_and_the_fit_its_time_constants():
    found = run("init", put(text(relaxing(), (T, X, F))), "--json").json()
    assert found["selection"] == {
        "input": X, "output": F, "time": T, "hold": True, "test_tail": 0.2
    }  # fmt: skip
    assert "[parameters]" not in Path("run.toml").read_text("utf-8")  # a spectrum has none to give
    fit = run("fit", "run.csv", "--config", "run.toml", "--out", "out", "--json").json()
    assert fit["model"] == "GeneralizedMaxwell of order 2"
    said = numbers(fit)
    # The ramp of 1 s is in the model: the strengths are those of a step.
    assert [said["tau1"], said["tau2"]] == pytest.approx([2.0, 40.0], rel=0.05)
    assert [said[name] for name in ("E1", "E2", "E_inf")] == pytest.approx(
        [1.0, 4.0, 0.5], rel=0.02
    )
    (note,) = (line for line in fit["data"]["history"] if "is held at" in line)
    assert "held at 5 from line 7 on: 601 rows. Time counts from there." in note
    (note,) = (line for line in fit["data"]["history"] if "way to the hold" in line)
    assert note.endswith("took 1 s: it drives the model, and its 5 rows are not fitted.")
    said = run("predict", "out", "run.csv", "--json").json()
    assert said["rows"] == 606
    # The model rises from rest on the way, which was not fitted: the noise is 0.01 % of the range.
    assert said["nrmse_percent"] < 0.03
    assert Path(said["file"]).read_text("utf-8").splitlines()[0].count("since the step") == 1


def test_rows_even_in_log_time_hold_nothing_out():
    """Their last fifth is two of ten decades: no row before it tells of them."""
    t = np.geomspace(1e-3, 1e7, 120)
    rows = [[f"{a:.6g}", f"{100 * a**-0.1:.6g}"] for a in t]
    found = run("init", put(text(rows, ("time (s)", "E_relax (MPa)"))), "--json").json()
    assert not found["selection"].keys() & {"test_tail", "test_cycles", "test_where", "test_lines"}


def test_cycles_are_no_hold():
    assert "hold" not in run("init", put(sponge()), "--json").json()["selection"]
    assert "hold" not in tomllib.loads(Path("run.toml").read_text("utf-8"))["selection"]
    refused(run("check", "run.csv", *SELECTED), "no-hold", "is not constant")


@pytest.mark.parametrize(("options", "code"), [
    (("--step", 5, "--output", F, "--time", T, "--hold"), "no-hold"),
    ((*SELECTED, "--step", 5), "conflicting-options"),
    ((*SELECTED, "--input", T), "no-hold"),
])  # fmt: skip
def test_one_column_is_held(options: tuple[Any, ...], code: str):
    refused(run("check", put(text(relaxing(), (T, X, F))), *options), code)
