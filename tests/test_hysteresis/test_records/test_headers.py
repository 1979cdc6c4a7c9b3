"""What files say of their columns at their beginning: names, units, settings, dates and clocks."""

import json

import numpy as np
import pytest

from hysteresis import InputError, read_csv, read_table
from tests.test_hysteresis.test_records.test_importers import F, T, X


def rows(*columns: np.ndarray, sep: str = "\t") -> str:
    lines = (sep.join(f"{v:.4f}" for v in row) for row in zip(*columns, strict=True))
    return "\n".join(lines) + "\n"


OBJECTS = [{"t_s": t, "ft": {"z": f, "xy": [0.0, None]}} for t, f in zip(T, F, strict=True)]
LINES = "\n".join(map(json.dumps, OBJECTS))


@pytest.mark.parametrize(
    "text",
    [LINES, LINES.replace("\n", "\n\n"), json.dumps(OBJECTS), json.dumps(OBJECTS, indent=2),
     f"[\n{LINES.replace(chr(10), ',' + chr(10))}\n]\n", LINES + '\n{"t_s": 3.0, "ft'],
)  # fmt: skip
def test_objects_are_rows(text, table):
    found = table(text)
    assert list(found.columns) == ["t_s", "ft.z", "ft.xy.0", "ft.xy.1"]
    np.testing.assert_allclose(found.number("ft.z"), F)
    assert np.isnan(found.number("ft.xy.1")).all()


def test_lists_in_an_object_are_columns(table):
    found = table(json.dumps({"time_s": T.tolist(), "force_N": F.tolist()}))
    np.testing.assert_allclose(found.number("force_N"), F)


@pytest.mark.parametrize(("text", "code"), [
    ('{"a": 1}\n{"a": 2, b}\n{"a": 3}\n', "damaged-file"),
    ('{"settings": {"rate": 100}}', "no-rows"),
    ('{"a": ' + 4000 * "[", "damaged-file"),
    ("\n".join(f'{{"k{k}": 1}}' for k in range(3000)), "too-many-columns"),
])  # fmt: skip
def test_json_that_holds_no_table_is_refused_by_name(text, code, table):
    with pytest.raises(InputError, match=r"JSON|objects") as caught:
        table(text)
    assert caught.value.code == code


def set_with_blanks(*cells: str) -> str:
    return "".join(f"{cell:>14}" for cell in cells)


LINES_OF_NUMBERS = [row.split() for row in rows(T, F).split("\n")[:-1]]
NUMBERS = "\n".join(set_with_blanks(str(k), *row) for k, row in enumerate(LINES_OF_NUMBERS))
UNITS = {
    "right": set_with_blanks("Index", "t", "Axial Force")
    + "\n"
    + set_with_blanks("", "[s]", "[N]"),
    "left": "  Index       t           Axial Force\n              s           N",
    "narrow": "Index t Force\n      s N",
}


@pytest.mark.parametrize("header", UNITS.values(), ids=UNITS)
@pytest.mark.parametrize("notes", ["", "Curve:\n  a rubber\n"])
def test_units_stand_under_their_names(header, notes, table):
    found = table(f"{notes}{header}\n{NUMBERS}\n")
    assert [found.units.get(name) for name in found.columns] == [None, "s", "N"]
    assert len(found.line) == 12


@pytest.mark.parametrize("sep", [",", ";", "\t"])
def test_units_of_all_columns_but_the_first(sep, table):
    found = table(f"Index{sep}t{sep}Force\n{sep}s{sep}N\n" + rows(np.arange(12), T, F, sep=sep))
    assert [found.units.get(name) for name in found.columns] == ["", "s", "N"]


FACTS = ("MX840_1 CH 0\tMX840_1 CH 1\tMX840_1 CH 2", "10 Hz Bessel\t10 Hz Bessel", "\tcalibrated\t")


