"""The table of problems: complete, and right where the equations give values."""

import inspect

import numpy as np
import pytest

import hysteresis
from hysteresis import AbstractModel, Sum
from tests.problems import PROBLEMS, TAGS, Problem, tagged


def test_names_are_unique_and_tags_used():
    assert len({p.name for p in PROBLEMS}) == len(PROBLEMS)
    assert all(tagged(tag) for tag in TAGS)


def test_every_exported_model_is_in_the_table():
    exported = {
        cls
        for cls in vars(hysteresis).values()
        if inspect.isclass(cls) and issubclass(cls, AbstractModel) and not inspect.isabstract(cls)
    }
    tabled = {type(p.model()) for p in PROBLEMS}
    sums = [whole for p in PROBLEMS if isinstance(whole := p.model(), Sum)]
    tabled |= {type(part) for whole in sums for part in whole.parts}
    # Its input is (u, c): tests/test_hysteresis/test_models/test_conditioned.py holds its laws.
    assert exported - tabled == {hysteresis.Conditioned}


@pytest.mark.parametrize("problem", [p for p in PROBLEMS if p.known], ids=lambda p: p.name)
def test_known_values(problem: Problem):
    model = problem.model(seed=3)
    t, u, y = problem.known(model)
    # A hundred additions of numbers of the output's size, each rounded: 1e-14 of it.
    np.testing.assert_allclose(model.simulate(t, u), y, rtol=0, atol=1e-13 * np.abs(y).max())
