"""Several contacts at once: the filter finds the forces that made the readings, and says how well."""

from functools import cache
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from compensate import Quantity, Status
from compensate.internal import (
    ChannelSensor,
    ForceNetwork,
    MotionFilter,
    MultiContactEstimator,
    SearchEstimator,
)
from compensate.microchannel import export_contacts
from compensate.runtime import load
from hysteresis import PrandtlIshlinskii
from hysteresis.internal import StaircaseNetwork
from hysteresis.rigs import MicrochannelRig
from tests.refusals import refuses

GAINS = np.array([[1.0, 0.5], [0.6, 1.0]])
MODELS = (
    PrandtlIshlinskii(np.array([0.3, 1.0]), np.array([0.05, 0.05]), 0.4),
    PrandtlIshlinskii(np.array([0.5]), np.array([0.1]), 0.3),
)
SENSOR = ChannelSensor(MODELS, GAINS)
NOISE = 0.01
ESTIMATOR = MultiContactEstimator(SENSOR, [NOISE, NOISE], MotionFilter(8.0, ways=6, delay=3))
T = 0.02 * np.arange(100)


def forces(seed: int) -> np.ndarray:
    """Straight from turn to turn, each contact at times of its own."""
    random = np.random.default_rng(seed)
    paths = []
    for _ in MODELS:
        at = np.concatenate([[0.0], np.sort(random.uniform(0.2, 1.8, 3)), [2.0]])
        paths.append(np.interp(T, at, np.concatenate([[0.0], random.uniform(1, 7, 3), [0.0]])))
    return np.stack(paths, 1)


def readings(force: np.ndarray, seed: int) -> np.ndarray:
    parts = [np.asarray(m.simulate(None, f)) for m, f in zip(MODELS, force.T, strict=True)]
    clean = np.stack(parts, 1) @ GAINS.T
    return clean + NOISE * np.random.default_rng(seed).normal(size=clean.shape)


TRUTH = [forces(seed) for seed in range(4)]
READ = [readings(force, seed) for seed, force in enumerate(TRUTH)]


@cache  # and not while the tests are collected, which every process does
def estimates() -> list[Any]:
    return [ESTIMATOR.simulate(T, read) for read in READ]


def test_the_forces_are_found():
    """One reading alone leaves 0.02/0.4 = 0.05 N, the two contacts apart; what moves steadily is known
    better, and better still three readings later."""
    now = np.concatenate([np.asarray(f.value) - F for f, F in zip(estimates(), TRUTH, strict=True)])
    pairs = zip(estimates(), TRUTH, strict=True)
    late = np.concatenate([np.asarray(f.late)[3:] - F[:-3] for f, F in pairs])
    assert np.sqrt(np.mean(now**2)) < 0.05
    assert np.sqrt(np.mean(late**2)) < 0.8 * np.sqrt(np.mean(now**2))


def test_the_deviations_are_honest():
    """800 forces, of which neighbours err alike: 90 % bands hold 90 % to 4 % or so, and with turns that
    are not those the filter expects somewhat fewer."""
    held = [
        np.abs(np.asarray(f.value) - F) < 1.645 * np.asarray(f.deviation)
        for f, F in zip(estimates(), TRUTH, strict=True)
    ]
    assert 0.8 < np.mean(held) < 0.98


def test_a_stream_is_the_batch():
    """To rounding, which the deviations' subtractions amplify."""
    state, step = ESTIMATOR.init(), eqx.filter_jit(type(ESTIMATOR).step)
    for k in range(20):
        state, found = step(ESTIMATOR, state, T[k], READ[0][k])
    np.testing.assert_allclose(found.value, estimates()[0].value[19], atol=1e-9)


def test_a_missing_reading_is_held_and_goes_on():
    z = READ[0].copy()
    z[50:60, 1] = np.nan
    found = ESTIMATOR.simulate(T, z)
    assert (np.asarray(found.status)[50:60] == Status.INVALID).all()
    np.testing.assert_array_equal(found.value[50:60], np.tile(found.value[49], (10, 1)))
    # Ten samples later it is as good as if nothing had been.
    off = np.asarray(found.value)[70:] - TRUTH[0][70:]
    assert np.sqrt(np.mean(off**2)) < 0.06


