"""What is asked of a fit in Python: new inputs, parameters by name, correlations, AIC and BIC."""

import numpy as np
import pytest

import hysid
import identify
from hysteresis import Record
from identify.internal import target as target_of_module
from tests.refusals import refuses
from tests.test_hysid.command import COLUMNS, put, run, sponge, text

U = np.tile(np.concatenate([np.linspace(0, 20, 60), np.linspace(20, 0, 60)]), 3)
Y = 2.0 * U + 1 + 0.05 * np.random.default_rng(0).standard_normal(len(U))
TIME = np.arange(len(U)) * 0.5


@pytest.fixture(scope="module")
def line() -> identify.FitResult:
    return identify.fit(Record.from_arrays(U, Y), "LinearSponge", noise="gaussian", starts=2)


def test_arrays_are_predicted_as_the_command_line_does(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = sponge()
    model = ("--model", "Burgers", "--starts", 1, "--noise", "gaussian")
    assert run("fit", put(text(rows)), *COLUMNS, *model).code == 0
    assert run("predict", "run", "run.csv").code == 0
    written = np.genfromtxt("run/predicted-run.csv", delimiter=",", skip_header=1)[:, 3]
    time, force = np.array([row[:2] for row in rows], float).T
    fit = hysid.load("run")
    np.testing.assert_allclose(fit.predict(force, time), written, rtol=1e-9)
    np.testing.assert_array_equal(fit.predict(force, time), fit.predict(fit.train)[: len(force)])
    refuses("no-time", lambda: fit.predict(force))


@pytest.mark.thorough
def test_a_composition_that_relaxes_needs_the_times_too():
    answer = U + 3 * np.convolve(U, 0.1 * np.exp(-0.1 * np.arange(60)))[: len(U)]
    fit = hysid.fit(Record.from_arrays(U, answer, TIME), "Composition")
    np.testing.assert_array_equal(fit.predict(U, TIME), fit.predict(fit.train))
    refuses("no-time", lambda: fit.predict(U))
    refuses("no-time", lambda: fit.predict(Record.from_arrays(U, answer)))


def test_a_condition_goes_with_the_inputs():
    heat = np.repeat([10.0, 20.0, 30.0], 120)
    runs = np.repeat([0, 1, 2], 120)
    more = {"groups": runs, "columns": {"T": heat}, "conditions": {"T": "K"}}
    record = Record.from_arrays(U, Y * (1 + heat / 100), **more)
    fit = hysid.fit(record, "Composition")
    assert fit.condition is not None
    measured = fit.predict(record)[120:240]
    for condition in (heat[120:240], 20.0, {"T": 20.0}):
        np.testing.assert_array_equal(fit.predict(U[120:240], condition=condition), measured)
    refuses("no-condition", lambda: fit.predict(U))
    refuses("bad-option", lambda: fit.predict(U, condition={"p": 1.0}), "depends on T")
    refuses("bad-option", lambda: fit.predict(record, condition=20.0))


def test_several_channels_are_columns_of_an_array():
    table = {"a": U, "b": U**2 / 20 + 0.1, "y": Y}
    record = Record.from_columns(table, ["a", "b"], "y")
    fit = hysid.fit(record, "Preisach")
    both = np.column_stack([table["a"], table["b"]])
    np.testing.assert_allclose(fit.predict(both), fit.predict(record), atol=1e-9)
    refuses("length-mismatch", lambda: fit.predict(U))


def test_a_parameter_is_found_by_its_name(line):
    found = line["k"]
    assert found == line["K"] == line.parameters[0]
    assert (found.value, found.stderr) == (pytest.approx(2.0, rel=1e-2), pytest.approx(5e-4, rel=1))
    assert str(found).split()[:3] == ["K", f"{found.value:.5g}", "+-"]
    refuses("unknown-parameter", lambda: line["treshold"], "'threshold'")
    refuses("unknown-parameter", lambda: line["x"], "'K' or 'b'")


def test_correlations_are_those_of_the_covariance(line):
    assert list(line.correlations) == ["K", "b"]
    (a, c), (_, b) = line.covariance
    assert line.correlations["K"]["b"] == pytest.approx(c / np.sqrt(a * b))
    assert line.correlations["b"]["b"] == pytest.approx(1)
    assert -1 < line.correlations["b"]["K"] < -0.5  # a steeper line begins lower


def test_criteria_are_those_of_the_likelihood(line):
    target = target_of_module(line)
    twice = 2 * float(target.log_likelihood(target.start))
    assert target.names == ("K", "b", "sigma")
    assert line.criteria.aic == pytest.approx(6 - twice, abs=0.02)
    assert line.criteria.bic - line.criteria.aic == pytest.approx(3 * np.log(len(U)) - 6)
    # Of white noise the closed form, by other code; and a parameter too many costs.
    rmse, n = line.metrics["train"].rmse, len(U)
    assert line.criteria.aic == pytest.approx(6 + n * (np.log(2 * np.pi * rmse**2) + 1), abs=1e-5)
    coloured = identify.fit(line.train, "LinearSponge", noise="ar1", starts=2)
    assert coloured.criteria.bic > line.criteria.bic


def test_where_there_is_no_counted_likelihood_there_are_no_criteria(line):
    waves = Record.from_arrays(U, Y + np.sin(np.arange(len(U)) / 9))
    why = {
        "are not counted": identify.fit(line.train, "Preisach"),
        "and they are correlated": identify.fit(waves, "LinearSponge", noise="gaussian", starts=2),
        "prior that you gave": identify.fit(
            line.train, "LinearSponge", noise="gaussian", starts=2,
            parameters={"K": {"prior": "normal(2, 1)"}},
        ),
    }  # fmt: skip
    for words, fit in why.items():
        refuses("not-comparable", lambda fit=fit: fit.criteria, words, "hysid.compare")
