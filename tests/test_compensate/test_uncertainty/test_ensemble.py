"""Draws side by side are the draws one by one; a calibrated band holds what it says."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compensate import calibrated, invert
from compensate.internal import CalibratedCompensator
from hysteresis import AbstractModel, Burgers, LinearSponge, Preisach, Record
from hysteresis.preisach import GridDensity
from tests.problems import HIGH, LOW, SAMPLES, random_histories, weights
from tests.refusals import refuses
from tests.streams import check_stream
from tests.thorough import rest_thorough

DRAWS = 9


def grid(rng: np.random.Generator) -> Preisach:
    return Preisach(GridDensity(LOW, HIGH, weights(rng)), rng.uniform(0.3, 0.6, 7), rng.normal())


def burgers(rng: np.random.Generator) -> Burgers:
    return Burgers(*rng.uniform([1, 20, 1, 2], [4, 80, 4, 10]), rng.normal())


def sponge(rng: np.random.Generator) -> LinearSponge:
    return LinearSponge(*rng.uniform([1, 5], [2, 8]), 1.5)


def stacked(make: Any, draws: int = DRAWS) -> tuple[list[Any], Any]:
    each = [make(np.random.default_rng(k)) for k in range(draws)]
    return each, jax.tree.map(lambda *leaves: np.stack(leaves), *each)


both = pytest.mark.parametrize("make", rest_thorough([grid, burgers, sponge], 2))
t = 0.1 * np.arange(SAMPLES)


def history(seed: int = 1) -> np.ndarray:
    return random_histories(np.random.default_rng(seed), LOW, HIGH, (4, SAMPLES))[-1]


@both
def test_side_by_side_as_one_by_one(make: Any):
    each, models = stacked(make)
    y = np.asarray(each[0].simulate(t, history()))
    found = invert(models).simulate(t, y)
    alone = np.stack([np.asarray(invert(model).simulate(t, y).value) for model in each])
    np.testing.assert_allclose(found.draws, alone, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.value, alone.mean(0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.deviation, alone.std(0), rtol=0, atol=1e-9)
    wanted = np.quantile(alone, [0.1, 0.5], axis=0)
    np.testing.assert_allclose(found.quantile([0.1, 0.5]), wanted, rtol=0, atol=1e-9)
    assert found.quantile(0.5).shape == y.shape


@both
def test_a_stream_equals_the_batch_and_holes_leave_no_trace(make: Any):
    each, models = stacked(make)
    y = np.asarray(each[0].simulate(t, history()))
    hole = np.isin(np.arange(SAMPLES), [0, 5, 6, 17])
    broken = np.where(hole, np.resize([np.nan, np.inf, -np.inf], SAMPLES), y)
    error = jnp.array([[0.1, 0.2], [0.3, 0.4]])
    levels, scores = jnp.array([LOW, HIGH]), jnp.array([-1.0, 1.0])
    inner = invert(models)
    for compensator in (inner, CalibratedCompensator(inner, levels, error, scores, 0.01)):
        check_stream(compensator, t, broken, 1e-8)
        # There is no deviation before a reading.
        assert np.isfinite(np.asarray(compensator.simulate(t, broken).draws)[:, 1:]).all()


def wrong(seed: int, cycles: int = 8) -> tuple[AbstractModel, Record]:
    """A line, and a record whose readings it misses by a wave per cycle: larger on the way up."""
    rng = np.random.default_rng(seed)
    per = 200
    u = 5 - 5 * np.cos(2 * np.pi * np.arange(cycles * per + 1) / per)
    amplitude = np.append(np.repeat(rng.normal(0, 1, cycles), per), 0.0)
    up = np.gradient(u) > 0
    y = u + np.where(up, 0.3, 0.1) * amplitude * np.sin(u / 2 + 1)
    return LinearSponge(1.0, 0.0), Record.from_arrays(u, y, dt=0.01)


def test_the_error_is_added_in_quadrature_and_carried_over():
    _, models = stacked(lambda rng: LinearSponge(1.0, 0.05 * rng.normal()), 40)
    _, record = wrong(0)
    plain = invert(models)
    known = calibrated(plain, record)
    found, spread = known.simulate(None, record.output), plain.simulate(None, record.output)
    error = np.sqrt(np.asarray(found.deviation) ** 2 - np.asarray(spread.deviation) ** 2)
    assert error.min() >= 0.99 * np.asarray(known.error).min()
    np.testing.assert_array_equal(found.value, spread.value)
    other = known.around(invert(LinearSponge(1.0, 0.0)))
    assert other.error is known.error
    assert other.simulate(None, record.output).deviation.max() < np.asarray(found.deviation).max()


def test_no_row_to_learn_from_is_refused():
    model, record = wrong(0, 4)
    refuses("no-rows", lambda: calibrated(invert(model), record.split_rows(record.cycle >= 9)[1]))
