"""Our Levenberg-Marquardt takes the steps of optimistix's, alone and side by side."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from jax import Array

from identify.parametric._levenberg_marquardt import levenberg_marquardt

X = jnp.linspace(0.0, 4.0, 9)
Y = 2.0 * jnp.exp(-0.7 * X) + 0.05 * jnp.cos(9 * X)


def decay(z: Array) -> Array:
    return z[0] * jnp.exp(-z[1] * X) - Y


def valley(z: Array) -> Array:
    """Rosenbrock's."""
    return jnp.stack([10 * (z[1] - z[0] ** 2), 1 - z[0]])


def flat(z: Array) -> Array:
    """One of two parameters changes nothing."""
    return jnp.stack([z[0] - 3, z[0] ** 2 - 9, 0 * z[1]])


def edge(z: Array) -> Array:
    """Not finite where a full step leads at first."""
    return jnp.log(z) - jnp.log(jnp.array([4.0, 0.5]))


@pytest.mark.parametrize("residuals", [decay, valley, flat, edge], ids=lambda f: f.__name__)
def test_it_takes_the_steps_of_optimistix(residuals: Callable[[Array], Array]):
    starts = jnp.array([[1.0, 2.0], [5.0, 0.1], [0.1, 0.1]])

    def theirs(z: Array) -> tuple[Array, Array, Array]:
        solver = optimistix.LevenbergMarquardt(rtol=1e-9, atol=1e-9)
        found = optimistix.least_squares(
            lambda z, _: residuals(z), solver, z, max_steps=60, throw=False
        )
        arrived = found.result == optimistix.RESULTS.successful
        return found.value, arrived, found.stats["num_steps"]

    ours = jax.jit(jax.vmap(lambda z: levenberg_marquardt(residuals, z, 60, 1e-9)))(starts)
    value, arrived, steps = jax.jit(jax.vmap(theirs))(starts)
    np.testing.assert_allclose(ours.value, value, rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(ours.converged, arrived)
    # At the minimum rounding decides whether one more step is taken.
    np.testing.assert_allclose(ours.steps, steps, atol=1)
    assert ours.converged.any()


def test_it_stops_where_it_is_told_to_and_where_nothing_is_finite():
    start = jnp.array([5.0, 0.1])
    early = levenberg_marquardt(valley, start, 3, 1e-9)
    assert (int(early.steps), bool(early.converged)) == (3, False)
    lost = levenberg_marquardt(lambda z: valley(z) + jnp.nan, start, 50, 1e-9)
    assert not bool(lost.converged)
    np.testing.assert_array_equal(lost.value, start)
