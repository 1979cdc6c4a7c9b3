"""Moduli over frequency on the command line: init, fit, check, predict, report and a material card."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hysid
from hysteresis import GeneralizedMaxwell
from tests.test_hysid.command import refused, run, write
from tests.thorough import rest_thorough

TRUTH = GeneralizedMaxwell(2.0, [30.0, 12.0], [0.05, 4.0])
F = np.geomspace(0.01, 100.0, 30)


def moduli(a: float = 1.0, seed: int = 0) -> np.ndarray:
    y = np.asarray(TRUTH.complex_modulus(2 * np.pi * F * a))
    rng = np.random.default_rng(seed)
    return y * (1 + 1e-3 * (rng.normal(size=len(F)) + 1j * rng.normal(size=len(F))))


pytestmark = pytest.mark.usefixtures("empty_folder")

LOSSES = {
    "G'' (MPa)": lambda y: y.imag,
    "Loss modulus (kPa)": lambda y: 1e3 * y.imag,
    "tan delta": lambda y: y.imag / y.real,
}


@pytest.mark.parametrize("loss", rest_thorough(LOSSES, 1))
def test_from_a_file_to_constants_in_two_commands(loss: str):
    y = moduli()
    write(Path("sweep.csv"), {"Frequency (Hz)": F, "G' (MPa)": y.real, loss: LOSSES[loss](y)})
    found = run("init", "sweep.csv", "--json").json()
    assert found["selection"] == {
        "frequency": "Frequency (Hz)", "output": "G' (MPa)", "loss": loss,
    }  # fmt: skip
    assert "--config" in found["next"]
    for said in (run("init", "sweep.csv", "--overwrite").out, run("check", "sweep.csv").out):
        assert "noise" not in said
        assert "loop " not in said
        assert "4 decades of frequency" in said
    fit = run("fit", "sweep.csv", "--config", "sweep.toml", "--out", "out", "--json").json()
    assert fit["model"] == "GeneralizedMaxwell of order 2"
    said = {p["name"]: p for p in fit["parameters"]}
    for name, value in {"E_inf": 2.0, "E1": 30.0, "tau1": 0.05, "E2": 12.0, "tau2": 4.0}.items():
        assert said[name]["value"] == pytest.approx(value, rel=0.02)
    assert (said["E1"]["unit"], said["tau1"]["unit"]) == ("MPa", "s")
    predicted = run("predict", "out", "sweep.csv", "--json").json()
    assert predicted["rmse"] < 0.1
    assert predicted["flagged"] == 0
    page = Path(run("report", "out", "--json").json()["file"]).read_text()
    assert "Moduli" in page
    assert "E in MPa, tau in s" in page
    assert "no complete cycle" not in page
    assert run("check", "sweep.csv", "--config", "sweep.toml", "--json").json()["decades"] == 4
    card = run("export", "out", "--to", "abaqus", "card.inp", "--shear", "--poisson", 0.49)
    assert card.code == 0
    at_once = float(Path("card.inp").read_text().split("INSTANTANEOUS\n")[1].split(",")[0])
    assert at_once == pytest.approx(44.0 * 2 * 1.49, rel=0.01)
    assert isinstance(hysid.load(Path("out")).model, GeneralizedMaxwell)


def test_a_loss_that_noise_turned_counts_and_cells_without_one_are_told():
    loss = moduli().imag
    loss[0], loss[1] = -0.01, 0.0
    write(Path("sweep.csv"), {"f (Hz)": F, "G' (MPa)": moduli().real, "G'' (MPa)": loss})
    options = {"frequency": "f (Hz)", "output": "G' (MPa)", "loss": "G'' (MPa)"}
    record, _ = hysid.records("sweep.csv", **options)[""]
    assert -0.01 in record.output
    assert len(record) == 2 * len(F) - 1
    assert "cells without one: 1" in record.history[-1].text


@pytest.mark.parametrize("way", [1, -1])
def test_relaxation_at_several_temperatures_in_any_order(way: int):
    t = np.geomspace(0.1, 100.0, 25)[::way]
    parts = [np.asarray(TRUTH.relaxation_modulus(t / a)) for a in (10.0, 1.0)]
    columns = np.tile(t, 2), np.concatenate(parts), np.repeat([10.0, 30.0], len(t))
    write(Path("runs.csv"), dict(zip(("t (s)", "E_relax (MPa)", "T (degC)"), columns, strict=True)))
    assert run("init", "runs.csv", "--json").json()["selection"] == {
        "time": "t (s)", "output": "E_relax (MPa)", "step": 1.0, "condition": ["T (degC)"]
    }  # fmt: skip
    options = ("--config", "runs.toml", "--terms", 2, "--out", "out", "--json")
    fit = run("fit", "runs.csv", *options).json()
    np.testing.assert_allclose(fit["spectrum"]["shifts"]["log_a"], [1.0, 0.0], atol=0.01)
    assert "superposition" in [reason["code"] for reason in fit["verdict"]["reasons"]]
    assert way < 0 or run("report", "out").code == 0
    names = ("t (s)", "E_relax (MPa)", "T (degC)", "Set")
    write(Path("sets.csv"), dict(zip(names, (*columns, np.repeat([1, 2], len(t))), strict=True)))
    found = run("init", "sets.csv", "--json").json()["selection"]
    assert found.get("each") == ("Set" if way == 1 else None)
    assert found.get("condition") == (None if way == 1 else ["T (degC)"])


def test_options_of_a_series():
    y = moduli()
    write(Path("sweep.csv"), {"f (Hz)": F, "E' (MPa)": y.real, "E'' (MPa)": y.imag})
    chosen = (
        "fit", "sweep.csv", "--frequency", "f (Hz)", "--output", "E' (MPa)", "--loss",
        "E'' (MPa)",
    )  # fmt: skip
    fixed = ("--tau", "0.05,4", "--parameter", "E_inf fixed=2", "--out", "a", "--json")
    said = {p["name"]: p for p in run(*chosen, *fixed).json()["parameters"]}
    assert (said["E_inf"]["value"], said["E_inf"]["status"]) == (2.0, "fixed")
    assert (said["tau1"]["status"], said["E1"]["status"]) == ("fixed", "free")
    bounded = ("--terms", 1, "--parameter", "tau bounds=1,2", "--out", "b", "--json")
    said = {p["name"]: p["value"] for p in run(*chosen, *bounded).json()["parameters"]}
    assert 1.0 <= said["tau1"] <= 2.0
    for words in (("--parameter", "E1 prior=normal(1, 2)"), ("--model", "Burgers")):
        refused(run(*chosen, *words), "[bad-option]")


@pytest.mark.parametrize(("options", "code"), [
    (("--input", "f", "--frequency", "f", "--output", "E"), "conflicting-options"),
    (("--input", "f", "--loss", "E", "--output", "g"), "conflicting-options"),
    (("--frequency", "f", "--output", "E", "--loss", "f"), "wrong-unit"),
    (("--input", "f", "--output", "E", "--terms", 3), "bad-option"),
])  # fmt: skip
def test_what_is_refused(options: tuple[Any, ...], code: str):
    write(Path("sweep.csv"), {"f": F, "E": moduli().real, "g": moduli().imag})
    refused(run("fit", "sweep.csv", *options), f"[{code}]")


def test_a_force_over_a_displacement_has_no_card():
    t = np.geomspace(0.01, 100.0, 40)
    write(Path("hold.csv"), {"t (s)": t, "F (N)": np.asarray(TRUTH.relaxation_modulus(t))})
    chosen = ("--step", 1, "--input-unit", "mm", "--time", "t (s)", "--output", "F (N)")
    assert run("fit", "hold.csv", *chosen, "--out", "out").code == 0
    card = ("export", "out", "--to", "abaqus", "card.inp")
    refused(run(*card), "[wrong-unit]")
    x = np.sin(np.arange(60) / 3)
    force = 3 * x + 0.01 * np.cos(7 * t)[np.arange(60) % 40]
    write(Path("line.csv"), {"x (mm)": x, "F (N)": force})
    chosen = ("--input", "x (mm)", "--output", "F (N)", "--model", "LinearSponge")
    assert run("fit", "line.csv", *chosen, "--out", "out", "--overwrite").code == 0
    refused(run(*card), "The stiffness is in N / mm,", "[wrong-unit]")


def test_the_last_part_of_a_sweep_held_out():
    y = moduli()
    write(Path("sweep.csv"), {"f (Hz)": F, "E' (MPa)": y.real, "E'' (MPa)": y.imag})
    chosen = ("--frequency", "f (Hz)", "--output", "E' (MPa)", "--loss", "E'' (MPa)")
    fit = run("fit", "sweep.csv", *chosen, "--test-tail", 0.2, "--out", "out", "--json").json()
    assert fit["metrics"]["test"]["rmse"] < 1.0
