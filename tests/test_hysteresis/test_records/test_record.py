"""Records: what is refused, what is split off, and that nothing is changed in silence."""

import copy
import json
import pickle
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import Note, Record, read_csv
from hysteresis.internal import check_identifiable, loop_direction
from tests.refusals import refuses


def rig(n_cycles: int = 4, samples: int = 25, lag: float = 0.2, **names: Any) -> Record:
    k = np.arange(2 * n_cycles * samples + 1)
    u = np.abs((k / samples + 1) % 2 - 1)
    y = u - lag * np.gradient(u) * samples * u * (1 - u)
    return Record.from_arrays(u, y, 0.01 * k, **names)


def test_length_mismatch_names_both():
    odd = (np.zeros(200), np.zeros(199), np.arange(200.0))
    refuses("length-mismatch", lambda: Record.from_arrays(*odd), "time has 200 values, output 199")


def test_nan_input_needs_interpolation_and_nan_output_may_be_masked():
    u, y, t = np.arange(10.0), np.arange(10.0), 0.002 * np.arange(10.0)
    y[3:6] = np.nan
    words = ("3 NaN in output", "rows 4 to 6 (4 ms)", 'nan="omit"', "--nan omit")
    refuses("nan-output", lambda: Record.from_arrays(u, y, t), *words)
    omitted = Record.from_arrays(u, y, t, nan="omit")
    assert (omitted.mask.sum(), len(omitted)) == (7, 10)
    filled = Record.from_arrays(u, y, t, nan="interpolate")
    assert np.allclose(filled.output, u)
    assert "Filled 3 NaN" in filled.history[-1]
    refuses("nan-input", lambda: Record.from_arrays(y, u, t, nan="omit"), '"interpolate"')
    assert np.allclose(Record.from_arrays(y, u, t, nan="interpolate").input, u)
    none = "leave out the sequence that has none at all"
    refuses("nan-input", lambda: Record.from_arrays(u * np.nan, u, t, nan="interpolate"), none)


def test_clock_faults_name_their_lines():
    t = np.arange(10.0)
    t[5] = t[4]
    found = {"source": "a.csv", "line": np.arange(2, 12)}
    refuses(
        "time-repeated", lambda: Record.from_arrays(t, t, t, **found), "lines 6 to 7", "average"
    )
    two = np.tile(np.arange(5.0), 2)
    refuses("time-backwards", lambda: Record.from_arrays(two, two, two), "row 6", "segments")
    record = Record.from_arrays(two, two, two, segments="auto")
    assert record.labels == ("all", "all#2")
    assert record.starts.tolist() == [0, 5]
    refuses("nan-time", lambda: Record.from_arrays(t, t, t * np.nan), "--dt")


def test_infinite_values_are_refused():
    refuses("not-finite", lambda: Record.from_arrays([0, np.inf], [0, 1]), "row 2")


def test_arrays_are_frozen_and_the_callers_are_not():
    u = np.arange(5.0)
    record = Record.from_arrays(u, u)
    with pytest.raises(ValueError, match="read-only"):
        record.input[0] = 1
    u[0] = 7
    assert record.input[0] == 0
    seen = u.view()
    seen.flags.writeable = False  # the caller writes to it through u
    assert not np.shares_memory(Record.from_arrays(seen, u).input, u)
    u.flags.writeable = False
    assert np.shares_memory(Record.from_arrays(u, u).input, u)
    assert not np.shares_memory(Record.from_arrays(u, u, nan="interpolate").input, u)


def test_interleaved_groups_are_gathered_in_order_of_appearance():
    x, columns = np.arange(6.0), {"k": np.arange(6)}
    record = Record.from_arrays(x, x, groups=list("babaab"), columns=columns)
    assert record.labels == ("b", "a")
    assert (record.input.tolist(), record.line.tolist()) == ([0, 2, 5, 1, 3, 4], [1, 3, 6, 2, 4, 5])
    assert record.columns["k"].tolist() == [0, 2, 5, 1, 3, 4]
    assert "interleaved" in record.history[0]
    assert [(x, s.start, s.stop) for x, s in record.sequences()] == [("b", 0, 3), ("a", 3, 6)]