@pytest.mark.parametrize("facts", [FACTS[:1], FACTS[1:2], FACTS[:2], FACTS])
@pytest.mark.parametrize(
    "names", ["t [s]\tF [kN]\tx [mm]", "t\tF\tx\ns\tkN\tmm", "t (s)\tF (kN)\tx (mm)"]
)
@pytest.mark.parametrize("notes", ["", "RECORDER\n\n"])
def test_names_stand_above_rows_of_channel_facts(facts, names, notes, table):
    found = table("\n".join([notes + names, *facts, rows(T, F, X)]))
    assert [name.split()[0] for name in found.columns] == ["t", "F", "x"]
    np.testing.assert_allclose(list(found.columns.values())[2], X)


def test_a_first_row_of_numbers_oddly_written_is_no_row_of_words(table):
    with pytest.raises(InputError, match="cannot be used as a number"):
        table("F [N];x [mm]\n1.234,5;N/A\n2,5;2,5\n3,5;2,5\n").number("F [N]")


@pytest.mark.parametrize(
    "text", ["18985\n19062\n19190\n", "1,5\n2,5\n", "# read by hand\n-1e3\n2\n"]
)
def test_the_first_value_of_a_column_without_a_name_is_a_value(text, table):
    found = table(text)
    lines = [line for line in text.split("\n")[:-1] if line[0] != "#"]
    assert (len(found.line), next(iter(found.columns))) == (len(lines), "column 1")
    assert found.notes[0].code == "no-header"


def test_comments_name_the_columns_and_their_units(table):
    found = table("# of a press\n# t\tF\n# s\tN\n" + rows(T, F))
    assert dict(found.units) == {"t": "s", "F": "N"}


def counted(*columns: np.ndarray) -> str:
    """Rows of an oscilloscope, which end with a separator."""
    return "".join(f"{line},\n" for line in rows(np.arange(12), *columns, sep=",").split("\n")[:-1])


SCOPES = {
    "two channels": "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-4.0e-03,2.0e-05\n"
    + counted(F, X),
    "one channel": "X,CH1,Start,Increment,\nSequence,Volt,-4.0e-03,2.0e-05\n" + counted(F),
    "other words": 'n;CH1;CH2;"t0";"dt (ms)"\n;V;mV;-4e-3;0.02\n' + rows(T, F, X, sep=";"),
    "settings first": "Increment,Start,X,CH1\n2e-5,-4e-3,0,0.5\n"
    + "".join(f",,{k},{0.5 + k}\n" for k in range(1, 12)),
    "among the names": "CH1 (V),CH2 (V),t0 =-0.004s, tInc = 2e-05,\n"
    + "".join(f"{line},,\n" for line in rows(F, X, sep=",").split("\n")[:-1]),
    "a note": "Sample Interval,2.0E-5,s\nStart,-0.004\nCH1 (V),CH2 (V)\n" + rows(F, X, sep=","),
}


@pytest.mark.parametrize("text", SCOPES.values(), ids=SCOPES)
def test_an_oscilloscope_tells_its_clock_in_the_header(text, table):
    found = table(text)
    np.testing.assert_allclose(found.number("time"), -4e-3 + 2e-5 * np.arange(12), atol=1e-12)
    assert (found.units["time"], found.text["time"][0]) == ("s", "-0.004")
    assert not [name for name in found.columns if "ncrement" in name or "=" in name]
    assert any(note.code == "clock" for note in found.notes)


@pytest.mark.parametrize(
    ("note", "step"),
    [("# SAMPLE_TIME = 0.00005", 5e-5), ("# Sampling rate: 20 kHz", 5e-5), ("# dt=0.01", 0.01),
     ("Sample Period\t5 ms", 5e-3), ("Abtastrate: 100,0 Hz", 0.01), ("sample_rate_hz: 50", 0.02),
     ("# Sample interval [ms]: 0.5", 5e-4), ("Sampling frequency 200 Sa/s", 5e-3)],
)  # fmt: skip
def test_notes_tell_the_clock_of_a_table_without_one(note, step, table):
    found = table(f"{note}\nForce [N]\tPosition [mm]\n" + rows(F, X))
    np.testing.assert_allclose(found.number("time"), step * np.arange(12))


