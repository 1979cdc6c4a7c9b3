"""Armor on the command line: contacts in any units, errors in presses not seen, and its page."""

import json
import re
import shutil
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

import hysid
import identify
from compensate import invert
from compensate.armor import Armor, Box, ContactSolver, Cover, Presses, WristSensor, planned_presses
from compensate.internal import PressResiduals, missed_of, with_slip, without_each
from compensate.runtime import load
from hysid.armor._calibration import spread_of_unseen
from hysid.armor._touches import read_touches, save_touches, shell_of
from hysteresis import LinearSponge
from hysteresis.internal import Units, conversion, force_path, with_units
from hysteresis.rigs import INWARD, ArmorRig
from identify.internal import calibrate
from tests.test_hysid.command import Result, example, put, read, refused, run, text
from tests.test_hysid.test_reporting.test_report import Page
from tests.thorough import rest_thorough

BOX = Box(0.3, 0.25, 0.55, 0.1)
TOML = 'unit = "inch"\nbox = {dx = 11.811023622047244, dy = 9.84251968503937,'
TOML += " dz1 = 21.653543307086615, dz2 = 3.937007874015748}\nthickness = 2.0\n"
SPONGE = with_units(LinearSponge(1.298, 6.186, 1.5), Units("N", "mm"))
SAME = rest_thorough([("kgf", "inch", True), ("gf", "m", False)], 1)


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
    return put(text(rows, header), file)


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


def points(out: Path) -> np.ndarray:
    """Of the contacts, (rows, 3) in metres."""
    return np.array([[float(row[f"{k} (m)"]) for k in "xyz"] for row in read(out / "contacts.csv")])


@pytest.mark.parametrize(("force", "length", "turned"), SAME)
def test_one_table_in_any_units_gives_the_same_contacts(folder, force, length, turned):
    """Of a fit of the displacement; and of one of the force, which is inverted."""
    model = identify.load(fit_of("N", "mm", folder, turned)).model
    wanted = ContactSolver(BOX, invert(model) if turned else model)
    rows = np.array([list(row.values()) for row in read(folder / "wrenches.csv")], float)
    F, M = rows[:, 1:4] * conversion("lbf", "N"), rows[:, 4:] / 1e3
    truth = np.asarray(wanted.solve(F, M).point)
    out = folder / f"solved-{force}-{length}"
    sponge = fit_of(force, length, folder, turned)
    found = solved(
        folder / "wrenches.csv", out, "--sponge", sponge, "--shape", folder / "box.toml"
    ).json()
    assert found["statuses"] == {"OK": 5, "EXTRAPOLATED": 1}  # 30 N, and the fit knows 20
    np.testing.assert_allclose(points(out), truth, atol=1e-9)
    variance = np.array([float(row["zz (m^2)"]) for row in read(out / "contacts.csv")])
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
            found.append(points(out))
    for heavy, light in (found[:2], found[2:]):
        np.testing.assert_allclose(heavy, light, atol=1e-9)


@pytest.mark.thorough
def test_a_calibration_is_kept_and_used(folder: Path, monkeypatch: pytest.MonkeyPatch):
    random = np.random.default_rng(5)
    crosstalk = random.normal(size=(6, 6)) * np.kron([[1, 4], [0.25, 1]], np.ones((3, 3)))
    matrix = np.eye(6) + 0.02 * crosstalk
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
    truth = np.asarray(true.solve(reading).point)
    # Without noise the presses leave only the priors' pull, a hundredth of 2 % of crosstalk.
    np.testing.assert_allclose(points(folder / "solved"), truth, atol=5e-4)
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
    (folder / "side.toml").write_text("box = {dx = 0.3, dy = 0.3, dz1 = 0.5, dz_2 = 0.1}\n")
    (folder / "twice.toml").write_text(TOML + 'mesh = "shell.stl"\n')
    (folder / "light.toml").write_text(TOML + "mass = -1.5\n")
    six = ["fx (lbf)", "Fy", "Fz", "Mx", "My", "Mz"]
    twice = write(folder / "twice.csv", ["Fx (N)", *six], np.ones((2, 7)))
    for file, fit, told, code in (
        (bad, sponge, folder / "side.toml", "unknown-key"),
        (bad, sponge, folder / "twice.toml", "bad-config"),
        (bad, sponge, folder / "light.toml", "bad-config"),
        (twice, sponge, shape, "given-twice"),
        (bad, sponge, shape, "wrong-unit"),
        (short, sponge, shape, "no-column"),
        (bad, sponge, folder / "wrong.toml", "bad-config"),
        (bad, sponge, folder / "other.toml", "unknown-key"),
        (bad, None, shape, "conflicting-options"),
    ):
        how = (*(["--sponge", fit] if fit else []), "--shape", told)
        refused(solved(file, folder / "none", *how)._replace(out=""), f"[{code}]")