def test_split_cycles_holds_out_the_last_of_each_sequence():
    u = rig().input
    record = Record.from_arrays(np.tile(u, 2), np.tile(u, 2), groups=np.repeat(["a", "b"], len(u)))
    assert record.n_cycles == 8
    train, test = record.split_cycles(1)
    assert not np.any(train.mask & test.mask)
    assert (set(train.cycle[train.mask]), set(test.cycle[test.mask])) == ({1, 2, 3}, {4})
    assert len(train) == len(test) == len(record)
    assert len(train.history) == len(record.history) + 1
    refuses("too-few-cycles", lambda: record.split_cycles(4), "'a' has 4", "1 more", "--test-tail")
    refuses("too-few-cycles", lambda: record.split_cycles(0))


@given(st.floats(0.01, 0.99), st.lists(st.integers(2, 30), min_size=1, max_size=5))
def test_splits_are_disjoint_and_complete(fraction, lengths):
    groups = np.repeat(np.arange(len(lengths)), lengths)
    u = np.arange(len(groups), dtype=float)
    record = Record.from_arrays(u, u, groups=groups)
    if all(np.ceil(fraction * n) == n for n in lengths):
        refuses("no-rows", lambda: record.split_tail(fraction))
        return
    train, test = record.split_tail(fraction)
    assert np.array_equal(train.mask, ~test.mask)
    for (_, s), n in zip(test.sequences(), lengths, strict=True):
        assert test.mask[s].sum() == np.ceil(fraction * n)


def test_split_groups_and_take_sequences():
    u = np.arange(9.0)
    record = Record.from_arrays(u, u, u, groups=np.repeat(["a", "b", "c"], 3))
    train, test = record.split_groups(["b"])
    assert (train.labels, test.labels) == (("a", "c"), ("b",))
    assert (train.starts.tolist(), test.time.tolist()) == ([0, 3], [3, 4, 5])
    assert record.split_groups(lambda x: x == "b")[1].digest() == test.digest()
    refuses("bad-condition", lambda: record.take_sequences(["d"]), "'d'")
    refuses("no-rows", lambda: record.split_groups(["a", "b", "c"]))


def test_rows_taken_one_after_the_other_are_the_record():
    u = np.arange(9.0)
    record = Record.from_arrays(u, -u, u, groups=np.repeat(["a", "b", "c"], 3))
    parts = [record.take_rows(0, 4), record.take_rows(4, 8), record.take_rows(8, 20)]
    assert [part.labels for part in parts] == [("a", "b"), ("b", "c"), ("c",)]
    assert [part.starts.tolist() for part in parts] == [[0, 3], [0, 2], [0]]
    for name in ("input", "output", "time", "line", "mask"):
        together = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(together, getattr(record, name))
    refuses("no-rows", lambda: record.take_rows(9, 12))


def test_split_rows_and_select_narrow_the_mask_alone():
    record = rig()
    train, test = record.split_rows(record.input > 0.5)
    assert np.array_equal(test.mask, record.input > 0.5)
    assert np.array_equal(train.mask, record.input <= 0.5)
    loading = record.select(branch="loading", range=(0.2, 0.8), cycle=[2, 3])
    assert len(loading) == len(record)
    assert np.all(loading.branch[loading.mask] == 1)
    assert np.all((loading.cycle[loading.mask] >= 2) & (loading.cycle[loading.mask] <= 3))
    assert "loading" in loading.history[-1]
    assert record.select() is record
    refuses("no-rows", lambda: record.select(cycle=17))


