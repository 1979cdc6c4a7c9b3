"""Data loggers, oscilloscopes, robots and numbers without names."""

from collections.abc import Mapping
from datetime import datetime, timedelta

import numpy as np

from ._machines import NONE, NUMBERS, ONES, TEMPERATURE, F, T, X
from ._variant import N, Variant, table

BEGIN = datetime(2020, 11, 5, 10, 59, 58)
MOMENTS = [BEGIN + timedelta(seconds=t) for t in T]
ISO = [m.isoformat(" ", "milliseconds") for m in MOMENTS]
GERMAN = [m.strftime("%d.%m.%Y %H:%M:%S,") + f"{m.microsecond // 1000:03d}" for m in MOMENTS]
CLOCK = [m.strftime("%H:%M:%S.") + f"{m.microsecond // 1000:03d}" for m in MOMENTS]
NANOSECONDS = [1_600_000_000_000_000_000 + round(1e9 * t) for t in T]
VOLTS = [v / 3 for v in F]
WRENCH = [(np.sin(k * np.array(T) + k)).tolist() for k in range(6)]

LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t{}\n"
    "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\nOperator\ta\nDate\t2020/11/05\n"
    "Time\t10:00:00\n***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t160\t160\t\n"
    "Y_Unit_Label\tN\tmm\t\nX_Dimension\tTime\tTime\t\nX0\t0\t0\t\nDelta_X\t0{}05\t0{}05\t\n"
    "***End_of_Header***\t\t\t\nX_Value\tForce\tPosition\tComment\n"
)
SEGMENT = LVM.format(".", ".", ".").partition("***End_of_Header***\t\n\t\n")[2]
CATMAN = (
    "HBM_CATMANDATA\nFile: a.bin\nNumber of channels: 3\n\nTime  1 - default sample rate\tForce\tDisp\n"
    "s\tN\tmm\nMX840_0_CH 0\tMX840_0_CH 1\tMX840_0_CH 2\n"
)
UFF = (
    "    -1\n    58\n{}\nNONE\n05-Nov-20 10:00:00\n{}\nNONE\n"
    "    1         1    1         0       NONE         1   {}       NONE         0   0\n"
    "         2       160         1  0.00000e+00  5.00000e-02  0.00000e+00\n"
    "        17    0    0    0                 Time                    s\n"
    "        {}    0    0    0             {:>8}             {:>8}\n"
    "         0    0    0    0                 NONE                 NONE\n"
    "         0    0    0    0                 NONE                 NONE\n"
)


def uff(values: list[float], name: str, axis: str, unit: str, kind: int, direction: int) -> str:
    """One data set 58: an even record over time, six values a line."""
    lines = [
        "".join(f"{v:13.5e}" for v in values[k : k + 6]) + "\n" for k in range(0, len(values), 6)
    ]
    return UFF.format(name, name, direction, kind, axis, unit) + "".join(lines) + "    -1\n"


