"""Curves without memory, the linear sponge among them, and models on wider inputs."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

from hysteresis import FoamCurve, LinearSponge, MonotoneCurve, Scaled, Series, Sum
from hysteresis.curves import Clip, MonotoneSpline, PolynomialCurve
from hysteresis.internal import extended
from hysteresis.preisach import GridDensity, Preisach
from tests.problems import histories
from tests.refusals import refuses
from tests.thorough import rest_thorough

sizes = st.floats(0.01, 100.0)


def slope(model: Any, u: jax.Array) -> np.ndarray:
    return np.asarray(jax.jvp(model.curve, (u,), (jnp.ones_like(u),))[1])


@given(parts=st.tuples(*[sizes] * 6), toe=st.floats(0.001, 0.999), rounding=st.floats(0.01, 100))
def test_foam_rises_everywhere(parts: tuple[float, ...], toe: float, rounding: float):
    """By at least its smallest stiffness, but for the rounding of lengths and stiffnesses."""
    linear, plateau, *lengths, dense = parts
    model = FoamCurve(linear, toe, plateau, lengths[0], lengths[1], lengths[2], rounding, dense)
    u = jnp.linspace(-2.0, 2.0, 101) * sum(lengths)
    assert slope(model, u).min() >= linear * min(toe, plateau, 1.0) * (1 - 1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_polygon_is_numpys_inside_and_goes_straight_on(seed: int):
    rng = np.random.default_rng(seed)
    nodes, increments = np.cumsum(rng.uniform(0.1, 1, 6)), rng.uniform(0, 1, 5)
    model = MonotoneCurve(nodes, increments, 0.7)
    y = 0.7 + np.append(0, increments.cumsum())
    u = np.append(rng.uniform(nodes[0], nodes[-1], 20), nodes)
    np.testing.assert_allclose(model.simulate(None, u), np.interp(u, nodes, y), atol=1e-14)
    ends = np.array([nodes[0] - 2.0, nodes[-1] + 3.0])
    wanted = [
        y[0] - 2 * increments[0] / (nodes[1] - nodes[0]),
        y[-1] + 3 * increments[-1] / (nodes[-1] - nodes[-2]),
    ]
    np.testing.assert_allclose(model.simulate(None, ends), wanted, rtol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
def test_spline_is_the_integral_of_a_polygon(seed: int):
    """SciPy's quadratic spline of the same slopes, straight on beyond; so its slope is continuous."""
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(rng.uniform(0.1, 1, 6))
    slopes = np.where(rng.random(6) < 0.3, 0.0, rng.uniform(0, 2, 6))
    model = MonotoneSpline(nodes, slopes, 0.7)
    whole = make_interp_spline(nodes, slopes, k=1).antiderivative()
    u = np.concatenate([rng.uniform(nodes[0], nodes[-1], 20), nodes])
    # Sums of a few numbers of the output's size.
    np.testing.assert_allclose(model.simulate(None, u), 0.7 + whole(u), rtol=0, atol=1e-14 * 10)
    steep = np.interp(u, nodes, slopes)
    np.testing.assert_allclose(slope(model, jnp.asarray(u)), steep, atol=1e-13)
    ends = np.array([nodes[0] - 2.0, nodes[-1] + 3.0])
    wanted = [0.7 - 2 * slopes[0], 0.7 + whole(nodes[-1]) + 3 * slopes[-1]]
    np.testing.assert_allclose(model.simulate(None, ends), wanted, rtol=0, atol=1e-13)
    # Linear in slopes and offset.
    twice = MonotoneSpline(nodes, 2 * slopes, 1.4)
    once = np.asarray(model.simulate(None, u))
    np.testing.assert_allclose(twice.simulate(None, u), 2 * once, rtol=1e-14)


def test_polynomial_is_numpys_inside_and_tangent_beyond():
    c = np.array([0.3, 1.0, -0.2, 0.4])
    model = PolynomialCurve(c, low=2.0, high=6.0)
    known = np.polynomial.Polynomial(c, domain=[2.0, 6.0])
    u = np.linspace(2.0, 6.0, 9)
    np.testing.assert_allclose(model.simulate(None, u), known(u), atol=1e-14)
    beyond = known(6.0) + 1.5 * known.deriv()(6.0)
    assert float(model.simulate(None, [7.5])[0]) == pytest.approx(beyond, rel=1e-14)


@pytest.mark.parametrize("model", [
    PolynomialCurve([0.1, 1.0, 0.2], 0.0, 3.0), Clip(0.5, 2.0),
    MonotoneSpline([0.0, 1.0, 1.5, 3.0], [0.5, 0.0, 2.0, 1.0], 0.2),
])  # fmt: skip
def test_curves_keep_the_contract(model: Any):
    """The laws of all models, on the ones that the table of problems does not hold."""
    u = np.random.default_rng(0).uniform(-1, 4, 30)
    whole = model.simulate(None, u)
    np.testing.assert_allclose(model.stream(None, u)[1], whole, rtol=0, atol=1e-14)
    gradient = jax.grad(lambda u: model.simulate(None, u).sum())(jnp.asarray(u))
    h = 1e-6
    difference = (model.simulate(None, u + h) - model.simulate(None, u - h)) / (2 * h)
    # Rounding over h: 1e-16 / 1e-6 of outputs of size 3.
    np.testing.assert_allclose(gradient, difference, atol=1e-8)