def test_resample_is_linear_within_each_sequence():
    t = np.array([0, 0.1, 0.5, 1.0, 0, 0.3, 1.0])
    u = 2 * t + np.repeat([0, 5], [4, 3])
    y = -u.copy()
    y[1] = np.nan
    record = Record.from_arrays(u, y, t, groups=np.repeat(["a", "b"], [4, 3]), nan="omit")
    even = record.resample(0.25)
    assert even.starts.tolist() == [0, 5]
    assert np.allclose(even.time, np.tile(np.arange(5) * 0.25, 2))
    assert np.allclose(even.input, 2 * even.time + np.repeat([0, 5], 5))
    assert np.allclose(even.output, -even.input)
    assert even.mask.tolist() == [True, False] + [True] * 8
    assert "Resampled 7 rows to a step of 0.25 s" in even.history[-1]
    refuses("no-time", lambda: Record.from_arrays(u, u).resample(0.1))
    refuses("no-time", lambda: record.resample(0.0))


@pytest.mark.parametrize("lag", [0.3, -0.3])
def test_loop_direction(lag):
    record = rig(lag=lag)
    assert loop_direction(record) == pytest.approx(np.sign(lag), abs=1e-3)
    back = Record.from_arrays(record.output, record.input)
    assert loop_direction(back) == pytest.approx(-np.sign(lag), abs=0.05)
    cut = Record.from_arrays(record.input[10:45], record.output[10:45])
    assert loop_direction(cut) == pytest.approx(np.sign(lag), abs=1e-3)
    assert loop_direction(record.split_cycles(1)[0]) == pytest.approx(np.sign(lag), abs=1e-3)


def test_digest_depends_on_the_data_alone():
    record = rig()
    assert record.digest() == rig(source="other.csv").digest()
    assert record.digest() != record.select(cycle=1).digest()


def test_no_excitation_and_constant_input():
    rng = np.random.default_rng(2)
    u, y = rng.normal(0, 0.002, 500), rng.normal(size=500)
    record = Record.from_arrays(u, y, input_unit="mm")
    refuses("no-excitation", lambda: check_identifiable(record), "mm is about the noise")
    flat = Record.from_arrays(np.full(500, 3.0), y, input_unit="N")
    refuses("constant-input", lambda: check_identifiable(flat), "3 N", "--input")
    # Independent steps look like noise; an output that follows them tells otherwise.
    assert check_identifiable(Record.from_arrays(y, 2 * y + u)) == []


def test_warnings():
    record = rig(20)
    t = record.time + np.random.default_rng(0).uniform(0, 0.009, len(record))
    # Models take an uneven clock as it is, and an oscillator refuses it by itself.
    assert check_identifiable(Record.from_arrays(record.input, record.output, t)) == []
    u = np.linspace(0, 1, 400)
    (warning,) = check_identifiable(Record.from_arrays(u, u**2))
    assert "no unloading branch" in warning
    assert warning.endswith("[one-way-input]")
    assert warning.code == "one-way-input"
    clipped = Record.from_arrays(record.input, np.minimum(record.output + 0.1, 0.9))
    (warning,) = check_identifiable(clipped)
    assert "at 0.9: clipped" in warning
    assert warning.code == "saturation"
    # In a hold the output creeps one way, and a single reading may err.
    hold = np.r_[u, np.ones(60), u[::-1]]
    relaxing = np.r_[2 * u, 1 + np.exp(-np.arange(60) / 20), 2 * u[::-1] - 1]
    relaxing[430] += 1.5
    assert check_identifiable(Record.from_arrays(hold, relaxing)) == []
    # An encoder behind a backlash stays at its last count while it turns, as at every other one.
    v = np.interp(np.arange(400), [0, 100, 200, 300, 400], [0, 10, -10, 10, 0])
    counts = np.round(np.clip(v - 0.4, -9.2, 9.4))
    assert check_identifiable(Record.from_arrays(v, counts)) == []
    more = (np.append(x, 1) for x in (record.input, record.output))
    single = Record.from_arrays(*more, groups=["a"] * len(t) + ["b"])
    assert "'b'" in check_identifiable(single)[0]


