"""`hysid init`: what it makes of a file, and that `hysid fit` takes it as it is."""

import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysid.intake._own_config import read_config
from hysteresis import read_csv, read_table
from hysteresis.records._table import rows_read
from tests.test_hysid.command import LINE, F, T, X, put, refused, run, sponge, text

ROWS = sponge()
CLEAN = text(ROWS)
LOOP = np.concatenate([np.linspace(0, 1, 12), np.linspace(1, 0, 12)[1:]])

pytestmark = pytest.mark.usefixtures("empty_folder")


def guessed(content: str | bytes, *options: str, name: str = "run.csv") -> dict:
    return run("init", put(content, name), *options, "--json").json()


def usable(found: dict) -> bool:
    """The other commands take what was written."""
    return run("check", found["source"], "--config", found["file"]).code == 0


def columns(found: dict) -> tuple:
    selection = found["selection"]
    return selection.get("time"), selection.get("input"), selection["output"]


def renamed(time: str, force: str, x: str, separator: str = ",", comma: bool = False) -> str:
    content = text([row[:3] for row in ROWS], (time, force, x), separator)
    head, body = content.split("\n", 1)
    return f"{head}\n{body.replace('.', ',') if comma else body}"


def test_fit_takes_what_init_wrote():
    said = run("init", put(CLEAN))
    assert said.code == 0
    document = tomllib.loads(Path("run.toml").read_text("utf-8"))
    assert document["selection"] == {"input": F, "output": X, "time": T, "test_cycles": 1}
    command = said.out.splitlines()[-1].split()
    assert command == ["hysid", "fit", "run.csv", "--config", "run.toml", "--out", "run"]
    fitted = run(*command[1:], *LINE, "--json").json()
    assert fitted["selection"]["test_cycles"] == 1
    assert fitted["metrics"]["test"]["nrmse_percent"] < 10
    looked = run("check", "run.csv", "--config", "run.toml")
    assert looked.code == 0
    assert "5 complete cycles" in looked.out
    refused(run("fit", "run.toml"), "holds options", "hysid fit run.csv --config run.toml")


def test_a_configuration_that_is_there_is_kept():
    put("mine", "run.toml")
    refused(run("init", put(CLEAN)), "run.toml", "--overwrite", "[would-overwrite]")
    assert Path("run.toml").read_text() == "mine"
    assert run("init", "run.csv", "--out", "new/other.toml").code == 0
    assert Path("new/other.toml").exists()
    assert run("init", "run.csv", "--overwrite").code == 0
    assert Path("run.toml").read_text() != "mine"


@pytest.mark.parametrize(("time", "force", "x"), [
    ("time_s", "force_N", "displacement_mm"), ("Zeit", "Kraft", "Weg"),
    ("Prüfzeit (s)", "Standardkraft (N)", "Standardweg (mm)"),
    ("Temps", "Charge [kN]", "Déplacement [mm]"), ("t", "F", "x (um)"),
    ("elapsed (s)", "Load", "Extension"), ("Time (s)", "Stress (kPa)", "Strain (%)"),
    ("time", "loadCell_N", "sensorVoltage_V"), ("clock", "field (Oe)", "moment (emu)"),
    ("%time", "field.wrench.force.z", "field.pose.position.z"),
])  # fmt: skip
def test_columns_are_known_by_their_names(time, force, x):
    assert columns(guessed(renamed(time, force, x))) == (time, force, x)


def test_names_that_say_nothing_leave_it_to_the_loop():
    found = guessed(renamed("tick", "alpha", "beta"))
    assert columns(found) == ("tick", "alpha", "beta")
    assert {f["sure"] for f in found["found"] if f["what"] == "input"} == {"guess"}
    rows = [[t, f, x, f"{np.sin(k):.3f}"] for k, (t, f, x, _) in enumerate(ROWS)]
    many = put(text(rows, ("tick", "alpha", "beta", "gammy")), "many.csv")
    refused(run("init", many), "'beta'", "--input", "--output", "[cannot-decide]")
    asked = run("init", many, "--input", "alpha", "--output", "beta", "--json").json()
    assert columns(asked) == ("tick", "alpha", "beta")
    refused(run("init", many, "--overwrite", "--input", "delta"), "'delta'", "'alpha'")


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_a_copy_that_was_taken_off_is_no_response(order):
    travel = 0.03 * np.arange(300) - 924.8
    extension = np.minimum(0.6 * (travel + 924.8), 3.9)  # taken off before the specimen fails
    force = 9000 * (1 - np.exp(-(travel + 924.8))) + np.random.default_rng(0).normal(0, 5, 300)
    columns = [(travel, ".3f"), (extension, ".3f"), (force, ".2f")]
    columns = [columns[k] for k in order]
    rows = [[format(x[k], form) for x, form in columns] for k in range(300)]
    put("\n".join(map("\t".join, rows)), "run.txt")
    told = run("init", "run.txt", "--json").json()["selection"]
    names = {number: f"column {place + 1}" for place, number in enumerate(order)}
    assert (told["input"], told["output"]) == (names[0], names[2])


