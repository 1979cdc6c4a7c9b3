"""The electronics of the microchannel sensor, run backwards, and what happens to bad samples."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensate.internal import ChannelStatus, Readout
from hysteresis.rigs import MicrochannelRig
from tests.refusals import refuses

OK, GAP, STUCK, SATURATED, MISSING = ChannelStatus

RIG = MicrochannelRig()
ELECTRONICS = RIG.readout
COUNTED = Readout(
    low=ELECTRONICS.low, high=ELECTRONICS.high, bits=ELECTRONICS.bits,
    longest_gap=0.1, stuck_after=20,
)  # fmt: skip


def test_undoes_the_rig_s_electronics():
    """c from volts to rounding, from counts to half a count."""
    c = np.linspace(0.0, 2.0, 40).reshape(20, 2)
    volts, t = ELECTRONICS.scale * c, 0.02 * np.arange(20)
    found = Readout().simulate(t, volts)
    np.testing.assert_allclose(found.value, c, rtol=1e-14)
    assert np.all(found.status == OK)
    half = (ELECTRONICS.high - ELECTRONICS.low) / (2**ELECTRONICS.bits - 1) / ELECTRONICS.scale / 2
    counted = COUNTED.simulate(t, ELECTRONICS.counts(volts))
    np.testing.assert_allclose(counted.value, c, rtol=0, atol=half * (1 + 1e-9))


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=12), st.floats(0, 3), st.data())
def test_simulate_is_the_scan_of_step_in_any_pieces(volts, tau, data):
    readout = Readout(1, time_constant=tau)
    t, rows = 0.5 * np.arange(len(volts)), np.array(volts)[:, None]
    whole = readout.simulate(t, rows)
    state, values = readout.init(), []
    for now, row in zip(t, rows, strict=True):
        state, change = readout.step(state, now, row)
        values.append(change.value)
    np.testing.assert_allclose(whole.value, np.array(values), rtol=0, atol=1e-14)


def test_each_fault_has_its_status_and_the_stream_goes_on():
    record = RIG.cnc_loops(400)
    counts = ELECTRONICS.counts(record.reading).astype(float)
    time = record.time.copy()
    clean = jax.tree.map(np.asarray, COUNTED.simulate(time, counts))
    bad = counts.copy()
    bad[50:60, 0] = np.nan
    bad[100:140, 1] = bad[100, 1]
    bad[200, 0] = 2**ELECTRONICS.bits - 1
    time[300:] += 5.0
    found = jax.tree.map(np.asarray, COUNTED.simulate(time, bad))
    assert np.all(found.status[50:60, 0] == MISSING)
    np.testing.assert_array_equal(found.value[50:60, 0], found.value[49, 0])
    assert found.status[60, 0] == GAP  # 0.22 s without this channel
    assert np.all(found.status[119:140, 1] == STUCK)
    assert found.status[200, 0] == SATURATED
    assert np.all(found.status[300] == GAP)
    # One channel's fault is not the other's, and what follows is as if nothing had been.
    assert np.all(found.status[50:60, 1] == OK)
    assert np.all(found.status[301:] == OK)
    np.testing.assert_array_equal(found.value[140:200], clean.value[140:200])
    np.testing.assert_array_equal(found.value[201:], clean.value[201:])


@given(st.lists(st.sampled_from([0.0, 1.0, np.nan, np.inf, -np.inf]), min_size=1, max_size=20))
def test_nothing_that_is_not_finite_poisons_the_state(volts):
    readout = Readout(1, scale=1.0, time_constant=0.1)
    rows = np.array([*volts, 0.5])[:, None]
    found = readout.simulate(np.arange(len(rows), dtype=float) * 100.0, rows)
    found = jax.tree.map(np.asarray, found)  # each slice of JAX's is a program
    assert np.all(np.isfinite(found.value))
    # After 1000 time constants nothing is left of what was.
    assert found.value[-1, 0] == pytest.approx(0.5, abs=1e-15)
    assert found.status[-1, 0] == OK


def test_time_that_runs_backwards_or_is_missing():
    readout = Readout(1, scale=1.0, time_constant=1.0)
    t = np.array([0.0, 1.0, 0.5, np.nan])
    found = readout.simulate(t, np.array([[1.0], [1.0], [3.0], [9.0]]))
    np.testing.assert_array_equal(found.status[:, 0], [OK, OK, GAP, MISSING])
    np.testing.assert_array_equal(found.value[2:, 0], [3.0, 3.0])


def test_zero_is_taken_at_rest():
    rest = np.array([[0.1, -0.2], [0.3, np.nan], [0.2, -0.2]])
    readout = Readout(scale=2.0).at_rest(rest)
    np.testing.assert_allclose(readout.zero, [0.2, -0.2])
    refuses("wrong-channels", lambda: readout.at_rest(np.array([[1.0, np.nan]])), "channel 2 ")


@pytest.mark.parametrize("settings", [
    {"scale": 0.0}, {"zero": np.nan}, {"bits": 10}, {"low": 1.0, "high": 0.0}, {"stuck_after": 1},
    {"time_constant": -1.0}, {"longest_gap": 0.0}, {"scale": np.ones(3), "zero": np.ones(2)},
])  # fmt: skip
def test_settings_out_of_range_are_refused(settings):
    refuses("bad-option", lambda: Readout(**settings))


def test_a_missing_channel_is_named():
    refuses("wrong-channels", lambda: Readout().simulate(np.arange(3.0), np.ones((3, 1))))
