"""The dead band against a plain loop, and what it does to noise."""

import equinox as eqx
import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import InputError, Preisach
from hysteresis.preisach import GridDensity, input_noise
from tests.problems import CELLS, HIGH, LOW, histories, play, weights
from tests.refusals import refuses

seeds = st.integers(0, 2**32 - 1)
HALF_WIDTH = 0.3


def model(seed: int, dead_band: float) -> Preisach:
    rng = np.random.default_rng(seed)
    density = GridDensity(LOW, HIGH, weights(rng))
    return Preisach(density, rng.random(CELLS), rng.normal(), dead_band=dead_band)


@eqx.filter_jit
def simulate(model: Preisach, u: np.ndarray) -> jax.Array:
    return model.simulate(None, u)


def output(model: Preisach, u: np.ndarray) -> np.ndarray:
    return np.asarray(simulate(model, u))


@given(seed=seeds, u=histories(LOW - 1, HIGH + 1))
def test_relays_see_the_play_and_the_reversible_part_the_input(seed: int, u: np.ndarray):
    v = play(u, HALF_WIDTH)
    plain, banded = model(seed, 0.0), model(seed, HALF_WIDTH)
    memoryless = Preisach(GridDensity(LOW, HIGH, np.zeros((CELLS, CELLS))), plain.reversible)
    wanted = output(plain, v) + output(memoryless, u) - output(memoryless, v)
    # Additions of numbers of size one.
    np.testing.assert_allclose(output(banded, u), wanted, rtol=0, atol=1e-12)
    np.testing.assert_allclose(banded.stream(None, u)[1], wanted, rtol=0, atol=1e-12)


@given(seed=seeds, sigma=st.floats(1e-3, 10.0))
@settings(max_examples=25)
def test_input_noise_of_a_smooth_path(seed: int, sigma: float):
    """The median of 5,000 such correlated differences scatters by 2 %: five times that."""
    k = np.arange(5000)
    path = 1e3 * sigma * np.sin(2 * np.pi * k / 5000) + np.where(k > 2500, 1e4 * sigma, 0.0)
    noisy = path + np.random.default_rng(seed).normal(0, sigma, len(k))
    assert input_noise(noisy) == pytest.approx(sigma, rel=0.1)


def test_what_is_refused():
    refuses("too-few-rows", lambda: input_noise(np.array([1.0, 2.0])))
    for wrong in (-0.1, np.nan, np.inf):
        with pytest.raises(InputError, match="bad-option"):
            model(0, wrong)
