"""Fits of a model that depends on a condition: an unseen temperature between trained ones is predicted."""

from dataclasses import replace

import numpy as np
import pytest

import identify
from hysteresis import Record
from tests.refusals import raises

U, Y, C = "field (A/m)", "flux (mT)", "temperature (K)"
TEMPERATURES = (280.0, 290.0, 310.0, 320.0)
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


def rig(temperatures=TEMPERATURES, seed: int = 0, turned: float = 1.0) -> dict:
    """One run of loops at each temperature, with noise."""
    random = np.random.default_rng(seed)
    runs: dict[str, list] = {U: [], Y: [], C: [], "run": []}
    for number, temperature in enumerate(temperatures):
        peaks = [-2.0, 2.0, -1.0, 1.5, -0.5, 1.0, -2.0, 1.8, -1.5, 0.5]
        u = np.interp(np.linspace(0, 9, ROWS), np.arange(10), np.array(peaks))
        y = turned * dahl(u, temperature) + 0.01 * random.normal(size=ROWS)
        for name, x in ((U, u), (Y, y), (C, temperature), ("run", number)):
            runs[name].append(np.broadcast_to(x, ROWS))
    return {name: np.concatenate(parts) for name, parts in runs.items()}


def record_of(columns: dict, **options) -> Record:
    chosen = {"input": U, "output": Y, "group": "run", "condition": C} | options
    return Record.from_columns(columns, **chosen)


@pytest.fixture(scope="module")
def found() -> identify.FitResult:
    return identify.fit(record_of(rig()), "Composition", test=record_of(rig((300.0,), seed=1)))


def test_a_temperature_between_trained_ones_is_predicted(found):
    """Noise is 0.2 per cent of the range; without the temperature the gain alone leaves 16 per cent."""
    assert C in found.train.conditions
    assert found.metrics["test"].nrmse_percent < 1.5
    without = [one for one in found.candidates if "temperature" not in one.name]
    assert min(one.score for one in without) > 3 * found.score


def test_the_error_between_trained_values_is_that_of_held_out_ones(found):
    condition = found.condition
    assert condition.values == TEMPERATURES
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
    np.testing.assert_array_equal(
        found.predict(as_channels), found.predict(record_of(columns, group=None))
    )


@pytest.mark.thorough
def test_a_condition_that_drifts_within_one_run_is_followed():
    """One run while the temperature rises: knots are its ends."""
    columns = rig((280.0,))
    u = columns[U]
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
    assert "constant-condition" in {note.code for note in fit.train.history}
