"""The studio without a browser: names, configuration, brushing, commands, lines of code."""

import io
import json
import shlex
import shutil
import threading
import time
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hysid
import identify
from hysid.intake._selection import Selection
from hysteresis import InputError
from tests.refusals import raises, refuses
from tests.test_hysid.command import COLUMNS, SPONGE, refused, run, takes
from tests.test_hysid.test_studio.served import ask, entering, studio_of


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Any]:
    shutil.copy(SPONGE, tmp_path / "run.csv")
    with studio_of(tmp_path) as found:
        yield found


@pytest.mark.parametrize(("name", "code"), [
    *((name, "outside-folder") for name in ("../x", "/etc/passwd", "a/../../x", "", ".", ".hidden")),
    *((name, "outside-folder") for name in ("a\0b", "link", "\ud800", "a" * 300 + ".csv")),
    ("loop", "file-not-found"),
])  # fmt: skip
def test_names_do_not_lead_out_of_the_folder(tmp_path: Path, name: str, code: str):
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "link").symlink_to(tmp_path)
    (inner / "loop").symlink_to(inner / "loop")
    with studio_of(inner) as studio, raises(code):
        studio.look(name)


def test_a_part_of_a_large_file_is_shown_while_the_rest_is_read(tmp_path, monkeypatch):
    t = np.arange(30_000.0)
    columns = np.column_stack([t, 5 + 5 * np.sin(t / 30), 10 + 9 * np.sin(t / 30 - 0.1)])
    header = "time (s),force (N),displacement (mm)"
    np.savetxt(tmp_path / "run.csv", columns, "%.3f", ",", header=header, comments="")
    goes_on, read = threading.Event(), Selection.read

    def slowly(selection: Selection, file: Path):
        goes_on.wait()
        return read(selection, file)

    monkeypatch.setattr("hysid.studio._measurement.LARGE", 100_000)
    monkeypatch.setattr(Selection, "read", slowly)
    with studio_of(tmp_path) as studio:
        one = studio.measurement("run.csv")
        one.configured()
        series, is_whole, axes = one.series()
        assert not is_whole
        assert len(series.x) < len(t)
        assert axes["u"] == "force (N)"
        goes_on.set()
        assert one.brush("exclude", 0.0, 60.0, None)["exclude_lines"] == ["2-62"]  # of all rows
        series, is_whole, _ = one.series()
        assert is_whole
        assert len(series.x) == len(t)


@pytest.mark.parametrize(
    "name",
    ["../../up.csv", "C:\\x\\up.csv", "a\nb.csv", "-o.csv", "", "...", 500 * "x", 200 * "\u4e00"],
)
def test_uploads_get_a_free_name_in_the_folder(studio, tmp_path: Path, name: str):
    folder = studio.folder
    with folder.new_file(name) as first, folder.new_file(name) as second:
        first.write_text("1")
    assert first.parent == second.parent == tmp_path
    assert first != second
    assert not first.name.startswith(".")


def test_a_configuration_is_the_one_of_init_and_changes_leave_the_rest_alone(studio, tmp_path):
    look, config = studio.look("run.csv"), tmp_path / "run.toml"
    other = tmp_path / "other.toml"
    assert run("init", tmp_path / "run.csv", "--out", other).code == 0
    assert config.read_text() == other.read_text()
    assert look["selection"]["input"] == "force (N)"
    config.write_text(config.read_text() + "# mine\n[parameters]\nE1 = {start = 2.0}\n")
    changes = {"selection": {"test_cycles": 2, "time": None}, "fit": {"purpose": "constants"}}
    studio.change("run.csv", changes)
    text = config.read_text()
    assert "# mine" in text
    assert "E1 = {start = 2.0}" in text
    tables = tomllib.loads(text)
    columns = {"input": "force (N)", "output": "displacement (mm)"}
    assert tables["selection"] == columns | {"test_cycles": 2}
    assert tables["fit"]["purpose"] == "constants"


def test_a_broken_configuration_is_told_and_kept(studio, tmp_path):
    (tmp_path / "run.toml").write_text("[selection\n")
    assert studio.look("run.csv")["fault"]["code"] == "bad-config"
    assert (tmp_path / "run.toml").read_text() == "[selection\n"
    columns = 'input = "nope"\noutput = "displacement (mm)"\n'
    (tmp_path / "run.toml").write_text(f"[selection]\n{columns}")
    assert studio.look("run.csv")["columns"]
    assert studio.measurement("run.csv").judged()["fault"]["code"] == "no-column"
    columns = 'input = "force (N)"\noutput = "displacement (mm)"'
    (tmp_path / "run.toml").write_text(f"[selection]\n{columns}\nrange = [1]\n")
    assert "range = [1] is not LOW,HIGH" in studio.look("run.csv")["fault"]["message"]
    refuses("bad-config", lambda: studio.change("run.csv", {"fit": {"tau": "x"}}))