def test_a_decimal_comma_and_units_below_the_header():
    content = renamed("Zeit", "Kraft", "Weg", ";", comma=True)
    found = guessed(content)
    assert columns(found) == ("Zeit", "Kraft", "Weg")
    assert found["selection"]["decimal"] == ","
    head, body = content.split("\n", 1)
    plain = guessed(f"{head}\nSek;Newton;mm\n{body}", name="plain.csv")
    assert any("Row 2 is units" in f["value"] for f in plain["found"])
    assert usable(plain)
    odd = guessed(f"{head}\nticks;N;Striche\n{body}", name="odd.csv")
    assert (odd["selection"]["units_row"], odd["selection"]["output_unit"]) == (2, "1")
    assert odd["selection"]["dt"] == 6  # a clock in an unknown unit
    assert usable(odd)


def test_a_force_in_grams_is_a_weight():
    found = guessed(renamed("Time (sec)", "Force (g)", "Distance (mm)"))
    assert found["selection"]["input_unit"] == "gf"
    heavy = guessed(renamed("Time (sec)", "Force (kg)", "Distance (mm)"), "--overwrite")
    assert heavy["selection"]["input_unit"] == "kgf"
    inside = guessed(renamed("t", "force_N_raw", "x_mm"), "--overwrite")
    assert inside["selection"]["input_unit"] == "N"


def specimens(name: str, values: list[str], restart: bool = True) -> str:
    rows = []
    for k, value in enumerate(values):
        for t, f, x, _ in ROWS:
            rows.append([value, f"{float(t) + (0 if restart else 606 * k):g}", f, x])
    return text(rows, (name, T, F, X))


def test_runs_are_sequences_and_specimens_get_a_fit_each():
    runs = guessed(specimens("run", ["1", "2", "3"]))["selection"]
    assert runs["group"] == ["run"]
    assert "each" not in runs
    each = guessed(specimens("specimen", ["a", "b"]), "--overwrite")["selection"]
    assert (each["each"], each["test_cycles"]) == ("specimen", 1)
    # One clock through all of them: nothing starts anew.
    assert "group" not in guessed(specimens("run", ["1", "2"], False), "--overwrite")["selection"]
    # A cycle's number is no sequence: its memory goes on.
    assert "group" not in guessed(CLEAN, "--overwrite")["selection"]


def test_two_runs_without_a_name_are_cut_where_time_goes_back():
    assert guessed(text([*ROWS, *ROWS]))["selection"]["segments"] == "auto"


def test_whole_sequences_of_middling_range_are_held_out():
    lines = ["trial,t (s),f (N),x (mm)"]
    for trial, depth in enumerate((4, 2, 3, 1, 2.5), 1):
        lines += [f"{trial},{k},{depth * u:.4f},{depth * u * u:.4f}" for k, u in enumerate(LOOP)]
    (held,) = guessed("\n".join(lines))["selection"]["test_where"]
    name, _, values = held.partition("=")
    assert name == "trial"
    assert "1" not in values.split(",")  # the widest stays, so no test is an extrapolation


def test_a_split_in_the_file_is_taken():
    rows = [[*row[:3], "test" if int(row[3]) > 4 else "train"] for row in ROWS]
    found = guessed(text(rows, (T, F, X, "split")))
    assert found["selection"]["test_where"] == ["split=test"]


WAY = np.interp(np.arange(240), np.arange(0, 241, 40), [0, 5, 0, 3, 0, 4, 0])
BENT = WAY + np.convolve(WAY, np.exp(-np.arange(20) / 6))[: len(WAY)] / 6


