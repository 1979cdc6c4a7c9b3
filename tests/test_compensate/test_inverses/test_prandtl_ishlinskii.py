"""The closed-form inverse of the Prandtl-Ishlinskii model, both ways and in both of its forms."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import AbstractCompensator, Estimate, Status, invert
from hysteresis import InputError, PrandtlIshlinskii
from tests.problems import SAMPLES, clock, histories, without

LOW, HIGH = -3.0, 3.0
PLAYS = 4
seeds = st.integers(0, 2**32 - 1)
flags = st.booleans()


def draw(seed: int, leading: bool = False, bent: bool = True, rates: bool = False):
    rng = np.random.default_rng(seed)
    return PrandtlIshlinskii(
        np.cumsum(rng.uniform(0.1, 0.4, PLAYS)),
        rng.uniform(0.0, 1.0, PLAYS),
        rng.uniform(0.5, 2.0),
        rng.normal(),
        rates=rng.uniform(0, 0.1, PLAYS) if rates else None,
        bends=np.array([-1.5, 0.4, 2.0]) if bent else None,
        bend_slopes=rng.uniform(-0.3, 0.6, 3) if bent else None,
        leading=leading,
    )


@eqx.filter_jit
def forward(model: PrandtlIshlinskii, t: Any, u: Any) -> jax.Array:
    return model.simulate(t, u)


@eqx.filter_jit
def backward(compensator: AbstractCompensator, t: Any, y: Any, state: Any = None) -> Estimate:
    return compensator.simulate(t, y, state)


@eqx.filter_jit
def streamed(compensator: AbstractCompensator, t: Any, y: Any) -> tuple[Any, Estimate]:
    step = lambda state, sample: compensator.step(state, *sample)  # noqa: E731
    return jax.lax.scan(step, compensator.init(), (t, y))


@settings(max_examples=100)
@given(seed=seeds, u=histories(LOW, HIGH), leading=flags, bent=flags, rates=flags)
def test_round_trips(seed: int, u: np.ndarray, leading: bool, bent: bool, rates: bool):
    """Both ways to 1e-12 of the range: any history is an input, and any is an output."""
    model, t = draw(seed, leading, bent, rates), jnp.asarray(clock(seed))
    compensator = invert(model)
    for y in (forward(model, t, jnp.asarray(u)), jnp.asarray(u)):
        found = backward(compensator, t, y)
        np.testing.assert_array_equal(found.status, Status.OK)
        np.testing.assert_allclose(forward(model, t, found.value), y, rtol=0, atol=1e-12 * HIGH)
    found = backward(compensator, t, forward(model, t, jnp.asarray(u)))
    np.testing.assert_allclose(found.value, u, rtol=0, atol=1e-12 * HIGH)


@given(seed=seeds, y=histories(LOW, HIGH), leading=flags, rates=flags)
def test_batch_is_the_stream_and_a_state_may_be_carried(
    seed: int, y: np.ndarray, leading: bool, rates: bool
):
    t, compensator = clock(seed), invert(draw(seed, leading, True, rates))
    y[np.random.default_rng(seed).random(SAMPLES) < 0.2] = np.nan
    _, wanted = streamed(compensator, t, y)
    found = backward(compensator, t, y)
    half = SAMPLES // 2
    state, _ = streamed(compensator, t[:half], y[:half])
    rest = backward(compensator, t[half:], y[half:], state)
    # The same operations on the same numbers, fused differently.
    for got, part in ((found, slice(None)), (rest, slice(half, None))):
        np.testing.assert_allclose(got.value, wanted.value[part], rtol=0, atol=1e-13 * HIGH)
        np.testing.assert_array_equal(got.status, wanted.status[part])


@pytest.mark.parametrize("rates", [False, True])
def test_samples_that_are_not_finite_are_held_and_leave_no_trace(rates: bool):
    model, rng = draw(1, rates=rates), np.random.default_rng(0)
    compensator, t = invert(model), clock(0)
    y = rng.uniform(LOW, HIGH, SAMPLES)
    hole = rng.random(SAMPLES) < 0.3
    hole[:2] = True
    y[hole] = rng.choice([np.nan, np.inf, -np.inf], hole.sum())
    value, status = map(np.asarray, compensator.simulate(t, y))
    np.testing.assert_array_equal(status, np.where(hole, Status.INVALID, Status.OK))
    np.testing.assert_array_equal(value[:2], 0.0)  # at first the input rests at 0
    np.testing.assert_array_equal(value[1:][hole[1:]], value[:-1][hole[1:]])
    alone = compensator.simulate(*without(hole, t, y)).value[: (~hole).sum()]
    np.testing.assert_allclose(alone, value[~hole], rtol=0, atol=1e-13 * HIGH)


def test_draws_are_inverted_together():
    models = [draw(seed) for seed in range(3)]
    many = jax.tree.map(lambda *x: jnp.stack(x), *models)
    y = np.random.default_rng(0).uniform(LOW, HIGH, SAMPLES)
    found = eqx.filter_vmap(lambda model: invert(model).simulate(None, y).value)(many)
    for model, value in zip(models, found, strict=True):
        np.testing.assert_allclose(value, backward(invert(model), None, y).value, atol=1e-12)


def test_gradients_pass_through_the_inverse():
    """d(model(inverse(y))) = dy, by the chain of both, forwards."""
    rng, t = np.random.default_rng(0), jnp.asarray(clock(0))
    y, c = map(jnp.asarray, rng.uniform(LOW, HIGH, (2, SAMPLES)))
    for rates in (False, True):
        model = draw(2, rates=rates)

        def there_and_back(y: jax.Array, model: PrandtlIshlinskii = model) -> jax.Array:
            return model.simulate(t, invert(model).simulate(t, y).value)

        found = jax.jit(lambda y, dy: jax.jvp(there_and_back, (y,), (dy,))[1])(y, c)
        np.testing.assert_allclose(found, c, rtol=0, atol=1e-11)


def test_time_is_needed_where_the_rate_matters():
    compensator = invert(draw(0, rates=True))
    with pytest.raises(InputError, match="no-time"):
        compensator.simulate(None, np.ones(3))
