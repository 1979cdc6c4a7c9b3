"""A condition: fitted on the command line, predicted between trained values, run backwards, reported."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hysid
import identify
from compensate import estimate
from compensate.runtime import load
from hysteresis import Record
from tests.refusals import raises
from tests.test_hysid.command import run, text

U, Y, C = "field (A/m)", "flux (mT)", "temperature (K)"
TRAINED = (280.0, 290.0, 310.0, 320.0)
ROWS = 120


def dahl(u: np.ndarray, temperature: float) -> np.ndarray:
    """Dahl's friction beside a bent spring: gain and width of the loop follow the temperature.

    y = k u + 0.3 sin(u) - z,    dz = (1 - sign(du) z / F) s du
    """
    part = (temperature - 280) / 40
    k, force, stiffness = 1.0 + 0.8 * part, 0.5 - 0.35 * part, 2.0
    z, found = 0.0, []
    for step in np.diff(u, prepend=u[0]):
        # Exact over a step of one direction.
        target = np.sign(step) * force
        z = target + (z - target) * np.exp(-stiffness * abs(step) / force)
        found.append(z)
    return k * u + 0.3 * np.sin(u) - np.array(found)


def rig(temperatures=TRAINED, seed: int = 0) -> dict:
    """One run of loops at each temperature, with noise."""
    random = np.random.default_rng(seed)
    runs: dict[str, list] = {U: [], Y: [], C: [], "run": []}
    for number, temperature in enumerate(temperatures):
        peaks = [-2.0, 2.0, -1.0, 1.5, -0.5, 1.0, -2.0, 1.8, -1.5, 0.5]
        u = np.interp(np.linspace(0, 9, ROWS), np.arange(10), np.array(peaks))
        y = dahl(u, temperature) + 0.01 * random.normal(size=ROWS)
        for name, x in ((U, u), (Y, y), (C, temperature), ("run", number)):
            runs[name].append(np.broadcast_to(x, ROWS))
    return {name: np.concatenate(parts) for name, parts in runs.items()}


def record_of(columns: dict, **options) -> Record:
    chosen = {"input": U, "output": Y, "group": "run", "condition": C} | options
    return Record.from_columns(columns, **chosen)


def written(file: Path, temperatures: tuple[float, ...]) -> Path:
    columns = rig(temperatures)
    rows = [[f"{value:.9g}" for value in row] for row in zip(*columns.values(), strict=True)]
    file.write_text(text(rows, columns))
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("conditions")
    written(place / "runs.csv", (*TRAINED, 300.0))
    written(place / "warm.csv", (300.0,))
    written(place / "hot.csv", (330.0,))
    return place


@pytest.fixture(scope="module")
def fitted(folder) -> dict:
    """The condition is given as a second input; that it stays in every run tells it."""
    held_out = ("--group", "run", "--test-where", "run=4")
    return run(
        "fit", folder / "runs.csv", "--input", U, "--input", C, "--output", Y, *held_out,
        "--model", "Composition", "--out", folder / "out", "--json",
    ).json()  # fmt: skip


@pytest.fixture(scope="module")
def found(folder, fitted) -> identify.FitResult:
    return identify.load(folder / "out")


def test_a_condition_between_trained_ones_is_predicted(fitted, found):
    """Noise is 0.2 per cent of the range; without the temperature the gain alone leaves 16 per cent."""
    assert (fitted["selection"]["input"], fitted["selection"]["condition"]) == (U, [C])
    assert (fitted["condition"]["values"], fitted["condition"]["unit"]) == (list(TRAINED), "K")
    assert fitted["metrics"]["test"]["nrmse_percent"] < 1.5
    without = [one for one in found.candidates if "temperature" not in one.name]
    assert min(one.score for one in without) > 3 * found.score
    words = "'temperature (K)' is constant"
    assert any(said.startswith(words) for said in fitted["data"]["history"])


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


def test_the_error_between_trained_values_is_that_of_held_out_ones(found):
    condition = found.condition
    assert condition.values == TRAINED
    test = found.metrics["test"].rmse
    assert test / 3 < condition.error < 5 * test
    fresh = record_of(rig((300.0, 310.0, 330.0)))
    at = [slice(k * ROWS, (k + 1) * ROWS) for k in range(3)]
    assert [bool(condition.between(fresh)[rows].all()) for rows in at] == [True, False, False]
    assert [bool(found.beyond(fresh)[rows].all()) for rows in at] == [False, False, True]


def test_a_saved_fit_predicts_the_same(found, tmp_path):
    again = identify.load(identify.save(found, tmp_path / "fit"))
    assert again.condition == found.condition
    fresh = record_of(rig((295.0,)))
    np.testing.assert_array_equal(again.predict(fresh), found.predict(fresh))
    assert again.detail.linear.meaning == found.detail.linear.meaning
    assert again.train.digest() == found.train.digest()


def test_both_inputs_of_one_run_are_told_apart_by_the_fit(found):
    columns = rig((300.0,))
    as_channels = record_of(columns, input=[U, C], condition=())
    assert as_channels.channels
    alone = found.predict(record_of(columns, group=None))
    np.testing.assert_array_equal(found.predict(as_channels), alone)


@pytest.mark.thorough
def test_a_condition_that_drifts_within_one_run_is_followed():
    """One run while the temperature rises: knots are its ends."""
    u = rig((280.0,))[U]
    c = np.linspace(280.0, 320.0, len(u))
    grid = np.linspace(280.0, 320.0, 41)
    sampled = np.stack([dahl(u, at) for at in grid], 1)
    y = np.array([np.interp(at, grid, row) for at, row in zip(c, sampled, strict=True)])
    record = record_of({U: u, Y: y, C: c}, group=None)
    found = identify.fit(record, "Composition")
    assert "temperature" in found.name
    without = [one for one in found.candidates if "temperature" not in one.name]
    least = min(one.metrics["train"].nrmse_percent for one in without)
    assert least > 2 * found.metrics["train"].nrmse_percent
    assert found.metrics["train"].nrmse_percent < 2


def test_two_conditions_and_a_constant_one():
    columns = rig() | {"pressure (bar)": np.repeat([1.0, 2.0, 3.0, 4.0], ROWS)}
    with raises("several-conditions"):
        identify.fit(record_of(columns, condition=[C, "pressure (bar)"]), "LinearSponge")
    still = replace(record_of(rig()), columns={C: np.full(4 * ROWS, 300.0)})
    fit = identify.fit(still, "LinearSponge", noise="gaussian", starts=1)
    assert "constant-condition" in {note.code for note in fit.verdict.reasons}
    ignored = identify.fit(record_of(rig()), "LinearSponge", noise="gaussian", starts=1)
    assert any(f"not depend on {C}" in reason for reason in ignored.verdict.reasons)
    assert "condition-ignored" in ignored.verdict.codes
