"""Dates, times of day and times since 1970 are seconds from the first row; units stand behind names."""

import numpy as np
import pytest

from hysteresis import read_csv, read_table

EVEN = [0.0, 0.5, 1.0, 1.5]


def clock_of(cells: list[str], tmp_path, header: str = "when") -> np.ndarray:
    rows = "".join(f'"{cell}",{k},{k * k}\n' for k, cell in enumerate(cells))
    (tmp_path / "run.csv").write_text(f"{header},force (N),x (mm)\n{rows}")
    return read_table(tmp_path / "run.csv").columns[header.strip('"')]


@pytest.mark.parametrize(
    "cells",
    [
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
    ],
)  # fmt: skip
def test_dates_and_times_of_day_are_seconds(cells, tmp_path):
    np.testing.assert_allclose(clock_of(cells, tmp_path), EVEN, atol=1e-9)
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


@pytest.mark.parametrize(
    "cells",
    [
        ["2020/11/5 23:58", "2020/11/5 23:59", "2020/11/6 0:00"],
        ["05.11.2020 23:58", "05.11.2020 23:59", "06.11.2020 00:00"],
        ["11/30/2020 11:58 PM", "11/30/2020 11:59 PM", "12/1/2020 12:00 AM"],
    ],
)
def test_behind_a_date_hours_and_minutes_are_enough(cells, tmp_path):
    np.testing.assert_array_equal(clock_of(cells, tmp_path), [0, 60, 120])


@pytest.mark.parametrize("bits", [16, 32])
def test_a_counter_that_turns_over_goes_on(bits, tmp_path):
    """Also twice; one that begins again is left as it is."""
    count = 2**bits - 1000 + np.arange(0, 3 * 2**bits, 2**bits // 7)
    clock = clock_of([str(k % 2**bits) for k in count], tmp_path, "micros")
    np.testing.assert_array_equal(clock, count)
    again = clock_of(["0", "500", "1000", "0", "500"], tmp_path, "micros")
    np.testing.assert_array_equal(again, [0, 500, 1000, 0, 500])


@pytest.mark.parametrize(
    ("header", "unit"),
    [
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
    ],
)  # fmt: skip
def test_units_behind_names(header, unit, tmp_path):
    clock_of(["1", "2"], tmp_path, f'"{header}"')
    record = read_csv(tmp_path / "run.csv", "force (N)", header)
    assert record.output_unit == (unit or "1")
    said = any(repr(header) in note and "taken as 1" in note for note in record.history)
    assert said == (unit is None)
