"""Baselines of a fit: what each of them is exact on, and that their rows and folds are the fit's."""

from typing import Any

import numpy as np
import pytest

from hysteresis import LinearSponge, Record
from identify import fit, fit_step
from tests.problems import play

ROWS = 401
TIME = np.arange(ROWS) / 80
U = 10 * (1 - np.abs(2 * (TIME % 1.0) - 1))
"""Five triangles from 0 up and back."""


def baselines(output: np.ndarray) -> dict[str, Any]:
    made = Record.from_arrays(U, output, TIME)
    with np.errstate(divide="ignore", invalid="ignore"):  # an output of no noise
        found = fit(made, LinearSponge(1.0), noise="gaussian", starts=1)
    return {one.name: one for one in found.baselines}


@pytest.mark.parametrize(("output", "exact"), [
    (2 * U - 1, "straight line"), (5 - 0.3 * U, "straight line"), (5 - 0.3 * U, "cubic per branch"),
    ((U / 10) ** 3 - U, "cubic per branch"),
    (U**2 / 10 + 2 * play(U, 2.0), "replay of the last loop"),
])  # fmt: skip
def test_each_is_exact_on_its_own_data(output: np.ndarray, exact: str):
    """On the rows of folds that it has not seen."""
    assert np.sqrt(baselines(output)[exact].blocks.mean()) < 1e-9


@pytest.mark.parametrize("exponent", [-0.3, 0.0, 0.5])
def test_a_power_law_of_time_is_found(exponent: float):
    t = np.geomspace(0.01, 1000, 80)
    law = np.log(t) if exponent == 0 else t**exponent
    made = Record.from_arrays(np.full(80, 2.0), 2 * (30 + 0.5 * law), t)
    found = {one.name: one.blocks.mean() for one in fit_step(made).baselines}
    assert found["power law of time"] < 1e-9 * found["constant"]


def test_rows_are_those_of_the_fit():
    output = 2 * U + np.random.default_rng(0).normal(0, 0.1, ROWS)
    train, test = Record.from_arrays(U, output, TIME).split_cycles(1)
    options = {"noise": "gaussian", "starts": 1, "conditioning": "keep"}
    found = fit(train, LinearSponge(1.0), test=test, **options)
    (line,) = (one for one in found.baselines if one.name == "straight line")
    slope, level = np.polyfit(U[train.mask], output[train.mask], 1)
    error = (slope * U + level - output)[test.mask]
    assert line.metrics["test"].rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    assert line.judged == (line.metrics["test"].rmse, line.metrics["test"].nrmse_percent)
