"""A search for parameters: of records of many lengths it compiles few programs."""

import equinox as eqx
import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import Record
from identify import fit
from identify.parametric._multistart import longer, prepared_longer
from tests.problems import SAMPLES, Problem, clock, tagged

compiled: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, _, **about: compiled.append(f"{event} {about.get('fun_name')}")
)


@pytest.mark.parametrize("problem", tagged("rates"), ids=lambda p: p.name)
def test_rows_behind_change_nothing_before(problem: Problem):
    model, t = problem.model(), clock(0)
    u = np.random.default_rng(0).uniform(problem.low, problem.high, SAMPLES)
    found = eqx.filter_jit(model.evaluate)(prepared_longer(model, t, u, (0, 5)))
    assert found.shape == longer(u).shape
    # Equal to rounding: the same steps, in arrays of another length.
    wanted = np.asarray(model.simulate(t, u, starts=(0, 5)))
    np.testing.assert_allclose(found[:SAMPLES], wanted, rtol=1e-9, atol=1e-9)


@given(st.integers(1, 10**6))
def test_lengths_are_few_and_hardly_longer(rows: int):
    length = len(longer(np.zeros(rows, np.int8)))
    assert rows <= length < max(rows + 64, 1.25 * rows + 1)
    assert length % max(64, 1 << (rows - 1).bit_length() - 3 if rows > 512 else 0) == 0


def test_a_fit_of_another_length_finds_its_programs():
    def fitted(rows: int) -> None:
        u = np.sin(np.linspace(0, 20, rows))
        y = 2 * u + np.random.default_rng(rows).normal(0, 0.01, rows)
        fit(Record.from_arrays(u, y), "LinearSponge")

    fitted(130)
    compiled.clear()
    fitted(190)
    searches = ("_run", "likeliest", "linearised")
    assert not [one for one in compiled if "compile" in one and any(s in one for s in searches)]
    assert any(
        "compile" in one for one in compiled
    )  # the listener hears: the prediction is compiled
