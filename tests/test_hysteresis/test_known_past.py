"""A model that starts in the middle of a history is told by the rows whose output is known."""

import numpy as np
import pytest

from hysteresis import AbstractModel, InputError
from hysteresis.internal import with_units
from tests.problems import KINDS, PROBLEMS, Problem, random_histories
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
    "problem",
    rest_thorough(PROBLEMS, lambda p: p.name in KINDS - {"preisach-up"}),
    ids=lambda p: p.name,
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
    with pytest.raises(InputError, match="time"):
        model.state_from(None, u, y)