def test_columns_of_like_names_do_not_count(folder: Path):
    """Contacts do not depend on a raw channel that stands before the force, or behind it."""
    rows = read(folder / "wrenches.csv")
    table = np.array([list(row.values()) for row in rows], float)
    raw = np.column_stack([9 * table[:, 1], table])
    more = write(folder / "more.csv", ["Fx_raw (lbf)", *rows[0]], raw)
    how = ("--sponge", fit_of("N", "mm", folder), "--shape", folder / "box.toml")
    found = []
    for file in (more, folder / "wrenches.csv"):
        assert solved(file, folder / f"like-{file.stem}", *how).code == 0
        found.append(read(folder / f"like-{file.stem}" / "contacts.csv"))
    assert found[0] == found[1]


def test_the_armor_of_a_calibration_is_not_written_over(folder: Path):
    (folder / "calibrated").mkdir()
    (folder / "calibrated" / "armor.json").write_text("kept")
    how = ("--sponge", fit_of("N", "mm", folder), "--shape", folder / "box.toml")
    said = run("armor", "solve", folder / "wrenches.csv", *how, "--out", folder / "calibrated")
    refused(said, "[would-overwrite]")
    assert (folder / "calibrated" / "armor.json").read_text() == "kept"


def test_a_table_as_loggers_write_it_is_read_and_replayed(folder: Path):
    """Decimal commas, an overload, a clock that goes back, and a sensor that reports the reaction."""
    table = read(folder / "wrenches.csv")
    rows = [[f"{-float(x):.6f}".replace(".", ",") for x in row.values()] for row in table]
    rows[1][1] = "OVLD"
    clock = next(k for k, name in enumerate(table[0]) if name.startswith("time"))
    rows[0][clock] = "-99,0"  # it does not fall all along
    file, out = put(text(rows, table[0], ";"), folder / "logged.csv"), folder / "logged"
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
    back = write(folder / f"{word}-back.csv", [*header, "time"], np.c_[abs(rows[[0, 0]]), [2, 1]])
    refused(run("armor", "calibrate", back, *how, "--out", folder / "none"), "time goes back")
    for k in (0, 7):  # a load, and a place, of which the first row counts
        gap = np.where((np.arange(10) == k) & (np.arange(2)[:, None] == 1), np.nan, rows)
        made = write(folder / f"{word}-gap.csv", header, gap)
        said = run("armor", "calibrate", made, *how, "--out", folder / "none")
        refused(said, "line 3", f"{header[k]!r} has no number there", "[no-value]")


SQUARE = Box(0.3, 0.3, 0.55)
ARMOR = Armor(WristSensor(), ContactSolver(SQUARE, LinearSponge(K=1.3, b=2.0, threshold=0.5)))
FREE = {"sensor.matrix": 0.03}
STUDENT_4 = 2.131847 / 1.644854


def pressed() -> Presses:
    """Four middles of sides, read by a sensor with crosstalk and noise."""
    random, surface = np.random.default_rng(3), np.arange(1, 5)
    force = np.tile([4.0, 12.0, 8.0], (4, 1))
    touched, normal = np.asarray(SQUARE.centres())[:4], INWARD[:4]
    depth = 1e-3 * (1.3 * force + 2.0)
    at = touched[:, None] + depth[..., None] * normal[:, None]
    pushed = force[..., None] * normal[:, None]
    load = np.concatenate([pushed, np.cross(at, pushed)], axis=-1)
    read = load @ (np.eye(6) + 0.02 * random.normal(size=(6, 6))).T
    read += random.normal(size=read.shape) * np.repeat([0.03, 0.006], 3)
    return Presses(np.arange(1.0, 4.0), read, force, normal, touched, surface)


def without(presses: Presses, k: int) -> Presses:
    return jax.tree.map(lambda x: np.delete(x, k, axis=0), presses)