def test_a_zero_that_jumps_is_told_from_a_snap_that_comes_back():
    """A tare keeps its step; a specimen snaps in every cycle, and a lone ramp tells neither."""
    t = np.arange(0, 8 * np.pi, 0.05)
    u = 5 - 5 * np.cos(t)
    y = 2 * u + np.sin(t) + 0.02 * np.random.default_rng(0).normal(size=len(t))
    snapping = y + 6 * (u > 7)
    tared = y - 13.0 * (np.arange(len(t)) >= 231)
    codes, outputs = {}, {"none": y, "snap": snapping, "tare": tared, "both": snapping + tared - y}
    for name, x in outputs.items():
        found = check_identifiable(Record.from_arrays(u, x, t, time_unit="s"))
        codes[name] = [note.code for note in found]
        if name in ("tare", "both"):
            assert "row 232" in found[0]
            assert "-13" in found[0]
    assert codes == {"none": [], "snap": [], "tare": ["zero-jump"], "both": ["zero-jump"]}
    ramp = slice(0, 63)
    one = Record.from_arrays(u[ramp], y[ramp] - 13.0 * (t[ramp] > 2), t[ramp])
    assert [note.code for note in check_identifiable(one)] == ["one-way-input"]


def test_a_note_is_its_sentence_and_keeps_its_code():
    """Through copies and pickles too: results of other processes come back pickled."""
    note = Note("resampled", "Resampled 7 rows.")
    assert note == "Resampled 7 rows."
    assert json.dumps([note]) == '["Resampled 7 rows."]'
    for same in (pickle.loads(pickle.dumps(note)), copy.deepcopy(note), Note.of(note)):
        assert (same.code, same.text, type(same.text)) == ("resampled", note, str)


ROW = np.arange(6.0)


@pytest.mark.parametrize("values", [
    ROW + 0j, ROW.astype("datetime64[s]"), ROW.astype("timedelta64[s]"), ROW.astype(str),
    ROW.astype(bytes), [[1.0], [2.0, 3.0]], ["1", "OVLD"],
])  # fmt: skip
def test_what_is_no_row_of_real_numbers(values):
    refuses("not-numbers", lambda: Record.from_arrays(ROW, values))


def test_a_mask_of_numpy_counts():
    masked = np.ma.masked_array(ROW, mask=ROW > 3)
    refuses("nan-output", lambda: Record.from_arrays(ROW, masked))
    np.testing.assert_array_equal(Record.from_arrays(ROW, masked, nan="omit").mask, ROW <= 3)


def test_dates_are_seconds_and_columns_may_be_numbered():
    dates = np.datetime64("2026-01-01") + (1000 * ROW).astype("timedelta64[ms]")
    zoned = [datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=x) for x in ROW.tolist()]
    for when in (dates, dates - dates[0], zoned):
        np.testing.assert_allclose(Record.from_arrays(ROW, ROW, when).time, ROW)
        record = Record.from_arrays(ROW, ROW, when, time_unit="ms")
        np.testing.assert_allclose(record.time, 1000 * ROW)
    record = Record.from_columns({0: dates, 1: ROW, 2: -ROW}, 1, 2, 0)
    np.testing.assert_allclose(record.time, ROW)
    assert (record.input_name, record.output_name, record.time_unit) == ("1", "2", "s")


def test_columns_may_be_fields_of_an_array():
    rows = np.rec.fromarrays([ROW, -ROW], names=["u (N)", "columns"])
    for columns in (rows, np.asarray(rows)):
        record = Record.from_columns(columns, "u (N)", "columns")
        np.testing.assert_array_equal(record.output, -ROW)
        assert record.input_unit == "N"
    for columns in (ROW, [1, 2], "run.csv", None):
        refuses("no-column", lambda x=columns: Record.from_columns(x, "u", "y"), "no named columns")


