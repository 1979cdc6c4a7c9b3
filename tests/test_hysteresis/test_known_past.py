"""A model that starts in the middle of a history is told by the rows whose output is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import AbstractModel, InputError, with_units
from hysteresis._known_past import known_past, outputs_of
from tests.problems import PROBLEMS, Problem, kinds_often, random_histories

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


@pytest.mark.parametrize("problem", kinds_often(PROBLEMS))
def test_known_rows_are_worth_the_true_state(problem: Problem):
    errors = []
    for seed in range(5):
        model, t, u, y = begun(problem, seed)
        noise = NOISE * np.std(y) * np.random.default_rng(seed).normal(size=ROWS)
        own = slice(FIRST, LAST)
        state = model.state_from(t[own], u[own], (y + noise)[own])
        after = np.asarray(model.simulate(t[LAST:], u[LAST:], state)) - y[LAST:]
        errors.append(np.sqrt(1 + np.mean(after**2) / (NOISE * np.std(y)) ** 2))
    assert np.median(errors) < WORSE


@pytest.mark.parametrize("problem", kinds_often(PROBLEMS))
def test_what_the_known_rows_leave_open_is_told(problem: Problem):
    """Other histories miss the known outputs by no more than the noise, and reach as far as the error."""
    model, t, u, y = begun(problem, 1)
    noise = NOISE * np.std(y) * np.random.default_rng(1).normal(size=ROWS)
    own = slice(FIRST, LAST)
    past = known_past(model, t[own], u[own], (y + noise)[own])
    assert past.misfit < 3 * NOISE * np.std(y)
    outputs = np.asarray(outputs_of(model)(*past.followed_by(t[LAST:], u[LAST:])))
    each = outputs.reshape(len(past.inputs), -1)
    known, after = each[:, FIRST - ROWS : LAST - ROWS], each[:, LAST - ROWS :]
    missed = np.sqrt(np.mean((known - (y + noise)[own]) ** 2, axis=1))
    assert missed.max() < 6 * NOISE * np.std(y)
    open_to = np.sqrt(((after[1:] - after[0]) ** 2).sum(0) / 2)
    error = np.sqrt(np.mean((after[0] - y[LAST:]) ** 2))
    assert error < 5 * np.sqrt(np.mean(open_to**2)) + NOISE * np.std(y)


BY_NAME = {problem.name: problem for problem in PROBLEMS}


@given(seed=st.integers(0, 10_000), name=st.sampled_from(["bouc-wen", "play-rates-bent", "duhem"]))
def test_any_stretch_is_explained_as_well_as_by_a_rest(seed: int, name: str):
    model, t, u, y = begun(BY_NAME[name], seed)
    own = slice(FIRST, LAST)
    past = known_past(model, t[own], u[own], y[own])
    rest = np.append(np.full(1, t[FIRST] - 1e-3), t[own]), np.append(u[FIRST], u[own])
    error = np.asarray(model.simulate(*rest))[1:] - y[own]
    assert past.misfit <= np.sqrt(np.mean(error**2)) + 1e-3 * np.ptp(y[own])


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


def test_histories_stay_within_the_trained_inputs():
    model, t, u, y = begun(BY_NAME["play-leading-bent"], 4)
    narrow = replace(model, trained=np.array([-1.0, 1.0]))
    own = slice(FIRST, LAST)
    past = known_past(narrow, t[own], u[own], y[own])
    assert past.inputs.min() >= min(-1.0, u[own].min())
    assert past.inputs.max() <= max(1.0, u[own].max())
