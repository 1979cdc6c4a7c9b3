"""The force of one contact: networks are models like any other, and estimators never raise in a loop."""

from functools import cache

import equinox as eqx
import jax
import numpy as np
import pytest

from compensate import Status
from compensate.internal import ForceEstimator
from hysteresis import InputError
from hysteresis.internal import StaircaseNetwork
from hysteresis.rigs import MicrochannelRig
from tests.problems import without
from tests.refusals import refuses

RECORD = MicrochannelRig(seed=11).cnc_loops(400)
T, F, Z = RECORD.time, RECORD.force[:, 0], RECORD.reading[:, 0]


@cache  # and not while the tests are collected, which every process does
def staircase() -> StaircaseNetwork:
    return StaircaseNetwork.random(
        [Z], [F], [T], jax.random.key(0), thresholds=(0.1, 0.4), lags=(0.2, 5.0), hidden=(8, 4)
    )


def test_a_batch_is_the_stream():
    """To rounding: sums over reversals of forces of 8 N, in another order."""
    batch = staircase().simulate(T, Z)
    _, stream = staircase().stream(T, Z)
    np.testing.assert_allclose(stream, batch, atol=1e-10)


def test_the_staircase_is_that_of_a_preisach_memory():
    """A loop inside a loop is wiped out: what was between two maxima leaves no trace."""
    long = np.array([0.0, 3.0, 1.0, 2.0, 1.2, 1.8, 4.0, 2.0])
    short = np.array([0.0, 4.0, 2.0])
    kept = slice(0, 3)  # the input and the plays, without what depends on time
    ends = [np.asarray(staircase().prepare(np.arange(len(u)), u))[-1, kept] for u in (long, short)]
    np.testing.assert_array_equal(ends[0], ends[1])


TWO = np.column_stack([Z, 0.4 * Z**2])


@cache
def several() -> StaircaseNetwork:
    return StaircaseNetwork.random(
        [TWO], [F], [T], jax.random.key(2), thresholds=(0.1, 0.3, 0.4), lags=(0.2, 5.0),
        hidden=(8, 4), rest=(0.1, 0.2), scale=(4.0, 6.0),
    )  # fmt: skip


def test_several_channels_keep_the_laws_of_a_model():
    batch = several().simulate(T, TWO)
    state, first = several().stream(T[:150], TWO[:150])
    np.testing.assert_allclose(first, batch[:150], atol=1e-10)
    rest = several().simulate(T[150:], TWO[150:], state)
    np.testing.assert_allclose(rest, batch[150:], atol=1e-10)
    both = several().prepare(np.tile(T, 2), np.tile(TWO, (2, 1)), starts=(0, len(T)))
    np.testing.assert_allclose(several().evaluate(both)[len(T) :], batch, atol=1e-10)


def test_a_mean_of_networks_is_one():
    trained = [
        eqx.tree_at(lambda n: n.biases[0], several(), several().biases[0] + 0.3 * k)
        for k in range(3)
    ]
    found = StaircaseNetwork.mean(trained).simulate(T, TWO)
    each = [np.asarray(network.simulate(T, TWO)) for network in trained]
    np.testing.assert_allclose(found, np.mean(each, 0), atol=1e-10)
    refuses("bad-parts", lambda: StaircaseNetwork.mean([several(), staircase()]))


def test_an_estimate_comes_with_its_worth():
    estimator = ForceEstimator(staircase(), 0.05, 8.0, low_reading=-0.2, high_reading=5.0)
    z = Z[:60].copy()
    z[20], z[30], z[40] = np.nan, np.inf, 6.0
    found = estimator.simulate(T[:60], z)
    assert found.status[20] == found.status[30] == Status.INVALID
    assert found.value[20] == found.value[19]
    assert found.status[40] == Status.EXTRAPOLATED
    assert bool(((found.value >= 0) & (found.value <= 8.0)).all())
    assert len(estimator.simulate([], []).value) == 0
    # The samples that were none might as well not have been there.
    good = np.isfinite(z)
    alone = estimator.simulate(*without(~good, T[:60], z)).value[: good.sum()]
    np.testing.assert_allclose(found.value[good], alone, atol=1e-10)


def test_bad_settings_are_answered():
    refuses("bad-option", lambda: ForceEstimator(staircase(), 0.0, 8.0))
    with pytest.raises(InputError, match="bad-option"):
        ForceEstimator(several(), 1.0, 8.0, low_reading=(0.0, 1.0), high_reading=(1.0, 1.0))
    refuses("wrong-channels", lambda: several().prepare(T, Z))
    refuses("no-time", lambda: staircase().prepare(None, Z))
    with pytest.raises(InputError, match="parameter-out-of-bounds"):
        StaircaseNetwork.random([Z], [F], [T], jax.random.key(0), thresholds=(-1.0,))
