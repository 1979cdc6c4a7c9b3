"""The bracketed inverse: the exact ones' answer where there is one, and honest statuses elsewhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compensate import Status, invert
from compensate.internal import BracketedCompensator, Estimate
from hysteresis import InputError, Preisach
from hysteresis.preisach import GaussianDensity, GridDensity
from tests.problems import HIGH, LOW, SAMPLES, random_histories, weights

ROWS = 20
WIDE = GaussianDensity(LOW, HIGH, 1.0, 0.4, 0.4, (LOW + HIGH) / 2, 0.4)


def both_ways(model, compensator, t, u) -> tuple[np.ndarray, Estimate, np.ndarray]:
    """The outputs of rows of inputs, what the compensator makes of them, and their outputs again."""

    forward = jax.jit(jax.vmap(lambda row: model.simulate(t, row)))
    y = forward(jnp.asarray(u))
    found = jax.jit(jax.vmap(lambda row: compensator.simulate(t, row)))(y)
    return np.asarray(y), found, np.asarray(forward(found.value))


def drawn(low: float = LOW, high: float = HIGH) -> np.ndarray:
    return random_histories(np.random.default_rng(0), low, high, (ROWS, SAMPLES))


def test_equal_to_the_exact_inverse_on_a_grid():
    rng = np.random.default_rng(1)
    model = Preisach(GridDensity(LOW, HIGH, weights(rng)), rng.uniform(0.1, 0.5, 7), 0.3)
    u = drawn()
    y, found, again = both_ways(model, BracketedCompensator(model, LOW, HIGH), None, u)
    exact = jax.jit(jax.vmap(lambda row: invert(model).simulate(None, row)))(jnp.asarray(y))
    # 32 roundings of the output over a slope of a tenth of the mean one.
    np.testing.assert_allclose(found.value, exact.value, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.status, Status.OK)
    assert np.abs(again - y).max() <= 1e-13 * np.ptp(y)


@pytest.mark.thorough
def test_a_density_that_vanishes_is_flat_where_it_does():
    """Without a reversible part: every output comes back, on a way up the input where it is OK."""
    model = Preisach(GaussianDensity(LOW, HIGH, 1.0, 0.3, 0.05, 0.5, 0.05))
    u = drawn()
    u[0] = np.linspace(LOW, HIGH, SAMPLES)
    y, found, again = both_ways(model, invert(model), None, u)
    assert np.abs(again - y).max() <= 1e-9 * np.ptp(y)
    status, error = np.asarray(found.status), np.abs(np.asarray(found.value) - u)
    assert set(np.unique(status)) == {Status.OK, Status.FLAT}
    sure = status[0] == Status.OK
    # The density is normal in alpha too, about 0.8 with a deviation of 0.07: nothing at 0 or 1.6.
    np.testing.assert_array_equal(sure[[0, 13, 24, 35, 39]], [False, False, True, False, False])
    assert error[0, sure].max() <= 1e-6 * (HIGH - LOW)


def test_out_of_reach_and_invalid_samples():
    assert isinstance(invert(Preisach(WIDE, np.full(7, 0.2))), BracketedCompensator)
    grid = GridDensity(LOW, HIGH, weights(np.random.default_rng(2)))
    model = Preisach(grid, np.full(7, 0.2))
    compensator = BracketedCompensator(model, LOW, HIGH)
    middle, top, bottom = np.asarray(model.simulate(None, [0.4, HIGH, LOW]))
    nan, inf = np.nan, np.inf
    y = np.array([nan, middle, top + 1, nan, bottom - 1, inf, middle])
    found = compensator.simulate(None, y)
    invalid, ok, out = Status.INVALID, Status.OK, Status.SATURATED
    np.testing.assert_array_equal(found.status, [invalid, ok, out, invalid, out, invalid, ok])
    np.testing.assert_allclose(found.value, [LOW, 0.4, HIGH, HIGH, LOW, LOW, 0.4], atol=1e-12)


def test_leading_models_need_a_grid():
    with pytest.raises(
        InputError, match=r"leading model with a GaussianDensity.*\[not-invertible\]"
    ):
        invert(Preisach(WIDE, np.full(3, 100.0), leading=True))