def test_readings_that_no_forces_make_are_told():
    z = READ[0].copy()
    z[50:] = [0.0, 3.0]  # the second location alone would read 1.5 there
    status = np.asarray(ESTIMATOR.simulate(T, z).status)
    assert (status[:50] != Status.EXTRAPOLATED).all()
    assert (status[51:70] == Status.EXTRAPOLATED).all()


def test_bad_settings_are_answered():
    refuses("wrong-channels", lambda: ChannelSensor(MODELS, np.ones((2, 3))))
    refuses("bad-deviation", lambda: MultiContactEstimator(SENSOR, [0.0], MotionFilter(8.0)))
    refuses("parameter-out-of-bounds", lambda: MotionFilter(8.0, turn=0.0))
    refuses("wrong-channels", lambda: ESTIMATOR.simulate(T, READ[0][:, :1]))
    refuses("bad-option", lambda: SearchEstimator([]))


def test_without_jax_it_is_the_same_where_readings_surprise(tmp_path: Path):
    """Networks that were never trained: many readings surprise all ways, which begin anew."""
    record = MicrochannelRig(seed=11).cnc_loops(120)
    t, force, z = record.time, record.force[:, :1], record.reading
    networks = [
        StaircaseNetwork.random(
            [force[:, 0]], [column], [t], jax.random.key(k), thresholds=(0.1, 0.4), lags=(0.2,), hidden=(6,)
        )
        for k, column in enumerate(z.T)
    ]  # fmt: skip
    sensor = ChannelSensor(networks, GAINS)
    estimator = MultiContactEstimator(sensor, [0.05, 0.05], MotionFilter(8.0))
    channels, contacts = ([Quantity(n, unit) for n in "ab"] for unit in ("V", "N"))
    names = {"channels": channels, "contacts": contacts}
    file = export_contacts(estimator, tmp_path / "it.json", z, t, **names)
    runtime, wanted = load(file), estimator.simulate(t, z)
    found = [runtime.step(*now) for now in zip(np.diff(t, prepend=t[0]), z.tolist(), strict=True)]
    status = [one.status for one in found]
    assert status.count(Status.EXTRAPOLATED) > 20
    np.testing.assert_array_equal(status, wanted.status)
    # Rounding of exponents of squared surprises, some hundred.
    np.testing.assert_allclose([one.value for one in found], wanted.value, atol=1e-9)
    np.testing.assert_allclose([one.deviation for one in found], wanted.deviation, atol=1e-9)


# The paper's method


def network(seed: int) -> ForceNetwork:
    return ForceNetwork.random(jax.random.key(seed), hidden=6, dense=5)


def test_dropout_leaves_out_half_while_training_alone():
    key, force = jax.random.key(0), jnp.ones((1, 20))
    trained, running = network(0), eqx.nn.inference_mode(network(0))
    assert not np.allclose(trained(force, key), trained(force))
    np.testing.assert_array_equal(running(force, key), trained(force))


def test_the_search_finds_forces_on_its_grid():
    """Networks that only look at the last force, of readings that no other pair makes."""

    class Last(eqx.Module):
        gain: jax.Array

        def __call__(self, force: jax.Array) -> jax.Array:
            return force[:, -1:] * self.gain[None]

    networks = tuple(Last(jnp.asarray(column)) for column in GAINS.T)
    search = SearchEstimator(networks)
    steps = np.random.default_rng(0).integers(-4, 5, (40, 2))
    wanted = np.zeros((41, 2))
    for k, step in enumerate(steps):
        wanted[k + 1] = np.maximum(wanted[k] + 0.1 * step, 0.0)
    found = search.simulate(None, wanted[1:] @ GAINS.T)
    np.testing.assert_allclose(found, wanted[1:], atol=1e-9)
