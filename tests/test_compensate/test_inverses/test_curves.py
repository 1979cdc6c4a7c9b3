"""Inverses of curves and of densities, by halving where there is no closed form."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensate import Status, invert
from compensate.internal import BracketedCompensator, Estimate
from hysteresis import BoucWen, FoamCurve, MonotoneCurve, Preisach
from hysteresis.curves import Clip, MonotoneSpline, PolynomialCurve
from hysteresis.preisach import GaussianDensity, GridDensity
from tests.problems import HIGH, LOW, SAMPLES, random_histories, weights
from tests.refusals import refuses

simulate = eqx.filter_jit(lambda model, u: model.simulate(None, u))
estimate = eqx.filter_jit(lambda model, y: invert(model).simulate(None, y))
RISING = PolynomialCurve([0.5, 1.0, 0.1, 0.3], 0.0, 4.0)
INFLECTION = PolynomialCurve([0.0, 0.0, 0.0, 1.0], -1.0, 1.0)


@pytest.mark.parametrize("model", [RISING, Clip(-5.0, 6.0), INFLECTION])
def test_there_and_back(model: Any):
    u = np.random.default_rng(0).uniform(-0.99, 0.99, 300)
    u = u if model is INFLECTION else 2 + 2 * u
    y = np.asarray(model.simulate(None, u))
    found = invert(model).simulate(None, y)
    assert set(np.unique(found.status).tolist()) == {Status.OK}
    # Halving an interval of 4 to a rounding, or y's rounding over a slope of half.
    again = model.simulate(None, found.value)
    np.testing.assert_allclose(again, y, rtol=0, atol=1e-14 * max(1.0, np.ptp(y)))


@given(decades=st.lists(st.floats(-2, 2), min_size=7, max_size=7), toe=st.floats(0.001, 0.999))
def test_foam_of_any_shape(decades: list[float], toe: float):
    """Newton's method alone does not come home from the flat toe to steep densification."""
    x = 10.0 ** np.array(decades)
    model = FoamCurve(x[0], toe, x[1], x[2], x[3], x[4], x[5], x[6])
    u = np.linspace(-1.0, 2.0, 40) * (x[2] + x[3] + x[4])
    y = np.asarray(model.simulate(None, u))
    found = invert(model).simulate(None, y)
    assert np.all(found.status == Status.OK)
    # Differences of sums of x^2, each rounded: a few roundings of the largest.
    size = x[0] * (1 + x[1] + x[6] * 3 * np.abs(u).max()) * 3 * np.abs(u).max()
    assert np.abs(np.asarray(model.simulate(None, found.value)) - y).max() <= 1e-14 * size


@given(
    seed=st.integers(0, 2**32 - 1),
    bend=st.sampled_from([0.0, 1e-16, 1e-12, 1e-6, 1.0]),
    level=st.sampled_from([0.0, 1e-9, 1.0]),
)
def test_spline_of_any_bend_there_and_back(seed: int, bend: float, level: float):
    """Slopes that hardly differ, where a textbook root cancels, and slopes of 0."""
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(rng.uniform(0.1, 1, 6))
    slopes = level + bend * np.where(rng.random(6) < 0.3, 0.0, rng.random(6))
    slopes[2] += 1.0
    model = MonotoneSpline(nodes, slopes, -0.3)
    u = np.concatenate([nodes, rng.uniform(nodes[0], nodes[-1], 34)])
    y = np.asarray(simulate(model, u))
    found = estimate(model, y)
    again = simulate(model, found.value)
    # Any input whose output is within 32 roundings of the largest is as good as another.
    np.testing.assert_allclose(again, y, rtol=0, atol=1e-14 * (1 + np.abs(y).max()))
    steep = np.interp(u, nodes, slopes) > 0.1
    np.testing.assert_allclose(np.asarray(found.value)[steep], u[steep], rtol=0, atol=1e-12)
    assert set(np.unique(found.status).tolist()) <= {Status.OK, Status.FLAT}


@pytest.mark.parametrize(("model", "place"), [
    # x - 2 x^3 has the least slope at the ends, x^3 - x/10 in the middle.
    (PolynomialCurve([0.0, 1.0, 0.0, -2.0], 0.0, 4.0), "at 0,"),
    (PolynomialCurve([0.0, -0.1, 0.0, 1.0], 0.0, 4.0), "at 2,"),
    (PolynomialCurve([3.0]), "does not rise"),
    (MonotoneCurve([0.0, 1.0], [0.0]), "does not rise"),
    (MonotoneSpline([0.0, 1.0], [0.0, 0.0]), "does not rise"),
])  # fmt: skip
def test_what_falls_is_refused_with_the_place(model: Any, place: str):
    refuses("not-invertible", lambda: invert(model), place)


@pytest.mark.parametrize("n", [0.5, 1.0, 2.5, 10.0])
@pytest.mark.parametrize("alpha", [0.0, 0.001, 1.0])
def test_bouc_wen_of_any_shape(n: float, alpha: float):
    """A posterior may go anywhere; without a stiffness after yield no way may be much beyond it."""
    rng = np.random.default_rng(1)
    model = BoucWen(3.0, alpha, 0.7, n, 0.4, -1.0)
    u = np.append(rng.uniform(-5, 5, 100) if alpha else rng.uniform(-0.5, 0.5, 100), 0.0)
    y = np.asarray(model.simulate(None, u))
    found = invert(model).simulate(None, y)
    assert np.all(found.status == Status.OK)
    again = np.asarray(model.simulate(None, found.value))
    assert np.abs(again - y).max() <= 1e-12 * np.ptp(y)


def test_bouc_wen_has_limits_without_a_line():
    model = BoucWen(2.0, 0.0, 0.5, 2.0, 0.0)
    found = invert(model).simulate(None, [0.5, 1.1, np.nan, -0.5, -3.0, 0.0])
    beyond, ok = Status.SATURATED, Status.OK
    np.testing.assert_array_equal(found.status, [ok, beyond, Status.INVALID, ok, beyond, ok])
    assert found.value[2] == found.value[1] == found.value[0]
    assert found.value[4] == found.value[3]


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
    model = Preisach(WIDE, np.full(3, 100.0), leading=True)
    refuses("not-invertible", lambda: invert(model), "leading model with a GaussianDensity")