@pytest.mark.parametrize(
    ("note", "names"),
    [("# Sample rate: 20 Hz", "Time [s]\tx"), ("# Rate: 5 mm/min", "F\tx"), ("# Sample rate: 5 kg", "F\tx"),
     ("# Sample rate: 20 Hz\n# dt = 3", "F\tx"), ("# dt = 0.5", "n\tx"), ("# Sample rate: 0 Hz", "F\tx")],
)  # fmt: skip
def test_a_note_makes_no_second_clock_and_none_of_what_it_does_not_say(note, names, table):
    assert "time" not in table(f"{note}\n{names}\n" + rows(T, X)).columns


LISTS = {
    "a recorder": "# VERSION = 1\n# DIM = 2\n#\n# NAME0 = Force\n# NAME1 = Position\n# END",
    "units too": "# NAME0 = Force\n# NAME1 = Position\n# UNIT0 = N\n# UNIT1 = mm",
    "columns": "% Column 1: Force\n% Column 2: Position".replace("%", "#"),
    "no comments": "Channel 1 Name\tForce\nChannel 1 Unit\tN\nChannel 2 Name\tPosition\nChannel 2 Unit\tmm",
    "bare numbers": "# 0 = Force [N]\n# 1 = Position [mm]",
}


@pytest.mark.parametrize("notes", LISTS.values(), ids=LISTS)
def test_notes_list_the_names_of_columns(notes, table):
    found = table(f"{notes}\n" + rows(F, X))
    assert [name.split(" ")[0] for name in found.columns] == ["Force", "Position"]
    assert len(found.line) == 12
    if "UNIT" in notes.upper():
        assert dict(found.units) == {"Force": "N", "Position": "mm"}


@pytest.mark.parametrize(
    ("notes", "units"),
    [("Units: lbF\nX-Axis: Travel\nTravel Unit: in", ["lbf", "in"]), ("# Units: kN, mm", ["kN", "mm"]),
     ("Load units = N\nUnit of travel: mm", ["N", "mm"]), ("Einheit Travel: mm", [None, "mm"]),
     ("Units: SI", [None, None]), ("Units: mm/s", [None, None]), ("Force unit: N", ["N", None])],
)  # fmt: skip
def test_notes_tell_the_units_of_columns(notes, units, table):
    found = table(f"{notes}\nLoad\tTravel\n" + rows(F, X))
    assert [found.units.get(name) for name in ("Load", "Travel")] == units


@pytest.mark.parametrize(
    ("names", "units"),
    [("Time s,I1 A,P1 uC_per_cm2", ["s", "A", None]), ("n,Time s,Load kN", [None, "s", "kN"]),
     ("Load N,Load S,Load W", [None] * 3), ("Load min,Stroke min,T min", [None] * 3),
     ("Time s,Cell A,Cell B", [None] * 3), ("v mm/s,F N,x µm", ["mm/s", "N", "µm"])],
)  # fmt: skip
def test_units_behind_blanks_where_most_names_have_one(names, units, table):
    found = table(f"{names}\n" + rows(F, X, F, sep=","))
    assert [found.units.get(name) for name in names.split(",")] == units


EVEN = [0.0, 0.5, 1.0, 1.5]


def clock_of(cells: list[str], tmp_path, header: str = "when") -> np.ndarray:
    rows = "".join(f'"{cell}",{k},{k * k}\n' for k, cell in enumerate(cells))
    (tmp_path / "run.csv").write_text(f"{header},force (N),x (mm)\n{rows}")
    return read_table(tmp_path / "run.csv").columns[header.strip('"')]


