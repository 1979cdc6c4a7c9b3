"""The closed-form inverse of the Prandtl-Ishlinskii model, both ways and in both of its forms."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import AbstractCompensator, Status, invert
from compensate.internal import Estimate
from hysteresis import PrandtlIshlinskii
from tests.problems import SAMPLES, clock, histories

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