@pytest.mark.parametrize("cycles", [True, False])
def test_cycles_are_whole(cycles):
    refuses("bad-option", lambda: Record.from_arrays(ROW, ROW).split_cycles(cycles))


@pytest.mark.parametrize(
    ("value", "code"), [(1e160, "too-large"), (-1e151, "too-large"), (5e-324, "zero-range")]
)
@pytest.mark.parametrize("role", ["input", "output"])
def test_numbers_whose_squares_are_no_numbers_are_refused(tmp_path, value, code, role):
    """The same in arrays and in files."""
    good, odd = np.linspace(0.0, 1.0, 9), np.zeros(9)
    odd[4] = value
    given = {"input": good, "output": good} | {role: odd}
    refuses(code, lambda: Record.from_arrays(**given))
    file = tmp_path / "run.csv"
    pairs = zip(*(x.tolist() for x in given.values()), strict=True)
    rows = "".join(f"{u!r},{y!r}\n" for u, y in pairs)
    file.write_text(f"u (N),y (mm)\n{rows}")
    refuses(code, lambda: read_csv(file, "u (N)", "y (mm)"))


def test_a_number_in_nines_far_from_all_others_is_told():
    u, y = rig().input, 100 * rig().output
    for role, mark in (("output", -999.0), ("input", 9999.0)):
        x = {"input": u.copy(), "output": y.copy()}
        x[role][[20, 21, 90]] = mark
        told, *_ = check_identifiable(Record.from_arrays(**x, source="run.csv"))
        assert (told.code, told.values) == ("missing-mark", {"role": role, "value": mark})
        assert "in 3 rows, lines 21 to 91" in told
        way = "omit" if role == "output" else "interpolate"
        assert f"(--na-values {mark:g} --nan {way})" in told
    # A pulse that high, or a reading among others, is no mark.
    for mark in (-1000.0, 99.0):
        x["input"], x["output"] = u, y.copy()
        x["output"][[20, 21, 90]] = mark
        notes = check_identifiable(Record.from_arrays(**x))
        assert "missing-mark" not in [note.code for note in notes]


def test_single_rows_far_from_all_others_are_told_as_spikes():
    u, y = rig().input, rig().output
    for role, rows in (("output", [20]), ("input", [20, 90, 95])):
        x = {"input": u.copy(), "output": y.copy()}
        x[role][rows] += 3 * np.ptp(x[role]) + np.arange(len(rows))
        told, *_ = check_identifiable(Record.from_arrays(**x, source="run.csv"))
        assert (told.code, told.values["role"]) == ("missing-mark", role)
        assert f"in {len(rows)} row" in told
        assert "a spike" in told
        assert ",".join(f"{one:.15g}" for one in sorted(x[role][rows])) in told
    # Nor is a pulse, or the rest in which a run begins, a spike.
    for rows in ([20, 21], [0]):
        y = rig().output.copy()
        y[rows] = -3 * np.ptp(y)
        notes = check_identifiable(Record.from_arrays(u, y))
        assert "missing-mark" not in [note.code for note in notes]


def test_an_angle_that_turns_over_is_told_and_commands_that_leap_are_not():
    t = np.arange(2001) * 0.01
    angle = 500 * np.sin(t)
    torque = 0.01 * angle + 0.2 * np.cos(t)
    (told,) = check_identifiable(Record.from_arrays(angle % 360, torque, t))
    assert told.code == "turned-over"
    assert told.values["size"] == pytest.approx(360, rel=0.05)
    (told,) = check_identifiable(Record.from_arrays(torque, angle % 360, t))
    assert told.code == "turned-over"
    noise = np.random.default_rng(0).normal(0, 0.01, 2001)
    slow = np.cumsum(np.where(t % 4 < 2, 0.01, -0.01))
    for input, output in ((np.where(t % 4 < 2, 5.0, 0.0) + noise, slow), (t % 4, t % 4 + slow)):
        record = Record.from_arrays(input, output, t)
        assert all(note.code != "turned-over" for note in check_identifiable(record))