@pytest.mark.parametrize("cells", [
    ["2020-11-05T23:59:59", "2020-11-05T23:59:59.500", "2020-11-06T00:00:00", "2020-11-06T00:00:00.5"],
    ["2020-11-05 10:00:00", "2020-11-05 10:00:00,5", "2020-11-05 10:00:01", "2020-11-05 10:00:01,5"],
    ["05.11.2020 23:59:59", "05.11.2020 23:59:59,5", "06.11.2020 00:00:00", "06.11.2020 00:00:00,5"],
    ["11/30/2020 23:59:59", "11/30/2020 23:59:59.5", "12/1/2020 00:00:00", "12/1/2020 00:00:00.5"],
    ["2020/11/5 23:59:59", "2020/11/5 23:59:59.5", "2020/11/6 0:00:00", "2020/11/6 0:00:00.5"],
    ["11:59:59 AM", "11:59:59.5 AM", "12:00:00 PM", "12:00:00.5 PM"],
    ["23:59:59.0", "23:59:59.5", "00:00:00.0", "00:00:00.5"],
    ["00:00:01:000", "00:00:01:500", "00:00:02:000", "00:00:02:500"],
    ["0:00.0", "0:00.5", "0:01", "0:01.5"],
    ["59:59,0", "59:59,5", "00:00,0", "00:00,5"],
    ["2020/11/5 23:58", "2020/11/5 23:59", "2020/11/6 0:00"],
    ["05.11.2020 23:58", "05.11.2020 23:59", "06.11.2020 00:00"],
    ["11/30/2020 11:58 PM", "11/30/2020 11:59 PM", "12/1/2020 12:00 AM"],
    ["2020-11-30T23:58:00", "2020-11-30T23:59:00", "2020-12-01"],
    ["30-Nov-2020 23:58:00", "30-NOV-2020 23:59:00", "01-Dec-2020 00:00:00"],
    ["2020-11-30 23:58:00 UTC", "2020-12-01 01:59:00+0200", "2020-11-30 19:00:00 -05:00"],
])  # fmt: skip
def test_dates_and_times_of_day_are_seconds(cells, tmp_path):
    per = 1 if len(cells) == 4 else 120  # behind a date, hours and minutes are enough
    wanted = per * np.array(EVEN[: len(cells)])
    np.testing.assert_allclose(clock_of(cells, tmp_path), wanted, atol=1e-9)
    record = read_csv(tmp_path / "run.csv", "force (N)", "x (mm)", "when")
    assert record.time_unit == "s"
    assert "clock" in {note.code for note in record.history}


def test_times_since_1970_are_told_by_their_size(tmp_path):
    for step, first in ((1.0, 1.6e9), (1e3, 1.6e12), (1e6, 1.6e15), (1e9, 1.6e18)):
        cells = [f"{first + t * step:.1f}" for t in EVEN]
        np.testing.assert_allclose(clock_of(cells, tmp_path, "timestamp"), EVEN, atol=1e-6)
    # A column of another name, or with a unit, is what it is.
    assert clock_of(["1.6e9", "1.7e9"], tmp_path, "pressure")[0] == 1.6e9
    assert clock_of(["1.6e9", "1.7e9"], tmp_path, "time (ms)")[0] == 1.6e9


@pytest.mark.parametrize("header", ["time (s)", "when"])
def test_rows_of_which_the_newest_stands_first_are_turned_round(header, tmp_path):
    stamps = [f"12:00:{t:02d}" if header == "when" else str(t) for t in range(8)]
    text = f"{header},force (N),x (mm)\n"
    for name, order in (("old.csv", 1), ("new.csv", -1)):
        rows = [f"{stamp},{k},{k * k}\n" for k, stamp in enumerate(stamps)][::order]
        (tmp_path / name).write_text(text + "".join(rows))
    old, new = (
        read_csv(tmp_path / n, "force (N)", "x (mm)", header) for n in ("old.csv", "new.csv")
    )
    for one, other in ((old.time, new.time), (old.input, new.input), (old.line[::-1], new.line)):
        np.testing.assert_array_equal(one, other)
    assert any("newest row stands first" in str(note) for note in new.history)
    assert new.lines(np.array([0, 7])) == "lines 2 to 9"


def test_days_of_a_spreadsheet_are_seconds(tmp_path):
    """To 12 digits of a day: 1e-7 s."""
    cells = [f"{45356.5 + t / 86_400:.12f}" for t in EVEN]
    for header in ("Date", "time"):
        np.testing.assert_allclose(clock_of(cells, tmp_path, header), EVEN, atol=1e-6)
    # Seconds may pass through such values.
    assert clock_of(["40000.5", "40001.5"], tmp_path, "time")[0] == 40000.5
    assert clock_of(["40000.5", "40001.5"], tmp_path, "load")[0] == 40000.5


