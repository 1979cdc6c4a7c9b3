"""Tangents of trees of laws against differences of their outputs, and compiled against plain Python."""

import jax.numpy as jnp
import numpy as np
import pytest

from hysteresis import BoucWenForce, GeneralizedPlays, Sum
from hysteresis.dynamics._layout import MOTION, layout_of
from hysteresis.dynamics._layout import clock as even
from hysteresis.running import _compiled, _over_time, numbers_of, place_of, run, tangents
from tests.problems import Problem, clock, random_histories
from tests.test_hysteresis.test_trees import KNOWN, ROWS

T = np.arange(300) / 750
FORCE = 40 * np.sin(2 * np.pi * (18 * T + 40 * T**2)) * np.minimum(1, 20 * T)
MIXED = BoucWenForce(alpha=4e4, beta_gamma=700.0, beta_delta=-900.0)
PLAYS = GeneralizedPlays([0.0, 2e-4, 6e-4], [2e-3] * 3, np.linspace(1, -1, 12).reshape(3, 4) * 20)


@pytest.fixture
def in_python(monkeypatch):
    """Without numba: what is compiled of every law takes minutes."""
    caches = _compiled.loop_of, _compiled.reals_of
    for module in (_compiled, _over_time):
        monkeypatch.setattr(module, "available", lambda: False)
    for one in caches:
        one.cache_clear()
    yield
    for one in caches:
        one.cache_clear()


# What a moving model adds to its input is known backwards alone.
FORWARDS = [problem for problem in KNOWN if problem.name != "moving"]


@pytest.mark.parametrize("problem", FORWARDS, ids=lambda p: p.name)
@pytest.mark.usefixtures("in_python")
def test_every_law_has_the_derivatives_of_its_outputs(problem: Problem):
    """Along a direction through all parameters; differences are wrong where an output bends."""
    numbers = numbers_of(problem.model().tree(depth=0))
    random = np.random.default_rng(1)
    u = random_histories(random, problem.low, problem.high, (1, ROWS))[0]
    dt = np.append(np.nan, np.diff(clock(1, ROWS)))
    m = np.asarray(numbers.m)
    free = [place for place in numbers.known.free if place < len(m) - numbers.known.states]
    dm = np.zeros((len(m), 2))
    dm[free, 0] = random.normal(size=len(free)) * np.abs(m[free])
    dm[free[0], 1] = 1.0
    found = tangents(numbers, dm, u, dt).columns
    for k, step in enumerate((1e-6, 1e-6 * max(abs(m[free[0]]), 1e-3))):
        ends = [run(numbers._replace(m=m + s * step * dm[:, k]), u, dt).value for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        off = np.abs(found[:, k] - slope) / max(np.abs(slope).max(), 1e-9)
        assert np.quantile(off, 0.8) < 1e-4, k


@pytest.mark.parametrize("spring", [MIXED, Sum(MIXED, PLAYS)], ids=["rate", "plays"])
def test_an_oscillator_by_its_numbers_and_its_first_motion(spring):
    layout, rows = layout_of(spring), np.repeat(FORCE, 4)
    assert layout is not None
    numbers = numbers_of(layout.tree(list(jnp.array([1.7, 12.0, 4.5e4])), 2))
    known, m = numbers.known, np.asarray(numbers.m)
    places = [*known.free, *(place_of(known, name) for name in MOTION)]
    dm = np.zeros((len(m), len(places)))
    dm[places, range(len(places))] = 1.0
    dt = even(len(rows), 1 / 3000)
    found = tangents(numbers, dm, rows, dt)
    np.testing.assert_allclose(found.value, run(numbers, rows, dt).value, rtol=0, atol=1e-15)
    for k, size in enumerate([*np.abs(m[list(known.free)]), 1e-3, 0.1, 10.0]):
        step = 1e-7 * max(size, 1e-3)
        ends = [run(numbers._replace(m=m + s * step * dm[:, k]), rows, dt).value for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(found.columns[:, k] - slope).max() <= 1e-3 * np.abs(slope).max() + 1e-12, k
    # Two directions at once, and a part of the rows.
    both = tangents(numbers, dm[:, :4] @ np.array([[1.0], [2], [0], [3]]), rows, dt, kept=(7, 5))
    wanted = found.columns[7::5, :4] @ [1.0, 2, 0, 3]
    np.testing.assert_allclose(both.columns[:, 0], wanted, rtol=0, atol=1e-9 * np.ptp(wanted))