@pytest.mark.parametrize(("header", "y", "pair"), [
    # An area and a temperature are no readings beside one; alone with what they follow they are.
    ("t [s],voltage [kV],area strain [%]", BENT, ("voltage [kV]", "area strain [%]")),
    ("t_s,T_degC,strain_pct", BENT, ("T_degC", "strain_pct")),
    ("time (s),pH,swelling ratio", BENT, ("pH", "swelling ratio")),
    ("t (s),T (degC),heater on", (BENT.mean() < BENT) * 1.0, ("T (degC)", "heater on")),
    # Most of its readings lie within a hundredth of its range, and still it is not held.
    ("t,F (N),R (kOhm)", 500 / (1 + 30 * BENT), ("F (N)", "R (kOhm)")),
    ("drift (mm),load (kN)", BENT, ("drift (mm)", "load (kN)")),
    ("Zeit [s],Druck [kPa],Winkel [°]", BENT, ("Druck [kPa]", "Winkel [°]")),
    # It moves evenly, and the output would lag the other one.
    ("ch1,ch2", WAY + np.sign(np.gradient(WAY)), ("ch1", "ch2")),
])  # fmt: skip
def test_two_columns_that_follow_each_other_are_input_and_output(header, y, pair):
    t = [] if "load" in header or "ch1" in header else [np.arange(len(WAY)) * 0.1]
    rows = [",".join(f"{v:.6g}" for v in row) for row in zip(*t, WAY, y, strict=True)]
    found = guessed("\n".join([header, *rows]) + "\n")
    assert columns(found)[1:] == pair
    assert "hold" not in found["selection"]
    assert "output_unit" not in found["selection"]


def test_thousands_separators_are_told_and_not_missing_columns():
    points = [
        f"{k};{1000 * a:,.1f};{1000 * b:,.1f}"
        for k, (a, b) in enumerate(zip(WAY, BENT, strict=True))
    ]
    for separator in (".", "\u202f", "\u2019"):
        swapped = [row.translate(str.maketrans(",.", f"{separator},")) for row in points]
        refused(
            run("init", put("\n".join(["Zeit (s);Weg (µm);Kraft (mN)", *swapped]))),
            "thousands-separator",
        )


@pytest.mark.parametrize("mark", ["-9999", "999.00", "9.9E+37", "--"])
def test_marks_for_missing_readings_are_none_and_do_not_turn_the_pair(mark):
    pressed = 4 * np.where(np.gradient(WAY) > 0, WAY**1.5, WAY**2 / 2)
    force = [f"{x:.3f}" for x in pressed]
    for row in (40, 41, 95):  # one at a reversal of the displacement
        force[row] = mark
    lines = [f"{k / 10},{a:.3f},{f}" for k, (a, f) in enumerate(zip(WAY, force, strict=True))]
    found = guessed("\n".join(["t (s),x (mm),F (N)", *lines]))
    assert columns(found) == ("t (s)", "x (mm)", "F (N)")
    assert found["selection"]["na_values"] == [mark]
    assert found["selection"]["nan"] == "omit"
    # What is a reading in another column cannot be read as missing.
    other = [f"{line},{k}" for k, line in enumerate(lines, 900)]
    again = guessed("\n".join(["t (s),x (mm),F (N),count", *other]), "--overwrite")
    assert ("na_values" in again["selection"]) == (mark != "999.00")


def test_specimens_side_by_side_may_be_of_different_length():
    both = np.stack([0.1 * np.arange(240), WAY, BENT, 0.1 * np.arange(240), WAY, 2 * BENT], 1)
    rows = [[f"{x:.3f}" for x in row] for row in both]
    for row in rows[200:]:
        row[3:] = ["", "", ""]
    head = ["A,,,B,,", "t (s),x (mm),F (N),t (s),x (mm),F (N)"]
    found = guessed("\n".join([*head, *map(",".join, rows)]))
    assert usable(found)
    table = read_table("run.csv")
    record = read_csv(table, "x (mm)", "F (N)", "t (s)", group="block")
    assert len(table.line) == 440
    np.testing.assert_array_equal(rows_read(table, record), np.arange(440))
    only = read_csv(table, "x (mm)", "F (N)", "t (s)", where={"block": ["B"]})
    np.testing.assert_array_equal(rows_read(table, only), np.arange(240, 440))


