"""A compensator is OK from the first reading after a stretch of which both sides are known."""

from dataclasses import replace

import numpy as np
import pytest

from compensate import Status, estimate, invert
from hysteresis import Record
from hysteresis.internal import with_units
from tests.problems import INVERTIBLE, KINDS, Problem, random_histories
from tests.thorough import rest_thorough

FIRST, LAST, ROWS = 50, 90, 120
EACH = [p for p in INVERTIBLE if p.name != "burgers-lagging-constant"]


def looped(problem: Problem, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and inputs that are one loop in the known rows."""
    rng = np.random.default_rng(seed)
    (u,) = random_histories(rng, problem.low, problem.high, (1, ROWS))
    way = 0.5 - 0.4 * np.cos(np.linspace(0, 2 * np.pi, LAST - FIRST))
    u[FIRST:LAST] = problem.low + (problem.high - problem.low) * way
    return np.cumsum(rng.uniform(0.2, 2, ROWS)), u


@pytest.mark.parametrize(  # relays take four fifths of the time
    "problem",
    rest_thorough(EACH, lambda p: p.name in KINDS - {"preisach-up"}),
    ids=lambda p: p.name,
)
def test_a_known_loop_ends_the_run_in(problem: Problem):
    t, u = looped(problem)
    model = with_units(problem.model(1), None, (problem.low, problem.high))
    y, span = np.asarray(model.simulate(t, u)), problem.high - problem.low
    compensator = invert(
        model, trained=(problem.low, problem.high), start="unknown", past=(t, u), deviation=span / 100
    )  # fmt: skip
    own = slice(FIRST, LAST)
    state = compensator.state_from(t[own], u[own], y[own])
    found = compensator.simulate(t[LAST:], y[LAST:], state)
    assert found.status[0] == Status.OK
    status, off = np.asarray(found.status), np.abs(np.asarray(found.value) - u[LAST:])
    assert off[status == Status.OK].max() < 0.03 * span
    # A loop may leave open what matters later: said where the estimate is off by it, and only there.
    assert (off[status == Status.RUN_IN] > span / 200).all()


def test_a_record_with_known_rows_is_estimated_from_them():
    problem = next(p for p in INVERTIBLE if p.name == "bouc-wen")
    t, u = looped(problem)
    model = problem.model(1)
    y = np.asarray(model.simulate(t, u))
    own = slice(FIRST, ROWS)
    record = Record.from_arrays(u[own], y[own], t[own])
    record = replace(
        record, columns=record.columns | {"known_rows": np.arange(ROWS - FIRST) < LAST - FIRST}
    )
    found = estimate(invert(model), record)
    assert np.allclose(found.value[LAST - FIRST :], u[LAST:], atol=1e-6)
