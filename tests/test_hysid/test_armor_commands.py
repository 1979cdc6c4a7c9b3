"""`hysid armor calibrate` and `solve`: a table and a fit of one's own, in any units, to contacts."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import hysid
import identify
from compensate import invert
from compensate.armor import Armor, Box, ContactSolver, Cover, WristSensor, planned_presses
from compensate.runtime import load
from hysteresis import LinearSponge
from hysteresis.internal import Units, conversion, with_units
from tests.test_hysid.command import Result, example, refused, run

BOX = Box(0.3, 0.25, 0.55, 0.1)
TOML = 'unit = "inch"\nbox = {dx = 11.811023622047244, dy = 9.84251968503937,'
TOML += " dz1 = 21.653543307086615, dz2 = 3.937007874015748}\nthickness = 2.0\n"
SPONGE = with_units(LinearSponge(1.298, 6.186, 1.5), Units("N", "mm"))
SAME = [("gf", "m", False), ("kgf", "inch", True)]


def fit_of(force: str, length: str, folder: Path, turned: bool = False) -> Path:
    """A saved fit of one curve, measured in these units, of the displacement or of the force."""
    if (place := folder / f"{force}-{length}-{turned}").exists():
        return place
    F = np.linspace(2.0, 20.0, 40)
    d = 1.298 * F + 6.186 + 0.01 * np.sin(7 * F)
    given = F / conversion(force, "N"), d / conversion(length, "mm")
    units = force, length
    if turned:
        given, units = given[::-1], units[::-1]
    names = {"input_unit": units[0], "output_unit": units[1]}
    fit = hysid.fit(*given, model="LinearSponge", noise="gaussian", starts=2, **names)
    return identify.save(fit, place)


def write(file: Path, header: list[str], rows: np.ndarray) -> Path:
    with file.open("w", newline="") as handle:
        csv.writer(handle).writerows([header, *rows.tolist()])
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("armor")
    (place / "box.toml").write_text(TOML)
    force = np.array([[0.0, 0, -3], [1, 2, -10], [0, -15, 1], [12, 0, 0], [0, 0, -19], [0, 0, -30]])
    moment = np.cross([0.02, 0.03, 0.3], force)
    header = ["time (s)", "Fx (lbf)", "Fy (lbf)", "Fz (lbf)", "Mx (N mm)", "My (N mm)", "Mz (N mm)"]
    table = [np.arange(6.0), *(force / conversion("lbf", "N")).T, *(1e3 * moment).T]
    write(place / "wrenches.csv", header, np.column_stack(table))
    return place


def solved(file: Path, out: Path, *how: object) -> Result:
    return run(
        "armor", "solve", file, "--out", out, *how, *(["--json"] if out.name != "none" else [])
    )


def contacts(out: Path) -> list[dict[str, str]]:
    with (out / "contacts.csv").open() as handle:
        return list(csv.DictReader(handle))


@pytest.mark.parametrize(("force", "length", "turned"), SAME)
def test_one_table_in_any_units_gives_the_same_contacts(folder, force, length, turned):
    """Of a fit of the displacement; and of one of the force, which is inverted."""
    model = identify.load(fit_of("N", "mm", folder, turned)).model
    wanted = ContactSolver(BOX, invert(model) if turned else model)
    with (folder / "wrenches.csv").open() as handle:
        rows = np.array(list(csv.reader(handle))[1:], float)
    F, M = rows[:, 1:4] * conversion("lbf", "N"), rows[:, 4:] / 1e3
    truth = np.asarray(wanted.solve(F, M).point)
    out = folder / f"solved-{force}-{length}"
    sponge = fit_of(force, length, folder, turned)
    found = solved(
        folder / "wrenches.csv", out, "--sponge", sponge, "--shape", folder / "box.toml"
    ).json()
    assert found["statuses"] == {"OK": 5, "EXTRAPOLATED": 1}  # 30 N, and the fit knows 20
    point = np.array([[float(row[f"{k} (m)"]) for k in "xyz"] for row in contacts(out)])
    np.testing.assert_allclose(point, truth, atol=1e-9)
    variance = np.array([float(row["zz (m^2)"]) for row in contacts(out)])
    assert (variance[2:4] > 0).all()  # on the sides; on the top z is as certain as the sponge
    runtime = load(out / "armor.json")
    same = [runtime.step(1.0, reading).point for reading in np.hstack([F, M]).tolist()]
    np.testing.assert_allclose(same, truth, atol=1e-9)
    assert json.loads((out / "touches.json").read_text())["status"][-1] == "EXTRAPOLATED"
    assert Path(run("armor", "view", out, "--json").json()["file"]).is_file()


def test_the_weight_of_the_shell_is_taken_off_where_it_moves(folder: Path):
    """The sensor carries 1.5 kg and is turned: contacts are those of the load alone, in a stream too."""
    (folder / "heavy.toml").write_text(TOML + "mass = 1.5\ncentre = [0, 0, 10]\n")
    force = np.array([[0.0, 0, -8], [6, 0, -9], [0, -12, 1]])
    moment = np.cross([0.02, 0.03, 0.3], force)
    pull = 9.80665 * np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]])
    centre = [0, 0, 10 * conversion("inch", "m")]
    readings = [force + 1.5 * pull, moment + np.cross(centre, 1.5 * pull)]
    header = ["time (s)", "Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    moving = [*header, "gx (m/s^2)", "gy (m/s^2)", "gz (m/s^2)"]
    rows = np.column_stack([np.arange(3.0), *readings, pull])
    still = np.column_stack([np.arange(3.0), force, moment])
    tables = write(folder / "heavy.csv", moving, rows), write(folder / "light.csv", header, still)
    shapes, sponge = (folder / "heavy.toml", folder / "box.toml"), fit_of("N", "mm", folder)
    found = []
    for stream in (False, True):
        for table, shape in zip(tables, shapes, strict=True):
            out = folder / f"{table.stem}-{stream}"
            how = ("--sponge", sponge, "--shape", shape, *(["--stream"] if stream else []))
            assert solved(table, out, *how).code == 0
            found.append([[float(row[f"{k} (m)"]) for k in "xyz"] for row in contacts(out)])
    for heavy, light in (found[:2], found[2:]):
        np.testing.assert_allclose(heavy, light, atol=1e-9)


@pytest.mark.thorough
def test_a_calibration_is_kept_and_used(folder: Path, monkeypatch: pytest.MonkeyPatch):
    random = np.random.default_rng(5)
    matrix = np.eye(6) + 0.02 * random.normal(size=(6, 6)) * np.kron(
        [[1, 4], [0.25, 1]], np.ones((3, 3))
    )
    true = Armor(WristSensor(matrix=matrix), ContactSolver(BOX, Cover(SPONGE, factor=0.95)))
    surface = np.tile(np.arange(1, 6), 3)
    inward = np.asarray(BOX.faces().normal)[surface - 1]
    aside = random.uniform(-0.1, 0.1, (15, 3))
    touched = np.asarray(BOX.centres())[surface - 1]
    touched += aside - (aside * inward).sum(1, keepdims=True) * inward
    load = np.tile([5.0, 10.0, 15.0], (15, 1))
    made = planned_presses(true, np.arange(3.0), load, inward, touched, surface)
    rows = [
        [p, k, *made.readings[p, k].tolist(), load[p, k] / 9.80665, *(100 * touched[p]),
         1e3 * float(made.displacement[p, k])]
        for p in range(15) for k in range(3)
    ]  # fmt: skip
    header = ["press", "time (s)", "Fx", "Fy", "Fz", "Mx", "My", "Mz", "force (kgf)"]
    header += ["x (cm)", "y (cm)", "z (cm)", "displacement (mm)"]
    presses = write(folder / "presses.csv", header, np.array(rows))
    sponge = fit_of("N", "mm", folder)
    monkeypatch.chdir(folder)
    shutil.copytree(sponge, folder / "sponge")
    found = run(*example("armor calibrate"), "--json").json()  # the one of its help, which runs
    out = folder / "armor"
    assert found["presses"] == 15
    assert "solver.cover.factor.value" in found["table"]
    reading = np.asarray(made.readings)[:, 1]
    wrenches = write(folder / "read.csv", ["Fx", "Fy", "Fz", "Mx", "My", "Mz"], reading)
    done = solved(wrenches, folder / "solved", "--armor", out).json()
    point = np.array(
        [[float(row[f"{k} (m)"]) for k in "xyz"] for row in contacts(folder / "solved")]
    )
    truth = np.asarray(true.solve(reading).point)
    # Without noise the presses leave only the priors' pull, a hundredth of 2 % of crosstalk.
    np.testing.assert_allclose(point, truth, atol=5e-4)
    assert done["runtime"] is not None
    assert run(*example("armor solve")).code == 0
    assert run(*example("armor view")).code == 0
    again = ("--sponge", sponge, "--shape", folder / "box.toml", "--out", out)
    refused(run("armor", "calibrate", presses, *again), "[would-overwrite]")


def test_what_cannot_be_used_is_answered(folder: Path):
    sponge, shape = fit_of("N", "mm", folder), folder / "box.toml"
    bad = write(folder / "bad.csv", ["Fx (mm)", "Fy", "Fz", "Mx", "My", "Mz"], np.ones((2, 6)))
    short = write(folder / "short.csv", ["Fx", "Fy", "Fz", "Mx", "My"], np.ones((2, 5)))
    (folder / "wrong.toml").write_text("box = {dx = 0.3}\n")
    (folder / "other.toml").write_text("lenght = 3\n")
    for file, fit, told, code in (
        (bad, sponge, shape, "wrong-unit"),
        (short, sponge, shape, "no-column"),
        (bad, sponge, folder / "wrong.toml", "bad-config"),
        (bad, sponge, folder / "other.toml", "unknown-key"),
        (bad, None, shape, "conflicting-options"),
    ):
        how = (*(["--sponge", fit] if fit else []), "--shape", told)
        refused(solved(file, folder / "none", *how)._replace(out=""), f"[{code}]")


def test_a_table_as_loggers_write_it_is_read_and_replayed(folder: Path):
    """Decimal commas, an overload, a clock that goes back, and a sensor that reports the reaction."""
    with (folder / "wrenches.csv").open() as handle:
        header, *rows = csv.reader(handle)
    table = -np.array(rows, float)
    rows = [[f"{x:.6f}".replace(".", ",") for x in row] for row in table]
    rows[1][1] = "OVLD"
    file, out = folder / "logged.csv", folder / "logged"
    file.write_text("\n".join(";".join(row) for row in [header, *rows]))
    how = ("--sponge", fit_of("gf", "m", folder), "--shape", folder / "box.toml")
    notes = solved(file, out, *how).json()["notes"]
    for note, words in zip(notes, ("decimal comma", "(OVLD)", "3 of 5 loads"), strict=False):
        assert words in note
    assert run("armor", "view", out).code == 0
    refused(solved(file, folder / "none", *how, "--stream"), "[no-time]")


@pytest.mark.parametrize(("force", "far", "word"), [(-5.0, 0.0, "gauge"), (5.0, 0.1, "moves")])
def test_presses_that_tell_nothing_are_refused(folder: Path, force: float, far: float, word: str):
    """A gauge of the wrong sign; presses without a column that numbers them."""
    header = ["Fx", "Fy", "Fz", "Mx", "My", "Mz", "force", "x", "y", "z"]
    rows = np.array([[0, 0, -5, 0, 0, 0, force, x, 0, 0.55] for x in (0.0, far)])
    how = ("--sponge", fit_of("N", "mm", folder), "--shape", folder / "box.toml")
    made = write(folder / f"{word}.csv", header, rows)
    said = run("armor", "calibrate", made, *how, "--out", folder / "none")
    refused(said, "[bad-presses]")
    assert word in said.err
    for k in (0, 7):  # a load, and a place, of which the first row counts
        gap = np.where((np.arange(10) == k) & (np.arange(2)[:, None] == 1), np.nan, rows)
        made = write(folder / f"{word}-gap.csv", header, gap)
        said = run("armor", "calibrate", made, *how, "--out", folder / "none")
        refused(said, "line 3", f"{header[k]!r} has no number there", "[no-value]")
