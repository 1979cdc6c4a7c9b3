"""The virtual microchannel sensor: what it must not be made easier than, and its laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hysteresis.internal import ResistiveReadout
from hysteresis.rigs import MicrochannelRig
from tests.refusals import refuses

RIG = MicrochannelRig()

forces = arrays(float, (15, 5), elements=st.floats(0, 30))


def slow(rig: MicrochannelRig, force: np.ndarray, dt: float) -> np.ndarray:
    """The law as it is printed, a sample at a time, without the low-pass."""
    r, w = np.array(rig.stop_travel_n), np.array(rig.stop_share)
    g, tau = np.array(rig.creep), np.array(rig.creep_s)
    s, q, before, out = np.zeros((5, 3)), np.zeros((5, 2)), np.zeros(5), []
    for F in force:
        s = np.clip(s + (F - before)[:, None], -r, r)
        Z = (s / r) @ w
        u = F / (1 - F / 41.8) * (1 - 0.09 * Z * (1 - np.exp(-F / 0.8)))
        kept = np.exp(-dt / tau)
        q = kept * q + (1 - kept) * u[:, None]
        v = u * (1 - g.sum()) + q @ g
        out.append(20 * 0.075 * 5.8 * 0.02 * np.array(rig.sensitivity) @ v)
        before = F
    return np.array(out)


@given(forces, st.floats(0.001, 10))
def test_follows_the_law(force, dt):
    rig = MicrochannelRig(readout=ResistiveReadout(low_pass_s=1e-6))
    # Sums in another order: some tens of roundings of at most 200 V.
    np.testing.assert_allclose(rig.follow(force, dt), slow(rig, force, dt), rtol=1e-12, atol=1e-12)


def test_levels_are_those_of_table_i():
    """In units of E in layer 1 at the same force; equal presses have equal v, so the ratios are exact."""
    rise = 4.0 * np.linspace(0, 1, 20)[:, None]
    table = {"A": (3, 1), "C": (2, 2), "E": (1, 3)}
    table |= {"AC": (5, 3), "AE": (4, 4), "CE": (3, 5), "ACE": (6, 6)}

    def read(places: str) -> np.ndarray:
        return RIG.follow(rise * [k in places for k in "ABCDE"], 0.05)[-1]

    unit = read("E")[0]
    for places, levels in table.items():
        np.testing.assert_allclose(read(places) / unit, levels, rtol=1e-12)
    # B and D lie between, at 2.5 and 1.5 when rounded to halves: those presses are confused.
    singles = np.array([read(k) / unit for k in "ABCDE"])
    np.testing.assert_array_equal(np.round(2 * singles[:, 0]) / 2, [3, 2.5, 2, 1.5, 1])
    np.testing.assert_array_equal(np.round(2 * singles[:, 1]) / 2, [1, 1.5, 2, 2.5, 3])


def test_loops_are_as_wide_as_fig_1_shows():
    """6.5 to 14 % of full scale at 2, 4 and 6 N; up to 8 N and back in 4 s, location C."""
    t = np.arange(0, 4, 0.02)
    force = np.where(t < 2, 4 * t, 4 * (4 - t))
    V = RIG.follow(force[:, None] * [0, 0, 1, 0, 0])[:, 0]
    top = force.argmax() + 1
    up = np.interp([2, 4, 6], force[:top], V[:top])
    down = np.interp([2, 4, 6], force[top:][::-1], V[top:][::-1])
    width = 100 * (down - up) / V.max()
    np.testing.assert_allclose(width, [6.54, 11.27, 13.93], atol=0.05)


def test_test_loops_are_not_the_training_s():
    loops = RIG.test_loops()
    assert len(loops) == 4
    for loop in loops:
        assert loop.force[-1, 0] == 0
        assert 4.6 < loop.force.max() <= 7.8
    assert len({loop.force.max() for loop in loops}) == 4


def test_several_are_pressed_at_once():
    record = RIG.simultaneous()
    force = record.force[:, [1, 3]]
    assert record.reading.shape == (1452, 2)
    assert not record.force[:, [0, 2, 4]].any()
    assert np.abs(np.diff(force, axis=0)).max() <= 0.4
    begun = np.sum((force[1:] > 0) & (force[:-1] == 0), axis=0)
    np.testing.assert_array_equal(begun, 8)
    assert np.mean((force > 0).all(axis=1)) > 0.05
    centred = RIG.simultaneous(finger=False)
    np.testing.assert_array_equal(centred.force, record.force)
    noise = centred.reading - RIG.follow(centred.force, 0.05)
    assert noise.std() == pytest.approx(0.02, abs=0.002)
    assert (record.reading - RIG.follow(record.force, 0.05)).std() > 0.05


@pytest.mark.parametrize("call", [
    lambda: RIG.follow(np.ones((4, 3))), lambda: RIG.follow(-np.ones((4, 5))),
    lambda: RIG.follow(np.full((4, 5), 41.8)), lambda: RIG.follow(np.ones((4, 5)), dt=0.0),
    lambda: RIG.finger_presses([1, 2]), lambda: RIG.finger_presses(0),
    lambda: RIG.cnc_loops(10, location=5), lambda: RIG.simultaneous(100),
    lambda: RIG.press_together(np.ones(5)), lambda: ResistiveReadout(noise=-1.0),
    lambda: ResistiveReadout(low=1.0, high=0.0),
])  # fmt: skip
def test_bad_arguments_are_refused(call):
    refuses("bad-option", call)