def test_a_temperature_drives_where_nothing_else_does():
    lines = ["t (s),T (degC),strain (%),current (A)"]
    lines += [
        f"{k},{5 * a:.3f},{b:.4f},{0.3 + 0.01 * a:.2f}"
        for k, (a, b) in enumerate(zip(WAY, BENT, strict=True))
    ]
    assert columns(guessed("\n".join(lines)))[1:] == ("T (degC)", "strain (%)")


@pytest.mark.parametrize(
    ("name", "values"), [("current (A)", "0 0.5 1"), ("T (degC)", "20.4 40.1 60.2")]
)
def test_what_a_rig_held_in_each_run_is_a_condition(name, values):
    lines = [f"t (s),x (mm),F (N),{name}"]
    for value in values.split():
        lines += [
            f"{k},{a:.3f},{b * float(value):.4f},{value}"
            for k, (a, b) in enumerate(zip(WAY, BENT + 1, strict=True))
        ]
    assert guessed("\n".join(lines))["selection"]["condition"] == [name]
    # The weight on an actuator is one as well.
    muscle = [line.replace("F (N)", "p (bar)").replace(name, "load (kg)") for line in lines]
    assert guessed("\n".join(muscle), "--overwrite")["selection"]["condition"] == ["load (kg)"]
    # Two values tell no course between them.
    assert "condition" not in guessed("\n".join(lines[:481]), "--overwrite")["selection"]


def test_several_columns_that_change_are_named_where_none_is_an_input():
    rows = [f"{k},{np.sin(k):.4f},{np.cos(k):.4f}" for k in range(60)]
    said = run("init", put("\n".join(["time (s),force (N),humidity (%)", *rows])))
    fix = "--input COL --output COL"
    refused(said, "nothing says which column drives it", "'humidity (%)'", fix)


def test_a_modulus_over_time_answers_a_unit_step_and_is_no_pair_with_its_error():
    t = np.geomspace(0.01, 100, 60)
    rows = [[f"{a:.5g}", f"{2 + 3 * np.exp(-a):.6g}", f"{0.1 + np.exp(-a):.4g}"] for a in t]
    found = guessed(text(rows, ("t (s)", "E (MPa)", "sd (MPa)")))["selection"]
    assert (found["time"], found["output"], found["step"]) == ("t (s)", "E (MPa)", 1.0)


def test_creep_has_a_step():
    t = np.geomspace(0.01, 100, 60)
    strain = 0.1 + 0.05 * (1 - np.exp(-t))
    rows = [[f"{a:.5g}", f"{b:.6g}", "10"] for a, b in zip(t, strain, strict=True)]
    found = guessed(text(rows, ("t (s)", "strain", "stress (Pa)")))
    assert found["selection"] | {"time": "t (s)", "output": "strain"} == found["selection"]
    assert (found["selection"]["step"], found["selection"]["input_unit"]) == (10.0, "Pa")
    assert usable(found)
    rested = text([["0", "0", "0"], *rows], ("t (s)", "strain", "stress (Pa)"))
    loaded = guessed(rested, "--overwrite")
    assert columns(loaded) == ("t (s)", "stress (Pa)", "strain")
    assert loaded["selection"]["hold"] is True
    assert usable(loaded)
    alone = put(text([row[:2] for row in rows], ("t (s)", "strain")), "alone.csv")
    refused(run("init", alone), "'strain'", "--step VALUE", "[cannot-decide]")
    assert run("init", alone, "--step", "10").code == 0
    percent = [(*row[:2], f"{row[1]} %") for row in rows]
    words = put(text(percent, ("t (s)", "strain", "load")), "words.csv")
    refused(run("init", words), "Columns of text: 'load' ('", "[cannot-decide]")


BAD: dict[str, tuple[str | bytes, tuple[str, ...]]] = {
    "empty": ("", ("the file is empty",)),
    "header only": (f"{T},{F},{X}\n", ("a header and no rows",)),
    "a picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", ("binary data",)),
    "no header": ("0,1.5,2\n1,2.5,3\n2,3.5,5\n", ("first line contains numbers", "Write a line above")),
    "no header, twice a number": ("0,0\n1,2\n2,3\n", ("first line contains numbers",)),
    "one column": ("force (N)\n1\n2\n3\n", ("force (N)", "side by side")),
    "words": ("a,b\nx,y\nz,w\nu,v\n", ("none", "side by side")),
    "nothing moves": (f"{T},{F},{X}\n" + "".join(f"{k},1,2\n" for k in range(9)), ("side by side",)),
    "prose": ("Dear colleague,\nplease find the data\nin the other file.\n", ("[",)),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(name):
    content, words = BAD[name]
    refused(run("init", put(content)), "run.csv", *words)
    assert not Path("run.toml").exists()


