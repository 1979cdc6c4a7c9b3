"""The soft sensor force by force, and the machine that presses it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks._microchannel.force_loop import ChannelStream, ForceLoopRig
from hysteresis import InputError
from hysteresis.rigs import MicrochannelRig

RIG = MicrochannelRig(seed=3, fabrication=0.1)
STILL = ForceLoopRig(sensor=RIG, sway_mm=0.0, stiffness_error=0.0)


@given(
    arrays(float, 25, elements=st.floats(0, 30)), st.floats(1e-4, 1.0), st.integers(0, 4),
    st.tuples(st.floats(0.5, 2), st.floats(0.5, 2)),
)  # fmt: skip
def test_a_stream_reads_what_the_whole_record_does(force, dt, location, placement):
    everywhere = np.zeros((25, 5))
    everywhere[:, location] = force
    placed = np.broadcast_to(np.array(placement)[:, None], (2, 5))
    whole = RIG.follow(everywhere, dt, placed)
    stream = ChannelStream(RIG, location=location, dt=dt, placement=placement)
    found = np.array([stream.step(F) for F in force.tolist()])
    # exp of two libraries and sums in another order: some roundings of at most 200 V.
    np.testing.assert_allclose(found, whole, rtol=1e-12, atol=1e-12)


def follow(rig: ForceLoopRig, commands: np.ndarray, session: int = 0) -> np.ndarray:
    loop = rig.start(session)
    return np.array([loop.step(c).force for c in commands.tolist()])


def test_the_object_sways_and_its_stiffness_is_its_own():
    still = follow(STILL, np.full(4000, 2.0))[500:]
    swaying = ForceLoopRig(sensor=RIG, stiffness_error=0.0)
    ones = [follow(swaying, np.full(4000, 2.0), session)[500:] for session in (0, 1)]
    assert np.ptp(still) < 1e-6
    assert all(0.5 < np.ptp(one) < 1.5 for one in ones)  # 2 N/mm of 0.4 mm
    assert not np.array_equal(*ones)
    stiff = [
        follow(ForceLoopRig(sensor=MicrochannelRig(seed=seed), sway_mm=0.0), np.full(200, 1.5))[-1]
        for seed in range(3)
    ]
    assert len(set(stiff)) == 3


@pytest.mark.parametrize(
    "call",
    [
        lambda: ChannelStream(RIG, location=5),
        lambda: ChannelStream(RIG, dt=0.0),
        lambda: ChannelStream(RIG, placement=(1.0,)),
        lambda: ChannelStream(RIG, placement=(1.0, -1.0)),
        lambda: ChannelStream(RIG).step(-1.0),
        lambda: ChannelStream(RIG).step(float("nan")),
        lambda: ChannelStream(RIG).step(41.8),
        lambda: ForceLoopRig(sensor=RIG, damping=1.0),
        lambda: ForceLoopRig(sensor=RIG, bandwidth_hz=0.0),
        lambda: ForceLoopRig(sensor=RIG, highest_n=50.0),
        lambda: ForceLoopRig(sensor=RIG, location=5).start(),
    ],
)
def test_bad_arguments_are_refused(call):
    with pytest.raises(InputError, match="bad-option"):
        call()
