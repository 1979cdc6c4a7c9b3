"""A compensator over a record is the compensator over each of its sequences."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import AbstractCompensator, DeadBandCompensator, Status, estimate, invert
from compensate.internal import BracketedCompensator, Estimate
from hysteresis import Burgers, InputError, LinearSponge, PrandtlIshlinskii, Preisach, Record
from hysteresis.preisach import GridDensity
from tests.problems import HIGH, LOW, weights
from tests.thorough import rest_thorough

BURGERS = Burgers(2.0, 40.0, 1.0, 5.0)
GRID = Preisach(GridDensity(LOW, HIGH, weights(np.random.default_rng(0))), jnp.full(7, 0.5))
PLAYS = PrandtlIshlinskii(jnp.array([0.5]), jnp.array([1.0]), jnp.asarray(1.0), jnp.array([0.1]))
COMPENSATORS = {
    "Preisach": invert(GRID),
    "Burgers": invert(BURGERS),
    "plays that move with the rate": invert(PLAYS),
    "bisection": BracketedCompensator(GRID, LOW, HIGH),
    "dead band": DeadBandCompensator(invert(GRID), 0.1),
    "draws": invert(
        jax.tree.map(lambda *x: jnp.stack(x), BURGERS, Burgers(3.0, 60.0, 2.0, 9.0)), 0.1, seed=3
    ),
}


def record(seed: int, lengths: list[int], gaps: float = 0.0) -> Record:
    """Sequences of these lengths with a clock of their own, uneven."""
    rng = np.random.default_rng(seed)
    n = sum(lengths)
    t = np.concatenate([rng.normal() + np.cumsum(rng.uniform(0.1, 1, k)) for k in lengths])
    u = rng.uniform(LOW, HIGH, n)
    y = np.where(rng.random(n) < gaps, np.nan, rng.uniform(-3, 3, n))
    groups = np.repeat(np.arange(len(lengths)), lengths)
    return Record.from_arrays(u, y, t, groups, nan="omit")


@pytest.mark.parametrize("name", rest_thorough(COMPENSATORS, 2))
@settings(max_examples=8)
@given(
    seed=st.integers(0, 2**31),
    lengths=st.lists(st.sampled_from([1, 5, 8]), min_size=1, max_size=4),
    gaps=st.sampled_from([0.0, 0.3]),
)
def test_it_is_simulate_of_each_sequence(name: str, seed: int, lengths: list[int], gaps: float):
    """Of a single sample, of a power of two, and of a length that is made longer to one."""
    compensator, data = COMPENSATORS[name], record(seed, lengths, gaps)
    # NumPy's rows: JAX would compile a program for each slice.
    found = jax.tree.map(np.asarray, estimate(compensator, data))
    for _, rows in data.sequences():
        alone = compensator.simulate(data.time[rows], data.output[rows])
        # The parallel recurrence of Burgers adds up in another order where there are more samples.
        jax.tree.map(
            lambda whole, part, rows=rows: np.testing.assert_allclose(
                whole[..., rows], part, rtol=1e-9, atol=1e-9
            ),
            found,
            alone,
        )
    np.testing.assert_array_equal(found.status == Status.INVALID, np.isnan(data.output))


class Watched(AbstractCompensator[Any, Estimate]):
    """Another compensator, and the lengths that it was asked for."""

    inner: AbstractCompensator
    lengths: list[int] = eqx.field(static=True)

    def init(self):
        return self.inner.init()

    def stream(self, t, y, state):
        self.lengths.append(len(y))
        return self.inner.stream(t, y, state)


def test_few_lengths_are_compiled():
    """A program for each power of two, not for each length."""
    watched = Watched(invert(LinearSponge(2.0, 1.0)), [])
    estimate(watched, record(0, list(range(1, 65))))
    assert len(watched.lengths) == 64
    assert set(watched.lengths) == {1, 2, 4, 8, 16, 32, 64}


def test_without_a_clock_and_without_rows():
    u = np.linspace(0, 1, 5)
    found = estimate(invert(GRID), Record.from_arrays(u, u))
    assert found.value.shape == (5,)
    with pytest.raises(InputError, match="no rows"):
        estimate(invert(GRID), Record.from_arrays([], []))
