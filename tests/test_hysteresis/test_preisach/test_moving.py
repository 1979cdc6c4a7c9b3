"""Two Preisach models whose minor loops are not congruent: the moving and the output-dependent one."""

from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import (
    AbstractModel,
    InputError,
    MovingPreisach,
    OutputDependentPreisach,
    Preisach,
)
from hysteresis.preisach import GridDensity, saturated_outputs
from tests.problems import CELLS, HIGH, LOW, SAMPLES, histories, weights

EPS = np.finfo(float).eps
seeds = st.integers(0, 2**32 - 1)
beyond = histories(LOW - 0.5, HIGH + 0.5)
sides = st.sampled_from(["negative", "positive"])


def inner(
    seed: int,
    initial: Literal["negative", "positive"] = "negative",
    leading: bool = False,
) -> Preisach:
    rng = np.random.default_rng(seed)
    density, increments = GridDensity(LOW, HIGH, weights(rng)), rng.uniform(0.1, 0.5, CELLS)
    if leading:
        flat = Preisach(density, jnp.zeros(CELLS), leading=True).least_slope()
        increments -= np.asarray(flat) * ((HIGH - LOW) / CELLS)
    return Preisach(density, increments, rng.normal(), initial=initial, leading=leading)


def moving(model: Preisach, strength: float) -> MovingPreisach:
    """The feedback in parts of that which makes a branch vertical."""
    return MovingPreisach(model, strength / MovingPreisach(model, 0.0).steepest_slopes()[1])


def output_dependent(seed: int) -> OutputDependentPreisach:
    rng = np.random.default_rng(seed)
    return OutputDependentPreisach(inner(seed), rng.uniform(0.5, 2.0, 5), rng.normal())


@eqx.filter_jit
def simulate(model: AbstractModel, u: Any) -> jax.Array:
    return model.simulate(None, u)


def output(model: AbstractModel, u: np.ndarray) -> np.ndarray:
    return np.asarray(simulate(model, jnp.asarray(u)))


def size(model: AbstractModel) -> float:
    """Sum of what is added up to give an output."""
    return sum(float(np.abs(np.asarray(x)).sum()) for x in jax.tree.leaves(model))


@settings(max_examples=25)
@given(seed=seeds, u=beyond, strength=st.floats(-2.0, 0.9), initial=sides, leading=st.booleans())
def test_the_output_is_that_of_the_inner_model_on_the_helped_input(
    seed: int, u: np.ndarray, strength: float, initial: Any, leading: bool
):
    """h = u + feedback y is known with y: P[h] has to be y, within saturation and beyond."""
    model = moving(inner(seed, initial, leading), strength)
    y = output(model, u)
    again = output(model.inner, u + float(model.feedback) * y)
    # h is rounded; P is as steep as 1/feedback at most, and the branches add up their errors.
    steepest = max(map(abs, np.asarray(model.steepest_slopes()).tolist()))
    tolerance = 16 * SAMPLES * EPS * (size(model.inner) + steepest * (HIGH + 1)) / (1 - 0.9)
    np.testing.assert_allclose(again, y, rtol=0, atol=tolerance)


@given(seed=seeds, u=beyond, initial=sides)
def test_without_feedback_it_is_the_inner_model(seed: int, u: np.ndarray, initial: Any):
    model = inner(seed, initial)
    tolerance = 16 * SAMPLES * EPS * size(model)
    got = output(MovingPreisach(model, 0.0), u)
    np.testing.assert_allclose(got, output(model, u), rtol=0, atol=tolerance)


@given(seed=seeds, u=beyond)
def test_even_increments_scale_the_inner_model(seed: int, u: np.ndarray):
    model = inner(seed)
    low, high = map(float, saturated_outputs(model))
    got = output(OutputDependentPreisach(model, np.full(5, 0.4), 0.3), u)
    wanted = 0.3 + 2.0 * (output(model, u) - low) / (high - low)
    np.testing.assert_allclose(got, wanted, rtol=0, atol=16 * SAMPLES * EPS * size(model))


MODELS = [
    pytest.param(lambda seed: moving(inner(seed), 0.5), id="moving"),
    pytest.param(output_dependent, id="output-dependent"),
]


@pytest.mark.parametrize("draw", MODELS)
@given(seed=seeds, past=histories(LOW, HIGH, 20), inside=histories(0.0, 1.0, 18))
def test_return_point_memory(draw: Any, seed: int, past: np.ndarray, inside: np.ndarray):
    """However the input moves between its last reversal and itself, coming back restores y."""
    model, x, bottom = draw(seed), past[-1], LOW - 1
    u = np.concatenate([past, [bottom, x], bottom + inside * (x - bottom), [x]])
    y = output(model, u)
    assert abs(y[-1] - y[len(past) + 1]) <= 64 * SAMPLES * EPS * size(model)


@pytest.mark.parametrize("draw", MODELS)
def test_minor_loops_between_the_same_limits_are_not_congruent(draw: Any):
    """The same loop at the bottom and at the top of the major one: another height, not only in rounding."""
    model = draw(0)
    heights = []
    for one in (model, model.inner):
        y = output(one, np.array([LOW - 1, 0.9, 0.2, 0.9, HIGH + 1, 0.2, 0.9, 0.2]))
        heights.append((y[1] - y[2], y[6] - y[7]))
    (low, high), (inner_low, inner_high) = heights
    assert abs(high - low) > 0.05 * abs(low)
    assert abs(inner_high - inner_low) <= 16 * EPS * size(model)


def test_derivatives_beyond_saturation():
    """Against central differences, as within saturation for every model of the table."""
    rng = np.random.default_rng(0)
    u = jnp.asarray(rng.uniform(LOW - 0.5, HIGH + 0.5, SAMPLES))
    c, model = jnp.asarray(rng.normal(size=SAMPLES)), moving(inner(0), 0.5)

    @jax.jit
    def value(feedback: jax.Array) -> jax.Array:
        return c @ simulate(eqx.tree_at(lambda m: m.feedback, model, feedback), u)

    k, h = jnp.asarray(model.feedback), 1e-6
    difference = (value(k + h) - value(k - h)) / (2 * h)
    slope = jax.jit(jax.grad(value))(k)
    assert abs(float(slope - difference)) <= 1e-6 * abs(float(slope))


def refused(code: str, *words: str):
    return pytest.raises(InputError, match=".*".join([*words, rf"\[{code}\]"]))


def test_a_feedback_that_gives_an_input_two_outputs_is_refused():
    model = inner(0)
    assert moving(model, 0.999).feedback > 0
    with refused("feedback-too-strong", "more than one output"):
        moving(model, 1.001)
    # Against a leading model's fall the same holds for a negative one.
    flat = Preisach(model.density, np.full(CELLS, 0.1), leading=True)
    least = float(MovingPreisach(flat, 0.0).steepest_slopes()[0])
    assert least < 0
    with refused("feedback-too-strong"):
        MovingPreisach(flat, 1.001 / least)
    MovingPreisach(flat, 0.999 / least)


def test_an_inner_model_that_does_not_start_saturated_is_refused():
    density = inner(0).density
    for options in ({"initial": "demagnetised"}, {"dead_band": 0.1}):
        with refused("bad-state", "starts saturated"):
            MovingPreisach(Preisach(density, **options), 0.0)


def test_increments_that_are_refused():
    with refused("output-falls", "-1"):
        OutputDependentPreisach(inner(0), [1.0, -1.0])
    with refused("wrong-shape"):
        OutputDependentPreisach(inner(0), np.ones((2, 2)))
