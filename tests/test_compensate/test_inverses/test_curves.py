"""Inverses of curves: there and back, the status beyond, and what has no inverse."""

from typing import Any

import equinox as eqx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensate import Status, invert
from hysteresis import BoucWen, FoamCurve, InputError, MonotoneCurve
from hysteresis.curves import Clip, MonotoneSpline, PolynomialCurve

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
    np.testing.assert_allclose(found.value[steep], u[steep], rtol=0, atol=1e-12)
    assert set(np.unique(found.status).tolist()) <= {Status.OK, Status.FLAT}


@pytest.mark.parametrize(
    ("model", "place"),
    [
        # x - 2 x^3 has the least slope at the ends, x^3 - x/10 in the middle.
        (PolynomialCurve([0.0, 1.0, 0.0, -2.0], 0.0, 4.0), "at 0,"),
        (PolynomialCurve([0.0, -0.1, 0.0, 1.0], 0.0, 4.0), "at 2,"),
        (PolynomialCurve([3.0]), "does not rise"),
        (MonotoneCurve([0.0, 1.0], [0.0]), "does not rise"),
        (MonotoneSpline([0.0, 1.0], [0.0, 0.0]), "does not rise"),
    ],
)
def test_what_falls_is_refused_with_the_place(model: Any, place: str):
    with pytest.raises(InputError) as caught:
        invert(model)
    assert caught.value.code == "not-invertible"
    assert place in str(caught.value)


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
