"""The data sheet of a sensor: lines of a sensor whose errors are known."""

from typing import Any

import numpy as np
import pytest

from hysid import write_data_sheet
from hysteresis import InputError, Record
from identify import data_sheet
from tests.refusals import raises, refuses

LOOPS, ROWS, STEP = 4, 400, 0.1
SLOPE, BEND, LAG, ZERO = 2.0, 0.004, 0.4, 1.5


def run(hold=0, drift=0.0, warmer=0.0, noise=0.0, loops=LOOPS) -> tuple[np.ndarray, ...]:
    """Force from 0 to 20 N in straight legs; branches 2 LAG apart in the middle, bent as x (20 - x)."""
    way = np.arange(loops * ROWS + 1) / ROWS % 1
    force, rising = 20 * (1 - np.abs(2 * way - 1)), way < 0.5
    if hold:
        level = np.repeat([20.0, 0.0], hold)
        ramp = np.linspace(0, 20, ROWS // 2)
        force = np.concatenate([force, ramp, level[:hold], ramp[::-1], level[hold:]])
        up = np.ones(len(ramp) + hold, bool)
        rising = np.concatenate([rising, up, ~up])
    t, shape = STEP * np.arange(len(force)), force * (20 - force) / 100
    signal = SLOPE * force + BEND * 100 * shape - np.where(rising, LAG, -LAG) * shape
    signal = signal * (1 + 1e-3 * warmer) + ZERO + 0.05 * warmer + drift * t
    if hold:
        start = loops * ROWS + 1 + len(ramp)
        signal[start : start + hold] += 0.5 * (1 - np.exp(-np.arange(hold) * STEP / 5))
        signal[start + hold :] += 0.3 * np.exp(-np.arange(len(t) - start - hold) * STEP / 5)
    signal += noise * np.random.default_rng(int(10 * warmer)).normal(size=len(t))
    return t, force, signal


def record_of(*runs: tuple[np.ndarray, ...], **more: Any) -> Record:
    t, force, signal = (np.concatenate(x) for x in zip(*runs, strict=True))
    names = np.repeat([f"run {k}" for k in range(len(runs))], [len(one[0]) for one in runs])
    return Record.from_arrays(
        force, signal, t, names, input_unit="N", output_unit="mV", input_name="force",
        output_name="signal", **more,
    )  # fmt: skip


def test_the_lines_of_a_known_sensor():
    sheet = data_sheet(record_of(run(hold=300)))
    scale = SLOPE * 20
    expected = {
        "full-scale output": scale, "sensitivity": SLOPE, "zero": ZERO,
        "non-linearity, terminal": 100 * BEND * 100 / scale,
        "non-linearity, best line": 50 * BEND * 100 / scale,
        "hysteresis": 100 * 2 * LAG / scale,
    }  # fmt: skip
    for name, value in expected.items():
        assert sheet[name].value == pytest.approx(value, rel=0.02), name
    for name in ("repeatability", "zero return"):
        assert data_sheet(record_of(run()))[name].value == pytest.approx(0, abs=1e-6)
    assert sheet["creep"].value == pytest.approx(100 * 0.5 / scale, rel=0.03)
    assert sheet["creep recovery"].value < 0
    # 0.5 exp(-t / 5) is below 1 % of the scale from t = 1.1 s on.
    assert sheet["settling"].value == pytest.approx(5 * np.log(0.5 / (0.01 * scale)), abs=0.3)
    assert "temperature" in str(sheet)
    assert sheet["zero over temperature"].reason.startswith("no condition")
    assert all(row.definition for row in sheet.rows)
    assert sheet.document()["rows"][0]["unit"] == "mV"


def test_drift_and_coefficients_come_from_the_loops():
    sheet = data_sheet(record_of(run(drift=0.001)))
    drift = sheet["drift of the zero"]
    assert drift.unit == "percent / h"
    assert drift.value == pytest.approx(100 * 3.6 / 40, rel=0.05)
    runs = [run(warmer=x, noise=0.005) for x in (0.0, 10.0, 20.0)]
    warmth = np.repeat([20.0, 30.0, 40.0], len(runs[0][0]))
    more = {"columns": {"temperature": warmth}, "conditions": {"temperature": "degC"}}
    sheet = data_sheet(record_of(*runs, **more))
    zero, slope = (sheet[f"{name} over temperature"] for name in ("zero", "sensitivity"))
    middle = 1 + 1e-3 * 10
    assert zero.value == pytest.approx(100 * 0.05 / 40 / middle, rel=0.02)
    assert slope.value == pytest.approx(100 * 1e-3 / middle, rel=0.05)
    assert zero.unit == "percent / degC"
    wanted = 100 * (1.0 + 0.02 * 40 * 0.95) / 40 / middle
    assert sheet["reproducibility"].value == pytest.approx(wanted, rel=0.1)
    assert sheet["repeatability"].value < 0.2
    more["columns"] = {"temperature": 0 * warmth}
    still = data_sheet(record_of(*runs, **more))
    assert still["zero over temperature"].reason == "it does not change"


def test_intervals_of_noisy_sensors_hold_the_truth():
    found, returns = [], []
    for seed in range(40):
        t, force, signal = run()
        signal = signal + 0.03 * np.random.default_rng(seed).normal(size=len(t))
        sheet = data_sheet(record_of((t, force, signal)))
        row = sheet["sensitivity"]
        found.append(abs(row.value - SLOPE) <= 1.645 * row.error)
        returns.append(sheet["zero return"][1:3])
    assert 0.75 <= np.mean(found) <= 1.0
    # Of all loops, the first and the last reading: 40 sheets tell their scatter to 11 %.
    values, errors = np.array(returns, float).T
    assert np.std(values) == pytest.approx(np.mean(errors), rel=0.35)


def test_what_runs_do_not_tell_is_empty(tmp_path):
    one = data_sheet(record_of(run(loops=1)))
    assert one["repeatability"].reason == "there is one loop a run"
    assert "three later loops" in one["drift of the zero"].reason
    assert one["creep"].reason == "the input is never held there"
    t, force, signal = run()
    bare = data_sheet(Record.from_arrays(force, signal))
    assert "clock" in bare["drift of the zero"].reason
    assert "clock" in bare["settling"].reason
    refuses("too-few-cycles", lambda: data_sheet(Record.from_arrays(t, t)))
    refuses("no-column", lambda: one["price"])
    for suffix in (".pdf", ".html"):
        assert write_data_sheet(one, tmp_path / f"sheet{suffix}").stat().st_size > 10_000
        with raises("cannot-write"):
            write_data_sheet(one, tmp_path / "sheet.pdf" / f"sheet{suffix}")
    assert len(one.plot().axes) == 4
    assert "full-scale output" in one._repr_html_()


def test_runs_over_other_ranges_are_no_one_sheet():
    t, force, signal = run()
    with pytest.raises(InputError, match=r"\[not-comparable\]"):
        data_sheet(record_of((t, force, signal), (t, force - 15.0, signal)))
