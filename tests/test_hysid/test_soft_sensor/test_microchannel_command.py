"""`hysid microchannel`: a sensor from CSV files, saved, run again, and what is said of bad input."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compensate.runtime import load
from hysid.soft_sensor._sensor import load_sensor
from tests.test_hysid import command
from tests.test_hysid.command import Result, answered, example, refused, run

TIME, ONE, TWO, FORCE, PLACE, X = (
    "time (s)", "layer 1 (V)", "layer 2 (V)", "force (N)", "place", "x (mm)",
)  # fmt: skip
HEADER = (TIME, ONE, TWO, FORCE, PLACE, X, "press")
GAINS = {"A": (0.6, 0.2, 0.0), "C": (0.4, 0.4, 20.0), "E": (0.2, 0.6, 40.0)}
"""V/N of each layer, and mm."""
INPUTS = ("--input", ONE, "--input", TWO)
STREAM = (*INPUTS, "--time", TIME, "--group", "press")
SHORT = ("--kind", "network", "--epochs", 6, "--members", 2)
ROWS, REST = 30, 6
Rows = list[list[str]]


def presses(places: str, seed: int = 0) -> Rows:
    """One press after the other, each a stream of its own that begins at rest."""
    random, rows = np.random.default_rng(seed), []
    for n, place in enumerate(places):
        rise = np.clip(np.arange(ROWS) - REST + 1, 0, None) / (ROWS - REST)
        force = random.uniform(3, 8) * np.sin(np.pi * rise)
        behind = np.concatenate([force[:1], force[:-1]])  # what makes a loop
        one, two, x = GAINS[place]
        spread = np.exp(random.normal(0, 0.03, 2))
        seen = (0.8 * force + 0.2 * behind)[:, None] * np.array([one, two]) * spread
        seen += random.normal(0, 0.01, (ROWS, 2))
        for k in range(ROWS):
            pressed = (place, f"{x:g}") if force[k] > 0.3 else ("", "")
            numbers = (0.05 * k, *seen[k], max(force[k], 0.0))
            rows.append([*(f"{v:.4f}" for v in numbers), *pressed, f"{seed}-{n}"])
    return rows


def put(file: Path, rows: Rows, header: tuple[str, ...] = HEADER) -> Path:
    with file.open("w", newline="") as handle:  # cells with commas in them are quoted
        csv.writer(handle).writerows([header, *rows])
    return file


def read(file: str | Path) -> dict[str, np.ndarray]:
    rows = command.read(file)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


class Trained:
    """A folder with a sensor, the sessions it was learnt from and tested on, and what was printed."""

    def __init__(self, folder: Path):
        self.folder, self.out = folder, folder / "sensor"
        self.session = put(folder / "first.csv", presses("ACE" * 4))
        self.other = put(folder / "other.csv", presses("ACE" * 2, seed=1))
        self.arguments = (
            "microchannel", "train", self.session, "--test-file", self.other, *STREAM, *SHORT,
            "--force", FORCE, "--place", PLACE, "--position", X, "--range", -1, 4.5, "--out", self.out,
            "--na-values", "LOST",
        )  # fmt: skip
        self.done = run(*self.arguments, "--json")

    def estimate(self, rows: Rows, *options: Any, header: tuple[str, ...] = HEADER) -> Any:
        file = put(self.folder / "new.csv", rows, header)
        return run("microchannel", "estimate", self.out, file, "--json", *options).json()


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return Trained(tmp_path_factory.mktemp("microchannel"))


def test_a_sensor_is_learnt_and_judged(trained: Trained):
    found = trained.done.json()
    assert found == json.loads((trained.out / "training.json").read_text())
    assert found["inputs"] == [{"name": ONE, "unit": "V"}, {"name": TWO, "unit": "V"}]
    assert (found["rows_train"], found["rows_test"]) == (12 * ROWS, 6 * ROWS)
    assert set(found["sha256"]) == {str(trained.session), str(trained.other)}
    train, test = found["metrics"]["train"], found["metrics"]["test"]
    for part in (train, test):
        assert part["force"]["nrmse_percent"] < 15  # a training of seconds
        assert part["place"]["accuracy"] > 0.9
        assert part["position"]["mean_error"] < 5
        table = part["place"]["confusion"]
        assert (table["places"], table["estimates"]) == (["A", "C", "E"], ["A", "C", "E", "none"])
        assert np.sum(table["counts"]) == part["place"]["rows"]
    assert found["force"]["held_out_rmse_by_kind"] == {"network": found["force"]["held_out_rmse"]}
    assert found["runtime"]["file"] == "runtime.json"
    assert "training: 100 %" in trained.done.err
    for name in ("learning.png", "force.png"):
        assert (trained.out / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_the_examples_of_its_help_run(trained: Trained, tmp_path: Path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    one = [[f"{0.05 * k:.2f}", *row[1:]] for k, row in enumerate(presses("ACEACE", seed=2))]
    put(Path("run.csv"), one)
    put(Path("new.csv"), one[:40])
    trained_here = run(*example("microchannel train"), *SHORT, "--json").json()
    assert trained_here["rows_test"] > 0
    assert run(*example("microchannel estimate")).code == 0


def test_what_was_saved_says_what_was_learnt(trained: Trained):
    found = run("microchannel", "estimate", trained.out, trained.other, "--json").json()
    wanted = trained.done.json()["metrics"]["test"]
    for name, value in wanted["force"].items():
        # A relative error is null where a measured force is 0.
        close = value if isinstance(value, str | None) else pytest.approx(value, rel=1e-6)
        assert found[name] == close
    for name in ("place", "position"):
        assert found[name] == wanted[name]
    table = read(found["file"])
    assert list(table) == [
        "line", "time", "force", "force_sd", "force_status", "place", "probability", "place_status",
        X, "position_sd", "position_status", "channels",
    ]  # fmt: skip
    assert found["rows"] == len(table["line"]) == 6 * ROWS
    assert set(table["place"]) <= {"A", "C", "E", ""}


def test_the_runtime_file_is_the_force_estimator(trained: Trained):
    sensor, table = load_sensor(trained.out), read(trained.other)
    readings = np.stack([table[ONE], table[TWO]], 1).astype(float)[:ROWS]
    t = table[TIME].astype(float)[:ROWS]
    force = sensor.estimate(t, readings)["force"]
    runtime = load(trained.out / "runtime.json")
    steps = np.diff(t, prepend=t[0]).tolist()
    found = [runtime.step(dt, y).value for y, dt in zip(readings.tolist(), steps, strict=True)]
    np.testing.assert_allclose(found, force, atol=1e-8)


def test_a_channel_that_is_not_there(trained: Trained):
    rows = [row[:2] + row[3:] for row in presses("AC")]
    file = put(trained.folder / "lost.csv", rows, HEADER[:2] + HEADER[3:])
    done = run("microchannel", "estimate", trained.out, file)
    refused(done, f"{TWO!r}", "a channel of the trained sensor", "[wrong-channels]")
    milli = TWO.replace("(V)", "(mV)")
    file = put(trained.folder / "milli.csv", presses("A"), (*HEADER[:2], milli, *HEADER[3:]))
    done = run("microchannel", "estimate", trained.out, file)  # renamed, it would be off by 1000
    refused(done, f"Give {milli!r} in V, under the name {TWO!r}")


def test_what_is_learnt_is_no_input(trained: Trained):
    done = run(*trained.arguments, "--input", FORCE, "--overwrite")
    refused(done, f"{FORCE!r} is given as input and as output", "[given-twice]")


def test_an_interrupted_training_is_kept_unless_asked(trained: Trained, tmp_path: Path):
    (tmp_path / "checkpoint").mkdir()
    words = [tmp_path if word == trained.out else word for word in trained.arguments]
    refused(run(*words), "(--resume)", "[would-overwrite]")


def test_a_stream_goes_on_behind_bad_samples(trained: Trained):
    rows = presses("ACE", seed=2)
    clean = read(trained.estimate(rows)["file"])
    for k in range(10, 13):
        rows[k][2] = ""
    for k in range(ROWS + 8, ROWS + 20):
        rows[k][1] = rows[ROWS + 8][1]
    rows[2 * ROWS + 15][2] = "4.5"
    for row in rows[2 * ROWS + 20 :]:
        row[0] = f"{float(row[0]) + 20:g}"
    found = trained.estimate(rows)
    table = read(found["file"])
    assert found["channels_at_fault"] == {
        ONE: {"STUCK": 12 - 4, "GAP": 1},
        TWO: {"MISSING": 3, "SATURATED": 1, "GAP": 1},
    }
    for name in ("force_status", "place_status", "position_status"):
        assert (table[name][10:13] == "INVALID").all()
        assert (table[name][ROWS + 12 : ROWS + 20] == "STUCK").all()
        assert table[name][2 * ROWS + 15] == "SATURATED"
    assert table["force_status"][2 * ROWS + 20] == "GAP"
    assert table["channels"][2 * ROWS + 20] == f"{ONE}: GAP, {TWO}: GAP"
    assert (table["place"][10:13] == "").all()
    # The next stream begins anew, and three lost samples are forgotten in twice as many.
    np.testing.assert_array_equal(table["force"][ROWS : ROWS + 8], clean["force"][ROWS : ROWS + 8])
    after = slice(19, ROWS)
    off = table["force"][after].astype(float) - clean["force"][after].astype(float)
    assert np.abs(off).max() < 0.5


def test_words_for_missing_values_replace_those_of_the_training(trained: Trained):
    """As other options of reading a file do, and those of `hysid predict`."""
    rows = presses("A", seed=2)
    rows[10][2] = "LOST"
    assert trained.estimate(rows)["channels_at_fault"] == {TWO: {"MISSING": 1}}
    words = (trained.out, trained.folder / "new.csv", "--na-values", "OVLD")
    refused(run("microchannel", "estimate", *words), "'LOST'", "[text-cell]")


def test_swapped_channels_are_told(trained: Trained):
    swapped = (TIME, TWO, ONE, *HEADER[3:])
    found = trained.estimate(presses("AAAEAA", seed=3), header=swapped)
    (note,) = (note for note in found["notes"] if "swapped" in note)
    assert f"{TWO}, {ONE}" in note


def test_a_press_at_no_known_place(trained: Trained):
    rows, noise = presses("A", seed=4), np.random.default_rng(4).normal(0, 0.01, ROWS)
    for row, only in zip(rows, noise, strict=True):
        row[2], row[3:6] = f"{only:.5f}", ["", "", ""]
    found = trained.estimate(rows)
    assert found["statuses"]["place_status"]["UNKNOWN"] > ROWS / 3
    assert found["flagged"] > ROWS / 3
    assert found["rmse"] is None
    shown = run("microchannel", "estimate", trained.out, trained.folder / "new.csv")
    assert "The file has no measured values to compare with" in shown.out


def places(folder: Path, session: Rows, *options: Any) -> Result:
    file = put(folder / "session.csv", session)
    head = ("microchannel", "train", file, *STREAM, "--place", PLACE, "--out", folder / "out")
    return run(*head, *options)


def test_places_that_are_missing_or_rare_are_named(tmp_path: Path):
    second = put(tmp_path / "second.csv", presses("AAAA", seed=1))
    wanted = ("--places", "A,C,E", "--json")
    found = places(tmp_path, presses("A" * 8 + "C"), *wanted, "--overwrite").json()
    assert any("no row to learn from is at 'E'" in note for note in found["notes"])
    assert any("place 'C' has" in note and "'A' has" in note for note in found["notes"])
    head = (tmp_path / "session.csv", "--test-file", put(tmp_path / "third.csv", presses("AE", 2)))
    found = run(
        "microchannel", "train", second, *head, *STREAM, "--place", PLACE, "--overwrite", "--json",
        "--out", tmp_path / "out",
    ).json()  # fmt: skip
    assert any(note.startswith("second.csv has no row") for note in found["notes"])
    assert any("no row to learn from is at 'E'" in note for note in found["notes"])
    assert found["metrics"]["test"]["place"]["confusion"]["places"] == ["A", "C", "E"]
    answered(places(tmp_path, presses("AAA"), "--overwrite"), "1 place", "[bad-option]")
    answered(places(tmp_path, presses("AC"), "--places", "A", "--overwrite"), "'C'", "--places")


def test_a_training_goes_on_only_with_its_own_data(trained: Trained, monkeypatch: Any):
    other = [trained.other if word == trained.session else word for word in trained.arguments]
    other = [
        trained.session if word == trained.other and k > 2 else word for k, word in enumerate(other)
    ]
    answered(run(*other, "--resume"), "another data", "[other-checkpoint]")

    def stopped(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hysid.commands._microchannel.train_force", stopped)
    done = run(*trained.arguments, "--overwrite")
    assert done.code == 130
    assert "To resume: hysid microchannel train" in done.err
    assert done.err.count("--resume") == 1
    assert load_sensor(trained.out).force is not None  # what was there is still whole


def test_folders_that_hold_no_sensor(trained: Trained, tmp_path: Path):
    refused(run("microchannel", "estimate", tmp_path, trained.other), "training.json", "train")
    for file in trained.out.glob("*.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())

    def answer(name: str, content: bytes) -> Result:
        whole = (trained.out / name).read_bytes()
        (tmp_path / name).write_bytes(content)
        done = run("microchannel", "estimate", tmp_path, trained.other)
        (tmp_path / name).write_bytes(whole)
        return done

    names = ("soft_sensor.json", "soft_sensor.npz")
    words, arrays = ((trained.out / name).read_bytes() for name in names)
    refused(answer("soft_sensor.npz", arrays[:-50]), "soft_sensor.npz", "[wrong-checksum]")
    refused(answer("soft_sensor.json", words[:500]), "soft_sensor.json", "[damaged-file]")
    refused(answer("soft_sensor.json", words.replace(b'"V"', b'"A"')), "channels", "[edited-file]")
    refused(answer("soft_sensor.json", words.replace(b'"schema": 1', b'"schema": 9')), "schema 9")
    refused(answer("training.json", b"{"), "training.json", "[damaged-file]")


def test_what_cannot_be_learnt_is_said(tmp_path: Path):
    rows = presses("AC" * 3)
    session = put(tmp_path / "session.csv", rows)

    def answer(*options: Any, file: Path = session) -> Result:
        return run("microchannel", "train", file, *INPUTS, "--out", tmp_path / "out", *options)

    refused(answer(), "There is nothing to learn", "--force")
    refused(answer("--force", FORCE), "--time COL")
    refused(answer("--force", FORCE, "--kind", "magic"), "'magic'", "structured")
    refused(answer("--place", "where"), "'where'", f"{PLACE!r}")
    refused(answer("--place", PLACE, "--test-file", session), "twice")
    refused(answer("--place", PLACE, "--range", 2, 1), "LOW HIGH")
    still = put(tmp_path / "still.csv", [[*row[:2], "0.5", *row[3:]] for row in rows])
    refused(answer("--place", PLACE, file=still), f"{TWO!r} reads 0.5", "[constant-input]")
    header = tuple(name.replace("(V)", "(mV)") for name in HEADER)
    unlike = put(tmp_path / "unlike.csv", rows, header)
    refused(answer("--place", PLACE, "--test-file", unlike), "no-column")
    assert not (tmp_path / "out" / "training.json").exists()


def test_a_log_with_decimal_commas_is_estimated(trained: Trained):
    """The fix that the refusal names is an option of the command."""
    rows = presses("AC")
    plain = read(trained.estimate(rows)["file"])
    file = put(trained.folder / "new.csv", [[f"{x}".replace(".", ",") for x in r] for r in rows])
    refused(run("microchannel", "estimate", trained.out, file), "--decimal ,")
    found = run("microchannel", "estimate", trained.out, file, "--decimal", ",", "--json").json()
    np.testing.assert_array_equal(read(found["file"])["force"], plain["force"])
