"""Where a record begins: start values of a model, and the state that rows of known output tell."""

import numpy as np
import pytest

from hysteresis import AbstractModel, BoucWen, InputError, Record
from hysteresis._registry import find_model
from hysteresis.internal import with_units
from tests.problems import KINDS, PROBLEMS, Problem, random_histories
from tests.refusals import refuses
from tests.thorough import rest_thorough

FIRST, LAST, ROWS = 60, 90, 120
"""The known rows, of so many."""

NOISE = 0.02
"""Of the known outputs, in standard deviations: what fits of good data leave."""

WORSE = 1.1
"""The error over that with the true state."""


def begun(problem: Problem, seed: int) -> tuple[AbstractModel, np.ndarray, np.ndarray, np.ndarray]:
    """A model, and a long history of it."""
    rng = np.random.default_rng(seed)
    (u,) = random_histories(rng, problem.low, problem.high, (1, ROWS))
    t = np.cumsum(rng.uniform(0.2, 2, ROWS))
    model = with_units(problem.model(seed), None, (problem.low, problem.high))
    return model, t, u, np.asarray(model.simulate(t, u))


@pytest.mark.parametrize(  # the search for the state of relays takes half a minute
    "problem", rest_thorough(PROBLEMS, lambda p: p.name in KINDS - {"preisach-up"})
)
def test_known_rows_are_worth_the_true_state(problem: Problem):
    errors = []
    for seed in range(3):
        model, t, u, y = begun(problem, seed)
        noise = NOISE * np.std(y) * np.random.default_rng(seed).normal(size=ROWS)
        own = slice(FIRST, LAST)
        state = model.state_from(t[own], u[own], (y + noise)[own])
        after = np.asarray(model.simulate(t[LAST:], u[LAST:], state)) - y[LAST:]
        errors.append(np.sqrt(1 + np.mean(after**2) / (NOISE * np.std(y)) ** 2))
    assert np.median(errors) < WORSE


BY_NAME = {problem.name: problem for problem in PROBLEMS}


def test_rows_without_an_output_say_nothing_and_drive():
    model, t, u, y = begun(BY_NAME["bouc-wen"], 2)
    own, some = slice(FIRST, LAST), y.copy()
    some[FIRST:LAST:2] = np.nan
    state = model.state_from(t[own], u[own], some[own])
    assert np.allclose(model.simulate(t[LAST:], u[LAST:], state), y[LAST:], atol=1e-6 * np.ptp(y))
    with pytest.raises(InputError, match="no output is known"):
        model.state_from(t[own], u[own], np.full(LAST - FIRST, np.nan))


def test_a_model_with_rates_needs_the_times():
    model, _, u, y = begun(BY_NAME["maxwell"], 0)
    refuses("no-time", lambda: model.state_from(None, u, y), "time")


NAMES = (
    "PrandtlIshlinskii", "DegradingBoucWen", "StandardLinearSolid", "GeneralizedKelvinVoigt",
    "GeneralizedMaxwell",
)  # fmt: skip


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_a_start_is_near_the_record(name: str, swapped: bool):
    """Loops of a yielding spring, in either direction: nearer to them than their mean is."""
    u = 3 * np.sin(0.1 * np.arange(300.0)) * np.linspace(0.3, 1, 300)
    y = np.asarray(BoucWen(2.0, 0.3, 0.5).simulate(None, u))
    u, y = (y, u) if swapped else (u, y)
    if name == "DegradingBoucWen" and swapped:
        pytest.skip("its output leads the input")
    record = Record.from_arrays(u, y, 0.1 * np.arange(300.0))
    model = find_model(name).start(record)
    found = np.asarray(model.simulate(record.time, record.input))
    assert np.isfinite(found).all()
    assert np.std(found - y) < np.std(y)


@pytest.mark.parametrize("name", NAMES[2:])
def test_a_rate_without_a_clock_is_missed_by_the_model_that_was_asked_for(name: str):
    record = Record.from_arrays(np.sin(np.arange(40.0)), np.cos(np.arange(40.0)))
    refuses("no-time", lambda: find_model(name).start(record), f"{name} depends on the rate")