def test_they_are_those_of_calibrations_without_a_press():
    presses = pressed()
    residuals = PressResiduals(presses, jnp.repeat(jnp.array([0.03, 0.006]), 3))
    found = spread_of_unseen(calibrate(ARMOR, residuals, FREE), residuals, [])
    squares = []
    for k in range(4):
        others = PressResiduals(without(presses, k), residuals.noise)
        one = calibrate(ARMOR, others, FREE).system
        missed = missed_of(one, jax.tree.map(lambda x, k=k: x[k], presses))
        squares.append(np.mean(np.asarray(missed.wrench) ** 2, axis=0))
    wanted = STUDENT_4 * np.sqrt(np.mean(squares, axis=0))
    # The residuals are linear in the matrix; the search ends within 1e-8.
    np.testing.assert_allclose(found.noise, wanted, rtol=1e-5)
    assert found.depth is None
    assert (found.noise > np.repeat([0.03, 0.006], 3)).any()


def test_slip_without_a_press_is_found_from_the_others():
    presses, full = pressed(), np.repeat([50.0, 12.0], 3)
    found = without_each(ARMOR, presses, full)[2].sensor
    wanted = with_slip(ARMOR, without(presses, 2), full).sensor
    np.testing.assert_allclose(found.matrix, wanted.matrix, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.slip.weights, wanted.slip.weights, atol=1e-10)


TITLE = 'Presses </script> & "quotes"'
COVARIANCE = np.diag([4e-6, 1e-6, 0.0])


@pytest.fixture
def kept_in(tmp_path: Path) -> Path:
    """Two presses, with rows before the threshold and after."""
    rig = ArmorRig(seed=100)
    points, surface = rig.random_points(2)
    made = rig.press(points, surface, force_path((0.0, 15.0, 0.0), 2.5))
    F, M = np.split(made.wrench.reshape(-1, 6), 2, axis=1)
    solver = ContactSolver(Box(*rig.size), LinearSponge(K=1.3, b=6.2, threshold=1.5))
    save_touches(
        tmp_path, shell_of(solver.shape), np.arange(len(F)) / 10, F, M, solver.solve(F, M),
        title=TITLE, covariance=np.tile(COVARIANCE, (len(F), 1, 1)),
    )  # fmt: skip
    return tmp_path


def held(page: str) -> dict:
    """The record inside the page."""
    found = re.search(r'<script id="record" type="application/json">(.*?)</script>', page, re.S)
    return json.loads(found[1])


def test_page_holds_its_record_and_needs_nothing_else(kept_in):
    result = run("armor", "view", kept_in, "--json").json()
    assert result == {"file": str(kept_in / "armor.html"), "rows": 24}
    page = Page(kept_in / "armor.html")
    record, kept = held(page.html), read_touches(kept_in)
    for name in ("time", "force", "point", "status", "triangles", "title"):
        assert record[name] == kept[name]
    assert "covariance" not in record
    assert not re.search(r"https?:|url\(|@import|fetch\(|XMLHttpRequest", page.html)
    assert not any("src" in attributes or "href" in attributes for _, attributes in page.tags)
    assert {"OK", "BELOW_THRESHOLD"} <= set(record["status"])
    assert set(record["status"]) <= set(record["meanings"])


def test_half_axes_hold_ninety_per_cent(kept_in):
    """Longest first, sqrt(chi2) of the standard deviations, along the covariance's own directions."""
    assert run("armor", "view", kept_in).code == 0
    record = held((kept_in / "armor.html").read_text("utf-8"))
    reach = np.sqrt(scipy.stats.chi2.ppf(0.9, 3))
    axes = np.abs(record["axes"][0])
    np.testing.assert_allclose(axes, np.diag(reach * np.array([2e-3, 1e-3, 0])), atol=1e-7)


@pytest.mark.parametrize(("change", "words"), [
    (lambda d: d.update(schema=2), "schema"),
    (lambda d: d.pop("force"), "force"),
    (lambda d: d.update(time=[]), "rows"),
    (lambda d: d.update(time=d["time"][::-1]), "time"),
    (lambda d: d["status"].pop(), "status"),
    (lambda d: d.update(triangles=[[0, 1, 99]]), "corner"),
    (lambda d: d.update(moment=[[1, 2]] * len(d["time"])), "moment"),
    (lambda d: d.update(surface=["<b>"] * len(d["time"])), "surface"),
    (lambda d: d.update(extra="<script>"), "extra"),
])  # fmt: skip
def test_damaged_records_are_refused(kept_in, change, words):
    file = kept_in / "touches.json"
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(document))
    refused(run("armor", "view", kept_in), words, "[damaged-file]")
    assert not (kept_in / "armor.html").exists()


def test_no_record_is_said(tmp_path):
    refused(run("armor", "view", tmp_path), "[file-not-found]", "touches.json")
    (tmp_path / "touches.json").write_text("{")
    refused(run("armor", "view", tmp_path), "[damaged-file]")
