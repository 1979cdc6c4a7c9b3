"""What the benchmarks of the Preisach model run on: inputs, models, and their compiled calls."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, Preisach
from hysteresis.preisach import GridDensity

SAMPLES = 56_708
CELLS = 100


def modulated_sine(samples: int = SAMPLES) -> np.ndarray:
    """A sine in [0, 1] of 250 samples a period, modulated in frequency and amplitude.

    Longer ones repeat the first `SAMPLES`: its frequency is swept, and would go on rising.
    """
    k = np.arange(SAMPLES)
    knots = np.arange(0, SAMPLES + 250, 250)
    amplitude = np.interp(k, knots, np.random.default_rng(0).uniform(0.2, 1.0, len(knots)))
    wave = np.sin(2 * np.pi * k / 250 * (1 + 0.3 * np.sin(k / 3000)))
    return np.resize(np.clip(0.5 + 0.5 * wave * amplitude, 0.0, 1.0), samples)


def random_weights(cells: int = CELLS) -> np.ndarray:
    """Masses (cells, cells) between 0 and 1."""
    return np.random.default_rng(1).random((cells, cells))


def random_model(cells: int = CELLS) -> Preisach:
    """A model of the random masses."""
    return grid_model(jnp.asarray(random_weights(cells)))


def grid_model(weights: Any) -> Preisach:
    """A model of nothing but its (cells, cells) masses over [0, 1]."""
    return Preisach(GridDensity(0.0, 1.0, weights))


# Model and history are arguments: nothing is folded into the program.
@jax.jit
def evaluate(model: AbstractModel, prepared: Any) -> jax.Array:
    return model.evaluate(prepared)


@jax.jit
def look_up(model: Preisach, table: Any, prepared: Any) -> jax.Array:
    """`evaluate` with the Everett table at hand."""
    return model.look_up(table, prepared)


@jax.jit
def table(model: Preisach) -> Any:
    """The Everett table alone."""
    return model.density.tabulate()