@given(
    st.lists(st.sampled_from(["time", "force (N)", "x", "run", "s1", ""]), min_size=1, max_size=4),
    st.lists(
        st.lists(st.sampled_from(["1", "2.5", "-3e2", "0,5", "nan", "", "inf", "a"]), max_size=5),
        max_size=24,
    ),
    st.sampled_from(",;\t| "),
)
def test_any_table_gives_a_configuration_or_a_fault(header, rows, separator):
    lines = [separator.join(cells) for cells in (header, *rows)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "any.csv"
        file.write_text("\n".join(lines))
        done = run("init", file, "--json")
        assert done.code in (0, 2), done.err
        if done.code:
            return
        assert read_config(Path(done.json()["file"]))["selection"]


def pressed(x: np.ndarray, seed: int = 0, noise: float = 0.02) -> np.ndarray:
    """The force of a stiffening specimen with friction, with noise."""
    seat = np.zeros(len(x))
    for k in range(1, len(x)):
        seat[k] = np.clip(seat[k - 1], x[k] - 0.3, x[k] + 0.3)
    return x + 0.1 * x**2 + 0.4 * seat + noise * np.random.default_rng(seed).normal(size=len(x))


SMOOTH = 5 - 5 * np.cos(2 * np.pi * np.arange(400) / 100)
DEAD = np.maximum(pressed(SMOOTH - 4), 0.0) + 0.01 * np.random.default_rng(1).normal(size=400)
SINE = 2 * np.sin(np.arange(800) * np.pi / 50)
SOFTER = (3 - np.arange(800) / 2000) * SINE + np.clip(0.8 * np.gradient(SINE) / 0.02, -1.5, 1.5)
TORN = np.concatenate([np.linspace(0, 60, 280) ** 0.5, np.linspace(7.7, 2.0, 120)])


@pytest.mark.parametrize("force_first", [True, False])
@pytest.mark.parametrize(("x", "force"), [
    (SMOOTH, pressed(SMOOTH, noise=0.1)),  # read with less noise
    (SINE + 0.01 * np.random.default_rng(2).normal(size=800), SOFTER),  # moves as a sine
    (SMOOTH, DEAD),  # moves on while the force rests
    (np.cumsum(1.5 + np.sin(np.arange(400) / 9)), TORN),  # goes one way in a test to failure
])  # fmt: skip
def test_what_drives_is_weighed_where_no_rate_shows_it(x, force, force_first: bool):
    table = [force, x] if force_first else [x, force]
    names = (F, X) if force_first else (X, F)
    rows = [[f"{k / 10:g}", *(f"{c[k]:.6g}" for c in table)] for k in range(len(x))]
    assert columns(guessed(text(rows, (T, *names)))) == (T, X, F)


@pytest.mark.parametrize("digits", [5, 6, 8])
def test_a_copy_of_a_column_is_no_pair(digits: int):
    """The voltages from which force and displacement were made, and a stress made of the force."""
    force = pressed(SMOOTH, noise=0.1)
    made = (0.9 + force / 200, force, 2.5 + SMOOTH / 10, SMOOTH, force / 78.5)
    rows = [[f"{k / 10:g}", *(f"{c[k]:.{digits}g}" for c in made)] for k in range(len(SMOOTH))]
    names = (T, "force (V)", F, "displacement (V)", X, "stress (MPa)")
    assert columns(guessed(text(rows, names))) == (T, X, F)
    two = guessed(text([row[:3] for row in rows], names[:3]), "--step", "1", name="two.csv")
    assert "input" not in two["selection"]


@pytest.mark.parametrize("unit", ["mV", "mV/V"])
def test_weights_in_whole_tens_are_no_copy_of_what_a_load_cell_reads(unit: str):
    """A calibration: set values of few digits, and readings within half a per cent of a line."""
    load = np.concatenate([np.arange(0, 60, 10), np.arange(40, -10, -10)])
    read = 0.04 * load + 1e-5 * load**2 + 0.004 * np.sin(np.pi * load / 50) * (np.arange(11) > 5)
    rows = [[str(k), str(x), f"{y:.5f}"] for k in (1, 2) for x, y in zip(load, read, strict=True)]
    found = guessed(text([["", "N", unit], *rows], ("Run", "Load", "Reading")))
    assert columns(found) == (None, "Load", "Reading")
    assert found["selection"]["group"] == ["Run"]


def test_whole_numbers_at_which_the_clock_begins_again_are_specimens_of_a_relaxation():
    t = np.geomspace(0.1, 100, 20)
    rows = [[f"{c:.4g}", f"{(50 - 9 * k) * c**-0.1:.5g}", f"{20 + c % 0.3:.1f}", str(k)]
            for k in range(4) for c in t]  # fmt: skip
    found = guessed(text(rows, ("t (s)", "E_relax (MPa)", "T (degC)", "No")))
    assert found["selection"] | {"time": "t (s)", "each": "No", "step": 1.0} == found["selection"]
    assert "input" not in found["selection"]


T_S = np.arange(300) / 10
UP, SLOW = (np.sin(np.linspace(-np.pi / 2, 5.5 * np.pi, 300) - lag) for lag in (0, 0.4))
STRAINS, DECAY = np.repeat([1, 2, 4], 100), np.tile(2 + np.geomspace(1, 0.1, 100), 3)
ODD: dict[str, tuple[str, list[np.ndarray], dict[str, object], str]] = {
    "a load that is taken off is not held": (
        "t (s),z (mm),F (kN)", [T_S, UP + 1, np.where(UP > 0.6, UP**2, 0)],
        {"input": "z (mm)", "output": "F (kN)"}, ""),
    "a bath drives, and not a battery": (
        "t (s),T (Deg C),strain (um/m),U (V)", [T_S, UP, SLOW, 0.001 * (np.arange(300) * 7 % 11)],
        {"input": "T (Deg C)", "output": "strain (um/m)"}, "temperature, degC"),
    "a magnet is no voltage": (
        "t (s),Fz_N,Bz_uT", [T_S, UP, SLOW], {"input": "Fz_N", "output": "Bz_uT"}, "field, uT"),
    "humidity is no strain": (
        "t (s),chamber RH (%),probe RH (%)", [T_S, UP, SLOW],
        {"input": "chamber RH (%)"}, "unknown, percent; the names do not tell"),
    "a butterfly turns both ways": (
        "t (s),H (Oe),lambda (ppm)", [T_S, UP, (UP - 0.1 * np.sign(np.gradient(UP))) ** 2],
        {"input": "H (Oe)"}, "its parts turn both ways"),
    "a coarse clock keeps its unit": (
        "x-axis (msecond),I (A),U (V)", [np.arange(300) // 2 - 75.0, UP, SLOW],
        {"dt": 5e-4}, "median 0.0005 s"),
    "each strain of a relaxation": (
        "t (s),strain (%),stress (MPa)", [T_S % 10, STRAINS, STRAINS * DECAY],
        {"input": "strain (%)", "each": "strain (%)", "hold": True}, "one fit for each"),
    "tables beside one another": (
        "sheet,x (mm),F (N)", [np.arange(300) // 150, UP, SLOW], {"group": ["sheet"]}, ""),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_rigs_that_nobody_has_seen(name: str):
    header, series, wanted, words = ODD[name]
    rows = [",".join(f"{v:.6g}" for v in row) for row in zip(*series, strict=True)]
    said = run("init", put("\n".join([header, *rows]) + "\n")).out
    found = tomllib.loads(Path("run.toml").read_text("utf-8"))["selection"]
    assert found | wanted == found
    assert words in said
    assert f"{found['input']!r} --output {found['output']!r}" not in said


def test_readings_of_one_kind_are_other_choices_but_the_chosen_one():
    lines = ["t,skin 1 (pF),skin 2 (pF),skin 3 (pF),F (N)"]
    lines += [
        f"{t},{b:.4f},{b + a * a:.4f},{2 * b + a:.4f},{a:.4f}"
        for t, a, b in zip(T_S, UP, SLOW, strict=True)
    ]
    found = guessed("\n".join(lines))
    others = [one for one in found["alternatives"] if one.startswith("--input 'F (N)'")]
    assert len(others) == len(set(others)) == 2
    assert not any(repr(found["selection"]["output"]) in one for one in others)
