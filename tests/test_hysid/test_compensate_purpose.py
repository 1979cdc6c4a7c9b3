"""A verdict for compensation: the compensator is tried, and a straight line that is better fails it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hysid
from compensate import estimate, invert
from hysteresis import LinearSponge, Record
from hysteresis.curves import PolynomialCurve
from identify import FitResult
from tests.problems import play, rms
from tests.test_hysid.command import COLUMNS, LINE, put, run, sponge, text, write

QUICK: dict[str, Any] = {"noise": "gaussian", "starts": 1}
TIME = np.arange(241) / 60


def record(loop: float) -> Record:
    u = 10 * (1 - np.cos(2 * np.pi * TIME)) / 2
    noise = np.random.default_rng(0).normal(0, 0.01, len(u))
    return Record.from_arrays(u, 0.5 * u + loop * play(u, 2.0) + noise, TIME)


@pytest.fixture(scope="module")
def fitted() -> FitResult:
    return compensating(LinearSponge(K=1.0, b=0.0))


def compensating(model: Any, **options: Any) -> FitResult:
    return hysid.fit(record(0.1), model, test_cycles=1, purpose="compensate", **QUICK, **options)


def line_error(found: FitResult) -> np.ndarray:
    """Of the regression of the input on the output over the fitted rows, on the held-out ones."""
    slope, level = np.polyfit(found.train.output[found.used], found.train.input[found.used], 1)
    return (slope * found.test.output + level - found.test.input)[found.test.mask]


def test_the_error_of_the_compensator_comes_first(fitted: FitResult):
    assert fitted.purpose == "compensate"
    value = np.asarray(estimate(invert(fitted.model, trained=fitted.trained), fitted.test).value)
    error = (value - fitted.test.input)[fitted.test.mask]
    # The loop is not in the line, and is in the cubics, which know the way the output goes.
    assert fitted.verdict.codes[:2] == ("compensator-error", "worse-than-cubic")
    line, cubic = fitted.compensator["baselines"]
    assert line["rmse"] == pytest.approx(rms(line_error(fitted)))
    assert cubic["rmse"] < fitted.compensator["rmse"] == pytest.approx(rms(error))
    said = fitted.verdict.reasons[0]
    for figure in (rms(error), np.abs(error).max(), rms(line_error(fitted))):
        assert f"{figure:.3g}" in said
    assert fitted.candidates[0].verdict == fitted.verdict


def test_a_compensator_that_is_worse_than_a_line_fails(fitted: FitResult):
    steep = {"K": {"start": 0.9, "fixed": True}}
    worse = compensating("LinearSponge", parameters=steep)
    assert worse.verdict.level == "FAIL"
    assert worse.verdict.codes[:2] == ("compensator-error", "worse-than-line")
    assert f"{rms(line_error(fitted)):.3g} rms" in worse.verdict.reasons[1]


def test_a_line_over_the_condition_too_is_named():
    """A model without the condition is worse than a line that has it."""
    made = [replace(record(0.0), output=record(0.0).output + c) for c in (0.0, 1.0, 2.0)]
    columns = {"c": np.repeat([0.0, 1.0, 2.0], len(TIME))}
    u, y = (np.concatenate([getattr(one, x) for one in made]) for x in ("input", "output"))
    both = Record.from_arrays(
        u, y, groups=columns["c"], columns=columns, conditions={"c": "degC"}
    )  # fmt: skip
    worse = hysid.fit(both, LinearSponge(K=1.0, b=0.0), purpose="compensate", **QUICK)
    assert worse.verdict.codes[:2] == ("compensator-error", "worse-than-line")
    assert "A straight line from output and c is better" in worse.verdict.reasons[1]


def test_a_candidate_without_an_inverse_is_passed_over():
    """A parabola falls on one side of its domain, wherever it was fitted."""
    bent, parabola = record(0.1), PolynomialCurve(np.array([1.0, 1.0, 1.0]), -50.0, 50.0)
    bent = replace(bent, output=bent.output + 0.02 * bent.input**2)
    found = hysid.fit(bent, [parabola, LinearSponge(K=1.0, b=0.0)], purpose="compensate", **QUICK)
    assert [one.name for one in found.candidates] == ["LinearSponge", "PolynomialCurve"]
    assert found.candidates[1].score < found.score
    assert found.compensator["refused"] is None
    assert "passed-over" in found.verdict.codes


def test_the_command_says_what_the_verdict_is_for(tmp_path: Path):
    made = record(0.1)
    file = write(tmp_path / "run.csv", {"t": TIME, "u": made.input, "y": made.output})
    columns = ("--input", "u", "--output", "y", "--time", "t", "--test-cycles", 1)
    quick = ("--model", "LinearSponge", "--noise", "gaussian", "--starts", 1)
    out = tmp_path / "fit"
    said = run("fit", file, *columns, *quick, "--purpose", "compensate", "--out", out)
    assert said.code == 0, said.err
    level, *lines = said.out.splitlines()
    assert level.endswith(": LinearSponge (to compensate)")
    assert lines[0].startswith("  The compensator estimates u on the held-out rows to ")
    table = said.out[said.out.index("model, or (baseline)") :]
    baselines = ("(straight line)", "(replay of the last loop)", "(cubic per branch)")
    for name in ("LinearSponge", *baselines):
        assert name in table
    loaded = hysid.load(out)
    assert (loaded.purpose, loaded.verdict.codes[0]) == ("compensate", "compensator-error")
    hold = ("--step", 1, "--output", "y", "--time", "t", "--purpose", "compensate")
    refused = run("fit", file, *hold, "--out", tmp_path / "hold")
    assert refused.code == 2
    assert "cannot be recovered" in refused.err


@pytest.mark.usefixtures("empty_folder")
def test_ok_is_reached_after_as_many_cycles_as_its_time_has():
    put(text(sponge()[:-7]))  # the last cycle is not whole
    found = run("fit", "run.csv", *COLUMNS, *LINE, "--json").json()
    after = found["compensator"]["ok_after"]
    assert after["cycles"] == pytest.approx(after["time"] / 120, rel=0.1)
