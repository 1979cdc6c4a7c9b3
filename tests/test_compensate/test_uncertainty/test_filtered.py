"""Inverses that know of noise: nothing without it, less of it with it, and a deviation that is one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compensate import Status, filtered, invert
from hysteresis import AbstractModel, Burgers, InputError, Preisach
from hysteresis.preisach import GaussianDensity, GridDensity
from tests.problems import HIGH, LOW, SAMPLES, clock, random_histories
from tests.refusals import refuses
from tests.streams import check_stream
from tests.thorough import rest_thorough

CELLS = 12
SPAN = HIGH - LOW
rng = np.random.default_rng(5)
MASSES = np.tril(rng.uniform(0.1, 1.0, (CELLS, CELLS)))
GRID = Preisach(GridDensity(LOW, HIGH, MASSES), rng.uniform(0.5, 2.0, CELLS), 0.3)
BURGERS = Burgers(2.0, 40.0, 1.0, 5.0, 0.1)
models = rest_thorough([GRID, BURGERS], 1)
both = pytest.mark.parametrize("model", models, ids=["preisach", "burgers"])


def walk(step: float, samples: int, seed: int) -> np.ndarray:
    """A random walk, turned back at the ends of the range."""
    steps = np.random.default_rng(seed).normal(0, step, samples)
    place = np.mod(np.cumsum(steps) + 0.3 * SPAN, 2 * SPAN)
    return LOW + np.where(place > SPAN, 2 * SPAN - place, place)


def noisy(model: AbstractModel, u: np.ndarray, seed=7) -> tuple[jax.Array, np.ndarray, float]:
    """Times, outputs with noise of 1 % of their range, and its deviation."""
    t = jnp.asarray(0.1 * np.arange(len(u)))
    y = np.asarray(model.simulate(t, u))
    sigma = 0.01 * float(np.ptp(y))
    return t, y + np.random.default_rng(seed).normal(0, sigma, len(u)), sigma


@both
def test_without_noise_it_is_the_raw_inverse(model: AbstractModel):
    u = random_histories(np.random.default_rng(0), LOW, HIGH, (20, SAMPLES))
    t, compensator = jnp.asarray(clock(0)), filtered(model, 0.3, 1e-9)

    @jax.jit
    @jax.vmap
    def found(row: jax.Array):
        y = model.simulate(t, row)
        return compensator.simulate(t, y), y

    estimate, _ = found(jnp.asarray(u))
    # The gain is 1 but for 1e-18 over the chord's slope squared; slopes vanish at a reversal.
    np.testing.assert_allclose(estimate.value, u, rtol=0, atol=1e-5)
    assert set(np.unique(estimate.status).tolist()) <= {Status.OK, Status.FLAT}


@both
@pytest.mark.parametrize("step", rest_thorough([0.003, 0.02], 1))
def test_noise_does_less_and_the_band_says_how_much(model: AbstractModel, step: float):
    """On walks with just these statistics: 90 % bands hold 85 to 95 %."""
    u = walk(step * SPAN, 3000, 1)
    t, y, sigma = noisy(model, u)
    raw = np.asarray(invert(model).simulate(t, y).value) - u
    found = filtered(model, step * SPAN, sigma).simulate(t, y)
    error = np.asarray(found.value) - u
    assert np.sqrt(np.mean(error**2)) < 0.75 * np.sqrt(np.mean(raw**2))
    low, high = np.asarray(found.quantile([0.05, 0.95]))
    assert 0.85 <= np.mean((low <= u) & (u <= high)) <= 0.95


@pytest.mark.parametrize("by_time", rest_thorough([True, False], 1))
@both
def test_a_stream_equals_the_batch_and_holes_leave_no_trace(model: AbstractModel, by_time: bool):
    compensator = filtered(model, 0.05, 0.02, by_time=by_time)
    t, y, _ = noisy(model, walk(0.05, SAMPLES, 2))
    hole = np.isin(np.arange(SAMPLES), [0, 1, 7, 8, 20])
    broken = np.where(hole, [[np.nan, np.inf, -np.inf, np.nan] * (SAMPLES // 4)], y)[0]
    check_stream(compensator, np.asarray(t), broken)
    assert np.isfinite(np.asarray(compensator.simulate(t, broken).value)).all()


def test_a_model_without_laws_is_refused():
    with pytest.raises(InputError, match="not-invertible"):
        filtered(Preisach(GaussianDensity(LOW, HIGH, 1.0, 0.4, 0.4, 1.0, 0.4)), 0.1, 0.1)


@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, np.nan])
def test_deviations_that_are_none_are_refused(value: float):
    refuses("parameter-out-of-bounds", lambda: filtered(GRID, value, 0.1))
    refuses("parameter-out-of-bounds", lambda: filtered(GRID, 0.1, value))


def test_steps_by_time_need_the_times():
    refuses("no-time", lambda: filtered(GRID, 0.1, 0.1, by_time=True).simulate(None, [0.0]))