def test_what_is_no_clock_stays_text(tmp_path):
    for cells in (["a:b", "c:d"], ["10:00:00", "word"], ["10:00", "10:01"], ["1:2:3:4:5", "1:2:3:4:6"],
                  ["99/99/2020 10:00:00", "98/99/2020 10:00:00"], ["10:00:00", "10:00:00"]):  # fmt: skip
        assert clock_of(cells, tmp_path).dtype.kind == "U"


def test_counters_of_a_microcontroller_have_their_unit(tmp_path):
    clock_of(["0", "500", "1000"], tmp_path, "millis")
    assert read_csv(tmp_path / "run.csv", "force (N)", "x (mm)", "millis").time_unit == "ms"


@pytest.mark.parametrize(("name", "unit"), [("ms", "ms"), ("Seconds", "s"), ("t", "1")])
def test_a_time_column_may_be_called_as_its_unit(name, unit, tmp_path):
    clock_of(["0", "500", "1000"], tmp_path, name)
    assert read_csv(tmp_path / "run.csv", "force (N)", "x (mm)", name).time_unit == unit


@pytest.mark.parametrize("header", ["micros", "time (ms)", "t"])
@pytest.mark.parametrize("bits", [16, 32])
def test_a_counter_that_turns_over_goes_on(bits, header, tmp_path):
    """Also twice; one that begins again is left as it is."""
    count = 2**bits - 1000 + np.arange(0, 3 * 2**bits, 2**bits // 7)
    clock = clock_of([str(k % 2**bits) for k in count], tmp_path, header)
    np.testing.assert_array_equal(clock, count)
    told = clock_of([str(k % 2**bits / 1e3) for k in count], tmp_path, header)
    if bits == 32:  # microseconds told as milliseconds
        np.testing.assert_allclose(told, count / 1e3, rtol=1e-12)
    again = clock_of(["0", "500", "1000", "0", "500"], tmp_path, header)
    np.testing.assert_array_equal(again, [0, 500, 1000, 0, 500])


@pytest.mark.parametrize(("header", "unit"), [
    ("Kraft / N", "N"), ("Kraft in kN", "kN"), ("Load, N", "N"), ("F/N", "N"), ("dL/µm", "µm"),
    ("dL/\u03bcm", "\u03bcm"), ("Load<N>", "N"), ("Time{s}", "s"), ("GP in 1/s", "1/s"),
    ("Stress, N/mm2", "N/mm^2"), ("mV/V", None), ("velocity mm/s", None), ("Change in length", None),
    ("Torque_Nm", "N*m"), ("R_kOhm", "kohm"), ("HV_kV", "kV"), ("G1 (µε)", "um/m"), ("n_cycles", None),
    ("force_pos", None), ("荷重（N）", "N"), ("温度(℃)", "degC"), ("ひずみ［％］", "percent"),
    ("変位（㎜）", "mm"), ("トルク(N・m)", "N*m"),
    ("Fx/Fz", None), ("No, 5", None), ("Channel A", None), ("Stress (step)", None), ("a / b", None),
    ("Force [kN]", "kN"), ("force_N", "N"), ("x_location", None), ("Stiffness (N/mm)", "N/mm"),
    ("Angle (°)", "deg"), ("Load (%)", "percent"), ("Signal [-]", "1"), ("Moment_emu", "emu"),
    ("P1 uC_per_cm2", "uC/cm^2"), ("P_uC_per_cm2", "uC/cm^2"), ("P_uC/cm2", "uC/cm^2"),
    ("P, µC/cm²", "µC/cm²"), ("y (Pas)", "Pa*s"), ("y (N-m)", "N*m"), ("y (cm2)", "cm^2"),
    ("y (in.)", "in"), ("y (sec.)", "s"), ("y (кН)", "kN"), ("y (s-1)", "1/s"),
])  # fmt: skip
def test_units_behind_names(header, unit, tmp_path):
    clock_of(["1", "2"], tmp_path, f'"{header}"')
    record = read_csv(tmp_path / "run.csv", "force (N)", header)
    assert record.output_unit == (unit or "1")
    said = any(repr(header) in note and "taken as 1" in note for note in record.history)
    assert said == (unit is None)