def loggers() -> Mapping[str, Variant]:
    """Variants by program and what is particular about them."""
    pair = ("Force (N)", "Position (mm)")
    plain = {"Force (N)": "N", "Position (mm)": "mm"}
    named = "Force (N),Position (mm)\n"
    return {
        "LVM, comma": Variant(
            LVM.format(",", ",", ",") + table(T, F, X, sep="\t", comma=True),
            {"Force": "N", "Position": "mm"}, "X_Value", ("Force", "Position"), ".lvm",
        ),
        "LVM, two segments": Variant(
            LVM.format(".", ".", ".") + 2 * (table(T, F, X, sep="\t") + SEGMENT)
            + table(T, F, X, sep="\t"),
            {"Force": "N", "Position": "mm"}, "X_Value", ("Force", "Position"), ".lvm", rows=3 * N,
        ),
        "catman": Variant(
            CATMAN + table(T, F, X, sep="\t", comma=True), {"Force": "N", "Disp": "mm"},
            "Time 1 - default sample rate", ("Force", "Disp"), ".asc", "cp1252",
        ),
        "DEWESoft": Variant(
            "Data source file: a.d7d\nSample rate: 20\n\nTime (s);Force (N);Position (mm)\n"
            + table(T, F, X, sep=";"), plain, "Time (s)", pair,
        ),
        "PicoScope, an empty line below the units": Variant(
            "Time,Channel A,Channel B\n(ms),(V),(mV)\n\n" + table(T, F, X),
            {"Channel A": "V", "Channel B": "mV"}, "Time", ("Channel A", "Channel B"),
        ),
        "WaveForms, notes behind a number sign": Variant(
            "#Digilent WaveForms Oscilloscope\n#Sample rate: 20Hz\n\nTime (s),Channel 1 (V),Channel 2 (V)\n"
            + table(T, F, X), {"Channel 1 (V)": "V", "Channel 2 (V)": "V"}, "Time (s)",
            ("Channel 1 (V)", "Channel 2 (V)"),
        ),
        "dates, ISO": Variant(
            "Timestamp," + named + table(ISO, F, X), plain, "Timestamp", pair,
        ),
        "dates, German": Variant(
            "Datum;Kraft [N];Weg [mm]\n" + table(GERMAN, F, X, sep=";", comma=True),
            {"Kraft [N]": "N", "Weg [mm]": "mm"}, "Datum", ("Kraft [N]", "Weg [mm]"),
        ),
        "a clock on the wall": Variant(
            "Time," + named + table(CLOCK, F, X), plain, "Time", pair,
        ),
        "a date and a clock beside a counter": Variant(
            "Sample Number,Date,Time,Elapsed (s),Load (lb),Position (in)\n"
            + table(NUMBERS, ["11/5/2020"] * N, ["10:00:00 AM"] * N, T, F, X),
            {"Load (lb)": "lb", "Position (in)": "in"}, "Elapsed (s)", ("Load (lb)", "Position (in)"),
        ),
        "milliseconds of a microcontroller": Variant(
            "millis,force_N,pos_mm\n" + table([round(1e3 * t) for t in T], F, X),
            {"force_N": "N", "pos_mm": "mm"}, "millis", ("force_N", "pos_mm"),
        ),
        "a serial monitor": Variant(
            "time_ms\tload_g\tpos_um\n" + table([round(1e3 * t) for t in T], F, X, sep="\t"),
            {"load_g": "g", "pos_um": "um"}, "time_ms", ("load_g", "pos_um"), ".log",
        ),
        "rostopic, a wrench and a position": Variant(
            "%time,field.header.seq,field.header.stamp,field.wrench.force.z,field.position.z\n"
            + table(NANOSECONDS, NUMBERS, NANOSECONDS, F, X),
            {"field.wrench.force.z": "", "field.position.z": ""}, "%time",
            ("field.wrench.force.z", "field.position.z"),
        ),
        "PlotJuggler": Variant(
            "__time,/ft/force/z,/arm/position/z\n" + table([1.6e9 + t for t in T], F, X, form="{:.6f}"),
            {"/ft/force/z": "", "/arm/position/z": ""}, "__time", ("/ft/force/z", "/arm/position/z"),
        ),
        "a joint with its command": Variant(
            "t,tau_cmd,tau,q_ref,q\n" + table(T, F, [v + 0.01 for v in F], X, X),
            {"tau": "", "q": ""}, "t", ("tau", "q"),
        ),
        "a wrench with a clock": Variant(
            "time,Fx,Fy,Fz,Mx,My,Mz\n" + table(T, *WRENCH), {"Fz": ""}, "time", None,
        ),
        "a soft sensor": Variant(
            "Time (s),Pressure (kPa),Resistance (ohm),Temperature (C)\n" + table(T, F, X, TEMPERATURE),
            {"Pressure (kPa)": "kPa", "Resistance (ohm)": "ohm"}, "Time (s)",
            ("Pressure (kPa)", "Resistance (ohm)"),
        ),
        "a piezo actuator, microvolts and micrometres": Variant(
            "Time [s]\tVoltage [V]\tDisplacement [µm]\n" + table(T, F, X, sep="\t"),
            {"Voltage [V]": "V", "Displacement [µm]": "µm"}, "Time [s]",
            ("Voltage [V]", "Displacement [µm]"), encoding="cp1252",
        ),
        "units in angle brackets and braces": Variant(
            "Time{s};Load<N>;Pos<mm>\n" + table(T, F, X, sep=";"), {"Load<N>": "N", "Pos<mm>": "mm"},
            "Time{s}", ("Load<N>", "Pos<mm>"),
        ),
        "names listed in a comment": Variant(
            "# units: m N\n# columns: height force\n" + table(X, F, sep=" ", form="{:.6e}"), {}, None,
            ("height", "force"), ".txt",
        ),
        "microseconds and counts": Variant(
            "time_us,adc,force_mN\n" + table([round(1e6 * t) for t in T], X, F), {"force_mN": "mN"},
            "time_us", ("force_mN", "adc"),
        ),
        "bars": Variant(
            "Time (s)|Force (N)|Position (mm)\n" + table(T, F, X, sep="|"), plain, "Time (s)", pair,
        ),
        "bars at both ends": Variant(
            "| Time (s) | Force (N) | Position (mm) |\n|---|---|---|\n"
            + "".join(f"| {a:.3f} | {b:.4f} | {c:.4f} |\n" for a, b, c in zip(T, F, X, strict=True)),
            plain, "Time (s)", pair, ".md",
        ),
        "blanks, no names": Variant(
            table(T, F, X, sep="  "), {}, "column 1", ("column 2", "column 3"), ".out",
        ),
        "Fortran's exponents": Variant(
            " time (s)   force (N)   x (mm)\n"
            + table(T, F, X, sep="  ", form="{:.4E}").replace("E", "D"),
            {"force (N)": "N", "x (mm)": "mm"}, "time (s)", ("force (N)", "x (mm)"), ".txt",
        ),
        "thousands with points, German": Variant(
            "Zeit [s];Kraft [N];Weg [mm]\n"
            + "".join(f"{a:.2f}".replace(".", ",") + f";{1000 * b + 1000:,.2f};{c:.3f}\n".translate(
                str.maketrans(",.", ".,")) for a, b, c in zip(T, F, X, strict=True)),
            {"Kraft [N]": "N"}, "Zeit [s]", ("Kraft [N]", "Weg [mm]"),
        ),
        "trailing text": Variant(
            "Time (s),Force (N),Position (mm),Remark\n" + table(T, F, X, [*NONE[:-1], "end of test"])
            + "\nTest ended by operator\n", plain, "Time (s)", pair,
        ),
        "old line ends, a byte-order mark": Variant(
            ("Time (s);Force (N);Position (mm)\n" + table(T, F, X, sep=";")).replace("\n", "\r"),
            plain, "Time (s)", pair, encoding="utf-8-sig",
        ),
        "sep= for a spreadsheet": Variant(
            "sep=;\nTime (s);Force (N);Position (mm)\n" + table(T, F, X, sep=";"), plain, "Time (s)", pair,
        ),
        "UFF 58, force and displacement": Variant(
            uff(F, "Load", "Force", "N", 13, 3) + uff(X, "LVDT", "Displ", "mm", 8, 3),
            {"Load": "N", "LVDT": "mm"}, "time", ("Load", "LVDT"), ".uff",
        ),
        "overloads and missing cells": Variant(
            "Time (s),Force (N),Position (mm)\n"
            + table(T, [*F[:9], "OVLD", *F[10:]], [*X[:20], "", *X[21:]]),
            plain, "Time (s)", pair,
        ),
        "one sensor": Variant(
            "Time (s),Temperature (C),Humidity (%)\n" + table(T, TEMPERATURE, ONES), {}, "Time (s)", None,
        ),
    }  # fmt: skip
