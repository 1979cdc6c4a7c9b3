"""Files in the layouts of makers, with made-up numbers: the table, its units, the roles of columns."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from hysteresis import read_table
from tests.test_hysid.command import refused, run

N = 60
T = 0.5 * np.arange(N)
DRIVE = np.abs((np.arange(N) + 15) % 30 - 15.0)  # two triangles
ANSWER = DRIVE**1.2 + np.where(np.gradient(DRIVE) > 0, 0.3, 0.0) * DRIVE


def rows(*columns: Any, sep: str = "\t", comma: bool = False, quote: str = "") -> str:
    lines = [sep.join(f"{quote}{v}{quote}" for v in row) for row in zip(*columns, strict=True)]
    return ("\n".join(lines) + "\n").replace(".", "," if comma else ".")


def numbers(x: np.ndarray, form: str = ".4f") -> list[str]:
    return [format(v, form) for v in x]


TIME, U, Y = numbers(T), numbers(DRIVE), numbers(ANSWER)
OTHER = numbers(np.cos(T))
STAMP = numbers(T + 3e9)
ONE, NONE = ["1"] * N, [""] * N


class File(NamedTuple):
    """A file, its columns with units as written, its rows, its clock, and what drives and answers."""

    content: str
    units: dict[str, str]
    time: str | None
    pair: set[str]
    encoding: str = "utf-8"
    rows: int = N
    sure: str = "sure"


MTS_HEAD = (
    "MTS793|MPT|DEU|1|2|,|.|:|49|1|1|A\n\nBediener Information\t\t\tZeit:\t24,7\ts\nPrüfer:\tM\n\n"
)
QUANTUM = (
    "[Header]\n; VSM Data File\nTITLE,loop\nBYAPP,VSM,1.0,1.1\nINFO,1.6,SAMPLE_MASS\nSTARTUPAXIS,X,2\n"
    "FIELDGROUP, VSM,2,3,4,5,6\n[Data]\n"
)
FORC = "MicroMag 2900/3900 Data File (Series 0015)\nFirst-order reversal curves\nUnits of measure:  {}\n\n"
FORC += "Averaging time = +1.0E-01\nNCrv           = 3\n\n"
TRIOS = (
    "Filename,run\nInstrument name,HR30\n[File Parameters]\nFlow torque limit,0.01 µN.m\n[step]\n"
    "Peak hold - 1\nStress,Shear rate,Step time\nPa,1/s,min\n{}\n[step]\nPeak hold - 2\n"
    "Stress,Shear rate,Step time\nPa,1/s,min\n{}\n[step]\nSweep - 3\nStorage modulus,Loss modulus,Time\n"
    "Pa,Pa,min\n1,2,3\n2,3,4\n"
)

FILES = {
    "TRIOS, steps": File(
        TRIOS.format(rows(Y, U, TIME, sep=","), rows(Y, U, TIME, sep=",")),
        {"Stress": "Pa", "Shear rate": "1/s", "Step time": "min"},
        "Step time", {"Shear rate", "Stress"}, rows=2 * N),
    "Kinexus": File(
        "Action Name;Time (sequence)(s);Shear stress(Pa);Shear rate(s-¹);Gap(mm)\n"
        + rows(["Ramp"] * N, TIME, Y, numbers(DRIVE, ".3E"), ONE, sep=";", comma=True)
        + rows(["Rest"] * N, numbers(T + 40), NONE, NONE, ONE, sep=";", comma=True),
        {"Time (sequence)(s)": "s", "Shear stress(Pa)": "Pa", "Shear rate(s-¹)": "s-¹"},
        "Time (sequence)(s)", {"Shear rate(s-¹)", "Shear stress(Pa)"}, rows=2 * N),
    "MTS 793, German, transducers named by numbers": File(
        MTS_HEAD + "Datenerfassung\t\t\tZeit:\t320,0\ts\nDatum\tLaufzeit\tCh 1 Kraft Sollwert\tCh 1 Kraft"
        "\t1944 B\t1281068\nd\ts\tkN\tkN\tmm\tmm\n" + rows(ONE, TIME, U, U, Y, OTHER, comma=True)
        + "\nDatenerfassung\t\t\tZeit:\t320,0\ts\n"
        "Ch 1 Kraft\t1944 A\t1944 B\nkN\tmm\tmm\n0,8\t0,1\t0,2\n1,8\t1,1\t1,2\n",
        {"Laufzeit": "s", "Ch 1 Kraft": "kN", "1944 B": "mm", "1281068": "mm"},
        "Laufzeit", {"Ch 1 Kraft", "1944 B"}, "latin-1"),
    "Bluehill, Polish": File(
        'Test : Tempo 1;"15,0";mm/min\nPróbki : Długość;"25,0";mm\n\n'
        "Godzina;Przemieszczenie;Obciążenie\n(s);(mm);(N)\n"
        + rows(TIME, Y, U, sep=";", comma=True, quote='"'),
        {"Godzina": "s", "Przemieszczenie": "mm", "Obciążenie": "N"},
        "Godzina", {"Przemieszczenie", "Obciążenie"}, "cp1250", sure="likely"),
    "Quantum Design, moment and temperature": File(
        QUANTUM + "Comment,Time Stamp (sec),Temperature (K),Magnetic Field (Oe),Motor Current (amps),"
        "Moment (emu)\n"
        + rows(NONE, STAMP, numbers(5 + DRIVE), ["100.07"] * N, numbers(np.cos(9 * T)), Y,
               sep=","),
        {"Temperature (K)": "K", "Moment (emu)": "emu"},
        "Time Stamp (sec)", {"Temperature (K)", "Moment (emu)"}),
    "Quantum Design, two fits of one moment": File(
        QUANTUM + "Time Stamp (sec),Magnetic Field (Oe),DC Moment Fixed Ctr (emu),DC Moment Free Ctr (emu),"
        "DC Fixed Fit,DC Free Fit\n"
        + rows(STAMP, U, Y, numbers(ANSWER + 0.01 * np.cos(9 * T)), numbers(0.8 + T / 1e3),
               numbers(0.9 + T / 1e3), sep=","),
        {"Magnetic Field (Oe)": "Oe", "DC Moment Free Ctr (emu)": "emu"},
        "Time Stamp (sec)", {"Magnetic Field (Oe)", "DC Moment Free Ctr (emu)"}),
    "several transducers": File(
        "Time (s),Load (kN),LVDT 7 (mm),LVDT 9 (mm)\n"
        + rows(TIME, U, numbers(ANSWER + 3 * np.cos(9 * T)), numbers(ANSWER + 3 * np.sin(9 * T)), sep=","),
        {"LVDT 7 (mm)": "mm"}, "Time (s)", {"Load (kN)", "LVDT 7 (mm)"}),
    "MicroMag, reversal curves": File(
        FORC.format("Hybrid SI")
        + "\n".join(rows(U[k : k + 20], Y[k : k + 20], sep=",") for k in (0, 20, 40))
        + "\nMicroMag 2900/3900 Data File ends\n",
        {"Field": "T", "Moment": "A m^2"}, None, {"Field", "Moment"}),
    "MicroMag, a loop": File(
        "MicroMag 2900/3900 Data File (Series 0016)\nDirect moment vs. field; Hysteresis loop\n\n"
        "Units of measure                 Hybrid SI\n\nSegment   Averaging   Initial   Field   Final\n"
        "1,+1.0E-01,+1.0,+5.0E-03,-1.0,+1.0,30\n2,+1.0E-01,-1.0,+5.0E-03,+1.0,+1.0,60\n\n"
        "                          Adjusted   Adjusted\n"
        "   Field       Moment       Field       Moment\n    (T)         (Am²)         (T)       (Am²)\n"
        + rows(U[:30], Y[:30], U[:30], Y[:30], sep=",") + "\n"
        + rows(U[30:], Y[30:], U[30:], Y[30:], sep=",") + "\nMicroMag 2900/3900 Data File ends\n",
        {"Field": "T", "Moment": "Am²", "Field 2": "T", "Moment 2": "Am²"}, None, {"Field", "Moment"}),
    "Model 2900": File(
        '"Model 2900 ASCII Data File",7,-1,+5.0E-01,+2.9E+02,1\n\n' + rows(U, Y, sep=","),
        {"Field": "", "Moment": ""}, None, {"Field", "Moment"}),
    "LVM without a clock": File(
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\nX_Columns\tNo\n"
        "***End_of_Header***\t\n\t\n"
        "Channels\t2\t\t\nSamples\t60\t60\t\nY_Unit_Label\tNewtons\tm/s^2\t\nX_Dimension\tTime\tTime\t\n"
        "X0\t0,0E+0\t0,0E+0\t\nDelta_X\t3,906250E-5\t3,9E-5\t\n***End_of_Header***\t\t\t\n"
        "X_Value\tExcitation (Trigger)\tResponse (Trigger)\tComment\n" + rows(NONE, U, Y, comma=True),
        {"X_Value": "s", "Excitation (Trigger)": "Newtons", "Response (Trigger)": "m/s^2"},
        "X_Value", {"Excitation (Trigger)", "Response (Trigger)"}),
    "LVM, clocks of their own": File(
        "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\t\n\t\n"
        "Channels\t2\t\t\nY_Unit_Label\tN\t\tmm\n***End_of_Header***\t\t\n"
        "X_Value\tForce\tX_Value\tPos\tComment\n"
        + rows(TIME, U, TIME[::2] + [""] * 30, Y[::2] + [""] * 30),
        {"Force": "N", "Pos": "mm", "X_Value Force": "s"}, "X_Value Pos", {"Force", "Pos"}),
    "TRIOS, oscillation before flow": File(
        "Filename\tx\n[step]\nFrequency sweep - 1\nAngular frequency\tStep time\tStorage modulus"
        "\tLoss modulus\tOscillation strain\tOscillation stress\nrad/s\ts\tPa\tPa\t%\tPa\n"
        + rows(U, TIME, Y, U, Y, U)
        + "\n[step]\nFlow ramp - 2\nStress\tShear rate\tViscosity\tTime\nPa\t1/s\tPa.s\ts\n"
        + rows(Y[:30], U[:30], ONE[:30], TIME[:30]),
        {"Stress": "Pa", "Shear rate": "1/s"}, "Time", {"Stress", "Shear rate"}, rows=30),
    "no names": File(
        rows(numbers(T, ".3f"), U, numbers(np.sin(T)), numbers(ANSWER, ".2f"), numbers(2 * DRIVE)),
        {f"column {k}": "" for k in range(1, 6)}, "column 1", {"column 2", "column 4"}, sure="guess"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_the_table_and_the_roles(name, tmp_path):
    expected, file = FILES[name], tmp_path / "run.txt"
    file.write_bytes(expected.content.encode(expected.encoding))
    told = run("init", file, "--json").json()
    units = {column["name"]: column["unit"] for column in told["columns"]}
    assert expected.units.items() <= units.items()
    assert told["rows"] == expected.rows
    chosen = told["selection"]
    assert chosen.get("time") == expected.time
    assert {chosen["input"], chosen["output"]} == expected.pair
    sure = [found["sure"] for found in told["found"] if found["what"] == "reading"]
    assert expected.sure == "sure" or expected.sure in sure


def test_what_the_rig_commanded_is_the_input(tmp_path):
    """A ramp of either quantity, a staircase, and neither: then the one that leads."""
    bent, stairs = DRIVE**2 / 15, np.repeat(np.arange(6.0), 10)
    slow = np.convolve(stairs, np.exp(-np.arange(60) / 4) / 4.5)[:N]
    for force, x, commanded, word in (
        (DRIVE, bent, "F (N)", "constant rate"),
        (bent, DRIVE, "x (mm)", "constant rate"),
        (stairs, slow, "F (N)", "goes in steps"),
        (slow, stairs, "x (mm)", "goes in steps"),
        (bent, DRIVE**1.5, "F (N)", "usual input"),
    ):
        file = tmp_path / "run.csv"
        file.write_text("t (s),F (N),x (mm)\n" + rows(TIME, numbers(force), numbers(x), sep=","))
        told = run("init", file, "--overwrite", "--json").json()
        assert told["selection"]["input"] == commanded
        why = {found["what"]: found["why"] for found in told["found"]}
        assert word in why["input"]
        # The other direction is offered as a command.
        assert any(
            told["selection"]["output"] in other.split("--output")[0]
            for other in told["alternatives"]
        )


def test_options_choose_the_table_and_bring_dialects(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    two = "Time\tForce\tDisp\ns\tN\tmm\n" + rows(TIME, U, Y) + "\nTime\tLoad\tWay\ns\tN\tmm\n"
    Path("two.txt").write_text(f"note\n\n{two}{rows(TIME[:30], U[:30], Y[:30])}")
    found = run("init", "two.txt", "--table", 2, "--nan", "interpolate", "--json").json()
    assert (found["rows"], found["selection"]["input"]) == (30, "Load")
    assert (found["selection"]["table"], found["selection"]["nan"]) == (2, "interpolate")
    assert run("check", "two.txt", "--config", "two.toml").code == 0
    refused(run("init", "two.txt", "--table", 3, "--overwrite"), "2 tables", "--table 1 to 2")
    line = "name = 'our press', signature = '^PRESS', begins = '^==', names = ['t', 'F', 'x']"
    Path("ours.toml").write_text(f"dialects = [{{{line}}}]\n")
    Path("ours.txt").write_text("PRESS v3\n9 9 9\n== data\n" + rows(TIME, U, Y, sep=" "))
    found = run("init", "ours.txt", "--dialects", "ours.toml", "--out", "it.toml", "--json").json()
    assert (found["rows"], list(found["selection"])[:2]) == (N, ["dialects", "time"])
    for bad, word in (("x = 1", "list `dialects`"), (f"dialects = [{{{line}, odd = 1}}]", "'odd'"),
                      ("dialects = [{name = 'a'}]", "no signature"), ("[", "not TOML"),
                      ("dialects = [{name = 'a', signature = '('}]", "unterminated")):  # fmt: skip
        Path("bad.toml").write_text(bad)
        said = run("init", "ours.txt", "--dialects", "bad.toml", "--overwrite")
        refused(said, "bad.toml", word, "[bad-config]")


def test_of_a_large_file_an_excerpt_is_read(tmp_path, monkeypatch):
    """Head, tail and pieces: a word in the tail is found, and the rows are estimated."""
    file, long = tmp_path / "run.csv", 60_000
    t = 0.01 * np.arange(long)
    drive = np.abs((t % 20) - 10)
    lines = [
        f"{a:.2f},{b:.4f},{b**1.2 + (0.3 * b if int(a / 10) % 2 else 0):.4f},{b:.6f}"
        for a, b in zip(t, drive, strict=True)
    ]
    lines[-5] = lines[-5].rsplit(",", 2)[0] + ",OVLD,0"
    file.write_text("t (s),F (N),x (mm),again (N)\n" + "\n".join(lines) + "\n")
    monkeypatch.setattr("hysteresis.records.importers._sheet.LARGE", 2)
    assert file.stat().st_size > 2**20
    told = run("init", file, "--json").json()
    assert told["rows"] == pytest.approx(long, rel=0.05)
    assert {told["selection"]["input"], told["selection"]["output"]} == {"F (N)", "x (mm)"}
    assert told["selection"]["na_values"] == ["OVLD"]
    assert not any("jittered" in warning for warning in told["warnings"])
    sure = {found["what"]: found["sure"] for found in told["found"]}
    assert sure["file"] == "likely"
    whole = read_table(file, na_values=["OVLD"])
    assert (len(whole.line), whole.share) == (long, 1)
    part = read_table(file, na_values=["OVLD"], most=2**19)
    assert 0.4 < part.share < 0.7
    np.testing.assert_array_equal(part.columns["t (s)"][:1000], t[:1000].round(2))
    assert part.columns["t (s)"][-1] == whole.columns["t (s)"][-1]


REFUSED = {
    "settings": ("DataLogger 4.0 Version 4.0\n____\n\nProjekt Name: PMD\nPrüfer:\n", "DataLogger"),
    "settings of a maker": (
        "[Settings]\nInstrument,LakeShore 7410 VSM\nField,100,Oe\nAveraging,10,s,per,point\nRamp,a,b\n",
        "LakeShore",
    ),
    "Quantum Design without rows": ("[Header]\nBYAPP,VSM\n[Data]\n", "Quantum Design"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_holds_no_record_is_named(name, tmp_path):
    content, word = REFUSED[name]
    file = tmp_path / "run.csv"
    file.write_text(content)
    refused(run("init", file), word, "[no-rows]")


def test_old_workbooks_need_an_extra_and_are_read(vendor_files, tmp_path):
    pytest.importorskip("python_calamine", reason="python-calamine is an extra")
    out = ("--out", tmp_path / "dma.toml", "--json")
    told = run("init", vendor_files / "gabo_eplexor.xls", *out).json()
    assert (told["rows"], told["columns"][0]["name"]) == (210, "Nr")
    assert told["selection"] == {
        "frequency": "f", "output": "E'", "loss": "E''", "condition": ["T"]
    }  # fmt: skip
