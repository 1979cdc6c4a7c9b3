"""Learning force from a soft sensor's records: what is held out, what is found, what is refused."""

import jax
import numpy as np
import pytest

from compensate import Status
from compensate.internal import BackwardsModel
from hysid import ForceRecord, train_force
from hysid.soft_sensor._force_records import gather, held_out_parts
from hysteresis import PrandtlIshlinskii
from tests.refusals import refuses

FAST = {"updates": 150, "members": 2, "skip": 0.0}


def sensor(seed: int, channels: int = 1, count: int = 80, offset: float = 0.3) -> ForceRecord:
    """A press of a sensor that lags its force by a play of half a newton."""
    random, t = np.random.default_rng(seed), 0.05 * np.arange(count)
    F = random.uniform(3, 6) * np.sin(np.pi * np.arange(count) / count) ** 2
    z, play = 0.0, []
    for force in F:
        z = float(np.clip(z, force - 0.5, force + 0.5))
        play.append(z)
    y = offset + 0.1 * np.array(play) + 1e-3 * random.standard_normal(count)
    if channels > 1:
        y = np.column_stack([y * (1 - 0.3 * k) for k in range(channels)])
    return ForceRecord(t, y, F)


RECORDS = [sensor(k) for k in range(6)]


@pytest.fixture(scope="module")
def learnt(tmp_path_factory):
    """A training, its folder of checkpoints, and what it told."""
    folder, told = tmp_path_factory.mktemp("learnt"), []
    found = train_force(RECORDS, checkpoint=folder, tell=lambda *now: told.append(now[:2]), **FAST)
    return found, folder, told


def test_it_learns_far_better_than_a_mean(learnt):
    found, _, told = learnt
    forces = np.concatenate([record.force for record in RECORDS])
    assert found.rmse < 0.5 * forces.std()
    t, y, F = sensor(10)
    estimate = found.estimator.simulate(t, y)
    assert np.sqrt(np.mean((np.asarray(estimate.value) - F) ** 2)) < 0.5 * F.std()
    assert told[-1] == (1000, 1000)
    assert len(found.curves[0].validation) > 1


def test_the_deviation_is_of_rows_that_were_held_out(learnt):
    found = learnt[0]
    seen = np.isfinite(found.held_out)
    assert seen.all()  # every record was held out from one network
    held = np.clip(found.held_out, 0, found.estimator.high)
    inside = np.abs(held - found.force) < 1.645 * float(found.estimator.deviation)
    assert abs(inside.mean() - 0.9) < 0.01


@pytest.mark.thorough
def test_several_channels_are_learnt_and_watched():
    found = train_force([sensor(k, 2) for k in range(4)], **FAST)
    t, y, _ = sensor(9, 2)
    y = y.copy()
    y[10, 1], y[20, 0] = np.nan, 99.0
    estimate = found.estimator.simulate(t, y)
    assert (estimate.status[10], estimate.status[20]) == (Status.INVALID, Status.EXTRAPOLATED)
    assert np.isfinite(np.asarray(estimate.value)).all()


def test_an_interrupted_training_goes_on(learnt):
    whole, folder, _ = learnt
    rest = train_force(RECORDS, checkpoint=folder, resume=True, **FAST)
    np.testing.assert_array_equal(whole.held_out, rest.held_out)
    assert "resumed from" in rest.curves[0].said[0]


def long_record() -> ForceRecord:
    t, y, F = (np.concatenate(part) for part in zip(*RECORDS, strict=True))
    return ForceRecord(0.05 * np.arange(len(t)), y, F)


def test_a_model_run_backwards_is_a_model():
    from compensate import invert

    inner = PrandtlIshlinskii([0.2, 0.6], [0.3, 0.2], 1.0)
    model = BackwardsModel(invert(inner))
    u = 3 * np.sin(np.linspace(0, 9, 60))
    y = np.asarray(inner.simulate(None, u))
    found = np.asarray(model.simulate(None, y))
    np.testing.assert_allclose(found, u, atol=1e-9)
    state, first = model.stream(None, y[:25])
    np.testing.assert_allclose(first, found[:25], atol=1e-12)
    np.testing.assert_allclose(model.simulate(None, y[25:], state), found[25:], atol=1e-12)
    prepared = model.prepare(None, np.tile(y, 2), starts=(0, 60))
    np.testing.assert_allclose(model.evaluate(prepared)[60:], found, atol=1e-12)
    readings = jax.numpy.asarray(y)
    _, slope = jax.jvp(lambda x: model.simulate(None, x), (readings,), (readings,))
    assert np.isfinite(np.asarray(slope)).all()


def changed(**columns: object) -> list[ForceRecord]:
    return [RECORDS[0]._replace(**columns), *RECORDS[1:]]


T, Y, F = RECORDS[0]


@pytest.mark.parametrize(("code", "records", "options"), [
    ("no-rows", [], {}),
    ("too-few-rows", [sensor(0, count=30)], {}),
    ("too-few-presses", [sensor(0, count=200)], {}),
    ("nan-input", changed(reading=np.where(np.arange(80) == 7, np.nan, Y)), {}),
    ("nan-output", changed(force=np.where(np.arange(80) == 7, np.nan, F)), {}),
    ("length-mismatch", changed(force=F[1:]), {}),
    ("time-backwards", changed(time=T[::-1]), {}),
    ("wrong-channels", [sensor(0, 2), *RECORDS[1:]], {}),
    ("constant-input", [r._replace(reading=0 * r.reading + 1) for r in RECORDS], {}),
    ("no-excitation", [r._replace(force=-r.force) for r in RECORDS], {}),
    ("bad-option", RECORDS, {"kind": "tree"}),
    ("bad-option", RECORDS, {"members": 1}),
    ("bad-option", RECORDS, {"skip": 1.0}),
    ("bad-option", RECORDS, {"nan": "skip"}),
    ("length-mismatch", RECORDS, {"groups": ["one"] * 6}),
    ("wrong-channels", [sensor(k, 2) for k in range(6)], {"kind": "structured"}),
])  # fmt: skip
def test_bad_records_are_answered(code, records, options):
    refuses(code, lambda: train_force(records, **(FAST | options)))


def test_what_is_held_out_is_whole():
    data = gather(RECORDS)
    part = held_out_parts(data, 3)
    assert all(len(set(part[rows])) == 1 for rows in data.sequences())
    assert set(part) == {0, 1, 2}
    own = held_out_parts(data, 2, groups=list("aabbaa"))
    assert [int(own[rows.start]) for rows in data.sequences()] == [0, 0, 1, 1, 0, 0]
    one = gather([long_record()])
    assert (one.presses, len(one.rests)) == (6, 6)
    part = held_out_parts(one, 3, 0.34)
    assert (part[: int(0.34 * len(part))] == -1).all()
    for k in range(3):
        assert (np.diff(np.flatnonzero(part == k)) == 1).all()
