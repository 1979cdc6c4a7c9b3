"""Fitting a channel map: what it finds, what it may see, and what is left out."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import pytest

from hysteresis import Record
from identify import fit, load, save
from identify import load as load_fit
from tests.refusals import raises, refuses
from tests.thorough import rest_thorough

CYCLES, SAMPLES = 6, 60
CHANNELS = {"rises": "mT", "falls": "V", "bends": "1"}


def rig(
    noise: float = 1e-3, runs: int = 1, settling: float = 0.0, seed: int = 0,
    names: tuple[str, ...] = tuple(CHANNELS), more: dict[str, np.ndarray] | None = None,
) -> Record:  # fmt: skip
    """A load, and three channels of which two have loops that cancel; `settling` spoils first cycles."""
    rng, n = np.random.default_rng(seed), CYCLES * SAMPLES + 1
    t, phase = 0.05 * np.arange(n), 2 * np.pi * np.arange(n) / SAMPLES
    load, loop = 5 - 5 * np.cos(phase), np.sin(phase)
    fading = settling * np.exp(-np.arange(n) / SAMPLES)
    columns = {
        "rises": 2 * load + 3 * loop + fading * load**2,
        "falls": 4 - 0.3 * load + 0.45 * loop,
        "bends": (load - 4) ** 2,
    }
    columns = {
        name: np.tile(x, runs) + noise * np.ptp(x) * rng.normal(size=runs * n)
        for name, x in columns.items()
    }
    return Record.from_arrays(
        None, np.tile(load, runs) + noise * rng.normal(size=runs * n), np.tile(t, runs),
        np.repeat(np.arange(runs), n), columns=columns | (more or {}),
        channels={name: CHANNELS.get(name, "1") for name in names}, output_unit="N",
    )  # fmt: skip


@pytest.fixture(scope="module")
def found() -> Any:
    return line(rig())


def test_channels_whose_loops_cancel_give_the_output(found: Any):
    record = rig()
    map, combined = found.channels, found.train
    error = combined.input - combined.output
    # Its channels carry a thousandth of noise each, and count up to five times the output's slope.
    assert np.sqrt(np.mean(error[combined.mask] ** 2)) < 0.005 * np.ptp(record.output)
    assert (combined.input_name, combined.input_unit) == ("3 channels combined", "N")
    assert combined.channels == {}
    assert dict(zip(map.names, map.units, strict=True)) == CHANNELS


@pytest.mark.parametrize("runs", rest_thorough([3, 1], 1))
def test_a_channel_that_lags_and_creeps_has_a_memory(runs: int, tmp_path: Path):
    names = ("creeps", "rises", "falls")
    record = rig(runs=runs, names=names, more={"creeps": np.zeros(runs * len(rig()))})
    columns = {**record.columns}
    for _, rows in record.sequences():
        load, felt = record.output[rows], np.zeros(1)
        for k, x in enumerate(load):  # what it shows of the load fades within a few cycles
            felt = 0.995 * felt + (x - load[k - 1] if k else 0.0)
            columns["creeps"][rows.start + k] = x + 2 * felt[0]
        columns["rises"][rows] = load**2 + 0.5 * columns["creeps"][rows]
        columns["falls"][rows] = -(load**2)
    record = replace(record, columns=columns)
    found = line(record)
    assert found.channels.memory is not None
    assert found.channels.times
    back = load_fit(save(found, tmp_path / "fit"))
    np.testing.assert_array_equal(back.predict(record), found.predict(record))
    without = replace(found, channels=eqx.tree_at(lambda m: m.memory, found.channels, None))
    off, worse = (np.std(one.predict(record) - record.output) for one in (found, without))
    assert off < 0.5 * worse
    untimed = replace(record, columns={k: v for k, v in columns.items() if k != "time"}, time=None)
    refuses("no-time", lambda: found.predict(untimed))


@pytest.mark.parametrize("runs", [1, 3])
def test_only_training_rows_are_seen(runs: int):
    record = rig(runs=runs)
    held = record.cycle == CYCLES
    train = record.split_rows(held)[0]
    changed = {k: np.where(held, -7 * x, x) for k, x in record.columns.items()}
    output = np.where(held, 99.0, train.output)
    other = replace(train, output=output, columns=changed, input=train.input)
    map, same = line(train).channels, line(other).channels
    np.testing.assert_array_equal(same.values, map.values)
    np.testing.assert_array_equal(same.nodes, map.nodes)


def test_first_cycles_of_a_sample_that_settles_are_left_out():
    settling = rig(settling=0.3)
    combined = line(settling).train
    assert combined.mask.all()  # the map leaves them out, the model and the baselines do not
    (said,) = [note for note in combined.history if note.code == "settled"]
    assert said.values["rows"] in [(settling.cycle <= n).sum() for n in (1, 2)]
    kept = line(settling, conditioning="keep").train
    assert kept.mask.all()
    late = settling.cycle == CYCLES
    off, worse = (one.input - settling.output for one in (combined, kept))
    assert np.std(off[late]) < 0.8 * np.std(worse[late])


def test_what_cannot_be_fitted_is_refused():
    n = len(rig())
    still, few = {"a": np.zeros(n), "b": np.ones(n)}, np.arange(n) < 2
    for record, code in (
        (rig(names=("a", "b"), more=still), "constant-input"),
        (replace(rig(), mask=few), "too-few-rows"),
    ):
        refuses(code, lambda record=record: line(record))


def line(record: Record, **options: Any) -> Any:
    return fit(record, "LinearSponge", starts=1, noise="gaussian", **options)


def test_a_fit_is_saved_with_its_map(tmp_path: Path):
    record = rig()
    train, test = record.split_cycles(1)
    found = line(train, test=test)
    back = load(save(found, tmp_path / "fit"))
    assert back.channels.names == found.channels.names
    np.testing.assert_array_equal(back.predict(record), found.predict(record))
    # What was fitted is in the folder as the model saw it, and needs no channels.
    np.testing.assert_array_equal(back.predict(back.train), found.predict(found.train))
    np.testing.assert_array_equal(back.beyond(record), found.beyond(record))
    assert found.metrics["test"].nrmse_percent < 1.0


def test_other_inputs_than_those_of_the_fit_are_refused(found: Any):
    record, plain = rig(), Record.from_arrays(rig().input, rig().output, rig().time)
    with_channels, without = found, line(plain)
    turned = rig(names=tuple(reversed(CHANNELS)))
    np.testing.assert_allclose(with_channels.predict(turned), with_channels.predict(record))
    for one, wrong in (
        (with_channels, plain),
        (with_channels, rig(names=("rises", "falls"))),
        (without, record),
    ):
        with raises("wrong-channels"):
            one.predict(wrong)
    with raises("wrong-unit", "falls is in mV; the model was fitted to V"):
        found.predict(replace(record, channels=CHANNELS | {"falls": "mV"}))


def test_one_of_two_inputs_may_set_the_effect_of_the_other(monkeypatch: Any, tmp_path: Path):
    """A muscle's pressure multiplies what its length does, as no sum of both is like; it pulls less the
    shorter it is, and rubs, so that no sum of parts which rise is like it either."""
    monkeypatch.setattr("identify.fitting._candidates.AUTO", ("Composition",))
    monkeypatch.setattr("identify.linear._conditioned_fit.CONDITIONED", ("curve", "stops"))
    k, stop = np.arange(600), [0.0]
    length, pressure = 1 - np.cos(k / 10) * (0.6 + 0.4 * np.sin(k / 70)), 2 + np.sin(k / 37)
    for moved in np.diff(length):
        stop.append(np.clip(stop[-1] + moved, -0.2, 0.2))
    force = pressure * (3 - length + np.array(stop))
    force += 0.01 * np.random.default_rng(0).normal(size=len(k))
    record = Record.from_arrays(
        None, force, k / 10, columns={"length": length, "pressure": pressure},
        channels={"length": "mm", "pressure": "bar"}, output_unit="N",
    )  # fmt: skip
    found = fit(record, test_tail=0.3)
    assert found.condition is not None
    assert found.condition.name == "pressure"
    test = found.metrics["test"]
    assert test is not None
    # The best of simple ones is a ridge on products, 0.023 N for 0.013; noise is 0.01.
    assert test.rmse < min(0.015, *(one.judged[0] for one in found.baselines))
    assert "need not rise" in " ".join(found.notes)
    save(found, tmp_path / "fit")
    np.testing.assert_array_equal(load(tmp_path / "fit").predict(record), found.predict(record))
    assert fit(record, test_tail=0.3, purpose="compensate").condition is None