def test_brushing_writes_lines_that_the_command_line_reads(studio, tmp_path):
    one = studio.measurement("run.csv")
    one.configured()
    studio.change("run.csv", {"selection": one.brush("exclude", 60.0, 120.0, None)})
    held_out = one.brush("hold-out", 400.0, None, [5.0, 30.0, -1.0, 99.0])
    studio.change("run.csv", {"selection": held_out})
    selection = tomllib.loads(one.config.read_text("utf-8"))["selection"]
    ((train, test),) = hysid.records(one.file, **selection).values()
    t, u = train.time, train.input
    left_out, held = (t >= 60) & (t <= 120), (t >= 400) & (u >= 5)
    np.testing.assert_array_equal(test.mask, held)
    np.testing.assert_array_equal(train.mask, ~left_out & ~held)
    assert "test_cycles" not in selection
    shown = one.series()[0].state % 8
    np.testing.assert_array_equal(shown, np.where(left_out, 1, np.where(held, 2, 0)))
    studio.change("run.csv", {"selection": one.brush("include", None, None, None)})
    again = tomllib.loads(one.config.read_text("utf-8"))["selection"]
    assert not again.keys() & {"exclude_lines", "test_lines"}


def test_python_lines_make_the_records_and_the_fit_of_the_commands(studio, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    one = studio.measurement("run.csv")
    one.configured()
    changes = {"fit": {"model": "LinearSponge", "noise": "gaussian"}}
    studio.change("run.csv", {"selection": {"exclude_lines": ["2-9"]}, **changes})
    told = studio.look("run.csv")["equivalents"]
    space: dict = {}
    exec(told["fit"]["python"], space)
    by_command = ("--config", one.config, "--out", tmp_path / "by-command", "--json")
    document = run("fit", one.file, *by_command).json()
    made = json.loads((tmp_path / "run" / "fit.json").read_text())
    assert made["parameters"] == document["parameters"]
    assert made["metrics"] == document["metrics"]
    train = space["train"]
    counted = (train.cycle > 0) & (train.cycle <= 4) & (train.line > 9)
    np.testing.assert_array_equal(train.mask, counted)
    for step in ("compensator", "export"):
        exec(told[step]["python"], {})
    shutil.copy(tmp_path / "run.csv", tmp_path / "NEW.csv")
    said = [one["command"] for one in studio.look("run.csv")["equivalents"].values()]
    lines = [line for line in "\n".join(said).split("\n") if not line.startswith("#")]
    assert len(lines) == 7
    for words in (shlex.split(line)[1:] for line in lines):
        if words[0] in ("sample", "report"):  # for seconds; others run them
            takes(words[0], words[1:])
        else:
            assert run(*words).code == 0, words
    assert studio.look("run.csv")["result"]["exports"] == ["run/compensator.json", "run/run.h"]
    shutil.copytree(tmp_path / "by-command", tmp_path / "run", dirs_exist_ok=True)
    assert not studio.look("run.csv")["result"]["stale"]
    studio.change("run.csv", {"selection": {"test_cycles": 2}})
    assert studio.look("run.csv")["result"]["stale"]
    loaded, curves = identify.load(tmp_path / "run"), studio.fits.curves(tmp_path / "run")
    assert curves["candidates"] == []  # one model was tried
    assert [one["word"] for one in curves["baselines"]] == [b.name for b in loaded.baselines]
    for drawn, one in zip(curves["baselines"], loaded.baselines, strict=True):
        assert drawn["rms"] == pytest.approx(one.metrics["train"].rmse, rel=1e-4)
    slopes = {one["name"]: one["value"] for one in curves["sliders"]}
    steeper = [{"K": k * slopes["K"]} for k in (1.0, 1.5)]
    same, moved = (studio.fits.redrawn(tmp_path / "run", change, {}) for change in steeper)
    assert same["rms"] == pytest.approx(curves["records"][-1]["rms"])
    assert moved["rms"] > same["rms"]


@pytest.mark.parametrize("asked", [
    {"test_where": ["cycle=5"]},
    {"test_where": ["cycle=1,2,3,4"], "group": ["cycle"]},
    {"each": "cycle", "where": ["cycle=2,3"], "test_tail": 0.3},
    {"test_cycles": 1, "branch": "loading", "range": [2.0, 40.0]},
    {"test_cycles": 1, "turn": ["displacement (mm)"]},
])  # fmt: skip
def test_python_lines_hold_out_what_the_command_holds_out(studio, tmp_path, monkeypatch, asked):
    monkeypatch.chdir(tmp_path)
    studio.change("run.csv", {"selection": {"test_cycles": None} | asked})
    told = studio.look("run.csv")["equivalents"]
    lines = told["data"]["python"]
    space: dict = {}
    exec(lines, space)
    selection = tomllib.loads((tmp_path / "run.toml").read_text("utf-8"))["selection"]
    *_, (train, test) = hysid.records(tmp_path / "run.csv", **selection).values()
    for ours, commands in ((space["train"], train), (space["test"], test)):
        np.testing.assert_array_equal(ours.line[ours.mask], commands.line[commands.mask])
        np.testing.assert_array_equal(ours.starts, commands.starts)
        np.testing.assert_array_equal(ours.output, commands.output)
    compile(told["fit"]["python"], "fit", "exec")


def test_warnings_name_the_lines_that_they_mean(tmp_path):
    t = np.arange(400) / 10
    force = 10 * np.abs(np.sin(t))
    shown = np.minimum(2 * force + 0.3 * np.sin(3 * t), 15.0)
    rows = zip(t, force, shown, strict=True)
    text = "time (s),force (N),x (mm)\n" + "".join(f"{a:.2f},{b:.4f},{c:.4f}\n" for a, b, c in rows)
    (tmp_path / "clipped.csv").write_text(text)
    with studio_of(tmp_path) as studio:
        one = studio.measurement("clipped.csv")
    one.configured()
    found = {warning["code"]: warning for warning in one.judged()["warnings"]}
    first, last = map(int, found["saturation"]["lines"][0].split("-"))
    assert (shown[first - 2 : last - 1] == 15.0).all()
    assert "saturation" in run("check", one.file, "--config", one.config, "--json").out


def test_a_command_is_cancelled_and_another_one_about_the_file_waits(studio, tmp_path, monkeypatch):
    monkeypatch.setattr("hysid.studio._processes.PATIENCE", 0.2)
    (tmp_path / "json.py").write_text("raise SystemExit('code of the folder was run')")
    jobs = studio.jobs
    job = jobs.start("fit", "run.csv", ["fit", "run.csv", *COLUMNS])
    refuses("would-overwrite", lambda: jobs.start("fit", "run.csv", ["fit", "run.csv"]))
    jobs.cancel(job.number)
    for _ in range(100):
        if job.state != "running":
            break
        time.sleep(0.1)
    assert job.state == "cancelled"
    assert not (tmp_path / "run").exists()
    assert "code of the folder" not in str(job.document)


def test_every_command_of_the_page_is_one_of_the_command_line(studio, tmp_path, monkeypatch):
    studio.measurement("run.csv").configured()
    shutil.copy(tmp_path / "run.csv", tmp_path / "-other.csv")
    refuses("file-not-found", lambda: studio.start("export", "run.csv", {}), "no fit yet")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "fit.json").touch()
    given: list[list[str]] = []
    started = SimpleNamespace(document={})
    monkeypatch.setattr(
        studio.jobs, "start", lambda kind, name, words, *_: given.append(list(words)) or started
    )
    monkeypatch.chdir(tmp_path)
    targets = studio.state()["targets"]
    assert {"fmu", "ros2", "arduino"} <= set(targets)
    for kind in ("fit", "sample", "export", "report"):
        studio.start(kind, "run.csv", {})
    for target in targets:
        studio.start("export", "run.csv", {"target": target})
    for kind in ("qualify", "predict"):
        studio.start(kind, "run.csv", {"file": "-other.csv"})
    studio.compare(["run.csv", "-other.csv"])
    for name, *words in given:
        takes(name, words)
    (tmp_path / "run" / "chains.npz").touch()
    studio.start("sample", "run.csv", {})
    assert [words[-1] for name, *words in given if name == "sample"] == ["run", "--resume"]
    with pytest.raises(InputError):
        studio.start("export", "run.csv", {"target": "../../x"})


def test_a_folder_is_sent_as_zip_without_what_links_lead_to(tmp_path):
    folder = tmp_path / "made"
    (folder / "src").mkdir(parents=True)
    (folder / "src" / "a.h").write_text("int a;")
    (tmp_path / "secret").write_text("secret")
    (folder / "link").symlink_to(tmp_path / "secret")
    with entering(tmp_path) as (ready, visit):
        link = visit("/api/link?name=made").document["address"]
        archive = zipfile.ZipFile(io.BytesIO(ask(ready.address, f"/{link}&download=1").body))
    assert archive.namelist() == ["made/src/a.h"]


def test_files_of_several_folders_are_refused(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.csv").write_text("x")
    files = [tmp_path / name / "run.csv" for name in "ab"]
    refused(run("studio", *files), "[outside-folder]")