@pytest.mark.parametrize(("make", "code", "words"), [
    (lambda: MonotoneCurve([0.0, 1.0], [1.0, 2.0]), "length-mismatch", "(2,) and (2,)"),
    (lambda: MonotoneCurve([0.0], []), "length-mismatch", "(1,) and (0,)"),
    (lambda: MonotoneCurve([0.0, np.inf], [1.0]), "parameter-out-of-bounds", "finite"),
    (lambda: MonotoneCurve([0.0, 2.0, 1.0], [1.0, 1.0]), "parameter-out-of-bounds", "nodes"),
    (lambda: MonotoneCurve([0.0, 1.0], [-1.0]), "parameter-out-of-bounds", "increments"),
    (lambda: MonotoneSpline([0.0, 1.0], [1.0]), "length-mismatch", "as many nodes"),
    (lambda: MonotoneSpline([0.0, 1.0], [1.0, -1.0]), "parameter-out-of-bounds", "slopes"),
    (lambda: PolynomialCurve([1.0], 2.0, 2.0), "parameter-out-of-bounds", "below high"),
    (lambda: PolynomialCurve([]), "parameter-out-of-bounds", "coefficients"),
    (lambda: Clip(1.0, 0.0), "parameter-out-of-bounds", "below high"),
    (lambda: FoamCurve(1, 1.0, 1, 1, 1, 1, 1, 1), "parameter-out-of-bounds", "toe"),
    (lambda: FoamCurve(1, 0.5, 1, 1, 0.0, 1, 1, 1), "parameter-out-of-bounds", "linear_length"),
])  # fmt: skip
def test_bad_arguments_are_refused(make, code: str, words: str):
    refuses(code, lambda: make(), words)


@given(
    histories(0.0, 20.0), st.floats(0.1, 5.0), st.floats(-5.0, 5.0), st.sampled_from([-np.inf, 1.5])
)
def test_line_above_the_threshold(u: np.ndarray, K: float, b: float, threshold: float):
    y = np.asarray(LinearSponge(K, b, threshold).simulate(None, u))
    touched = u >= threshold
    # One product and one sum, each rounded, possibly fused.
    np.testing.assert_allclose(y[touched], (K * u + b)[touched], rtol=0, atol=1e-13)
    assert not y[~touched].any()


def test_contact_begins_at_the_threshold_itself():
    u = [np.nextafter(1.5, 0.0), 1.5]
    np.testing.assert_array_equal(LinearSponge(2.0, 1.0, 1.5).simulate(None, u), [0.0, 4.0])


CELLS = 6


def model(leading: bool = False, initial: object = "negative", nodes: object = None) -> Preisach:
    weights = np.tril(np.random.default_rng(0).uniform(0.1, 1.0, (CELLS, CELLS)))
    steep = 2 * (weights.sum(0) + weights.sum(1))
    return Preisach(
        GridDensity(0.0, 1.0, weights, nodes=nodes), steep, 0.3, leading=leading, initial=initial
    )  # type: ignore[arg-type]


UNEVEN = tuple(np.linspace(0, 1, CELLS + 1) ** 1.5)
CASES = rest_thorough([
    model(initial=(0.7, 0.2, 0.5)), model(nodes=UNEVEN), Sum([model(), model(True)]),
    Scaled(model(), -2.0, 1.0), Series([MonotoneCurve.even(0.0, 1.0, np.array([0.2, 0.8])), model()]),
    model(), model(True), model(initial="positive"), model(initial="demagnetised"),
], 3)  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_inside_nothing_changes(case: Any):
    # One long history: every length of the memory would be compiled anew.
    u = np.random.default_rng(3).uniform(0, 1, 400)
    u[::40], u[20::40] = 0.0, 1.0
    wide = extended(case, -0.4, 1.7)
    # Sums of some two hundred masses up to 1, rounded.
    np.testing.assert_allclose(wide.simulate(None, u), case.simulate(None, u), rtol=0, atol=1e-11)  # type: ignore[attr-defined]


@pytest.mark.parametrize("case", CASES)
def test_the_output_is_continuous_at_the_seam_and_rises_beyond(case: Any):
    wide = extended(case, -0.4, 1.7)
    for path in (np.linspace(0.9, 1.7, 81), np.linspace(0.1, -0.4, 81)):
        y = np.asarray(wide.simulate(None, np.concatenate([[path[0]], path])))[1:]
        step = np.diff(y) * (-1 if isinstance(case, Scaled) else 1) * np.sign(path[-1] - path[0])
        assert np.all(step > 0)
        assert step.max() < 0.05 * np.ptp(y)  # no jump: four times the mean step of 80


def test_other_models_are_given_back():
    line = LinearSponge(1.0, 0.0)
    assert extended(line, -9.0, 9.0) is line
    within = model()
    assert extended(within, 0.2, 0.8) is within
    masses = jnp.ones((CELLS, CELLS))
    fitted = Preisach(GridDensity(0.0, 1.0, masses), up=0.5 * masses)
    assert extended(fitted, -1.0, 2.0) is fitted
