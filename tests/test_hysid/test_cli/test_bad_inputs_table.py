"""Bad input through the command line and Python, one row of a table each: what `test_bad_inputs` leaves."""

import json
import os
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

import identify
from hysteresis import LinearSponge, Record
from identify.internal import sealed
from tests.refusals import refuses
from tests.test_hysid.command import COLUMNS, F, T, X, answered, put, refused, run, text, tree
from tests.test_hysid.test_cli import test_bad_inputs as others
from tests.test_hysid.test_cli.test_bad_inputs import CLEAN, FIT, ROWS, Bad, cell, column

N = ("time", "force", "displacement", "cycle")
BARE = ("--input", "force", "--output", "displacement", "--time", "time")
UNITS = text([["s", "N", "mm", "1"], *ROWS], N)
GROUPED = (*others.HEADER, "block")


def blocks(*parts: list[list[str]]) -> str:
    """Rows of several specimens: A, B, C, ..."""
    rows = [[*row, chr(ord("A") + k)] for k, part in enumerate(parts) for row in part]
    return text(rows, GROUPED)


def overloaded(row: int = 5) -> list[list[str]]:
    """The clean rows, one reading of which is a word."""
    return [[*r[:2], "OVLD", *r[3:]] if k == row else r for k, r in enumerate(ROWS)]


TABLE = {
    "3: units that are not found": Bad(
        UNITS, "text-cell", ("line 2", "'time' = 's'", "a row of units?", "--units-row 2"), BARE),
    "4: one column twice": Bad(
        CLEAN, "given-twice", (f"{F!r}", "as input and as output", "--output COL"),
        ("--input", F, "--output", F)),
    "4: the clock for an output": Bad(
        CLEAN, "given-twice", (f"{T!r}", "as time and as output"),
        ("--input", F, "--output", T, "--time", T)),
    "7: a clock with a hole": Bad(
        cell(T, "", 39), "nan-time", ("1 NaN in time", f"{T!r}", "line 41", "--dt SECONDS")),
    "10: load in kilograms": Bad(
        text(ROWS, (T, F, "load (kg)", "cycle")), "wrong-unit",
        ("kg is mass", "kgf", "--output-unit UNIT"), ("--input", F, "--output", "load (kg)")),
    "15: a column that ends early": Bad(
        text(ROWS[:60]) + "".join(f"{','.join(r[:2])}\n" for r in ROWS[60:]), "ragged-line",
        ("line 62", "2 cells, the header has 4", "mend that line")),
    "17: an output that is held": Bad(
        column(X, ["7"] * len(ROWS)), "constant-output",
        (f"{X!r}", "7 mm in every row", "dead channel", "--output COL")),
    "27: zero bytes": Bad(CLEAN.replace("5", "\0", 3), "binary-file", ("export it as text",)),
    "31: every specimen is bad": Bad(
        blocks(overloaded(), overloaded()), "text-cell",
        ("A: ", "line 7", "'OVLD'", "1 more have the same fault", "--na-values OVLD"),
        (*COLUMNS, "--each", "block")),
}  # fmt: skip
"""By item and what is bad."""

pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.parametrize("bad", TABLE.values(), ids=TABLE.keys())
def test_a_bad_file_is_refused_by_check_and_by_fit(bad):
    put(bad.content)
    before = tree(Path())
    refused(run("check", "run.csv", *bad.options), *bad.words, f"[{bad.code}]\n")
    refused(run("fit", "run.csv", *bad.options, *FIT), *bad.words, f"[{bad.code}]\n")
    assert tree(Path()) == before


@pytest.mark.parametrize(("content", "options"), [
    (UNITS, (*BARE, "--units-row", "2")),
    (text([["s", "N", "mm", ""], *ROWS], N), BARE),
    (text(ROWS, (T, "force (ADC)", X, "cycle")),
     ("--input", "force (ADC)", "--output", X, "--input-unit", "count")),
    (text(ROWS, (T, "force (g)", X, "cycle")),
     ("--input", "force (g)", "--output", X, "--input-unit", "gf")),
    (cell(T, ROWS[38][0], 39), (*COLUMNS[:4], "--dt", "6")),
    (cell(F, "-3e301"), (*COLUMNS, "--na-values", "-3e301", "--nan", "interpolate")),
    (cell(X, "1e200"), (*COLUMNS, "--na-values", "1e200", "--nan", "omit")),
    (cell(X, "OVLD", 3), (*COLUMNS, "--where", "cycle=2,3,4,5")),
    (others.COMMA, (*COLUMNS, "--decimal", ",")),
    (others.OVERLOAD, (*COLUMNS, "--na-values", "OVLD", "--nan", "interpolate")),
    (others.NO_OUTPUT, (*COLUMNS, "--nan", "omit")),
    (others.NO_INPUT, (*COLUMNS, "--nan", "interpolate")),
    (others.RESET, (*COLUMNS, "--segments", "auto")),
])  # fmt: skip
def test_the_fix_that_the_message_names_is_accepted(content, options):
    put(content)
    said = run("check", "run.csv", *options)
    assert (said.code, said.err) == (0, "")
    assert "complete cycles" in said.out


def test_specimens_of_one_sample_are_too_short():
    put(blocks(ROWS[:1], ROWS[:1]))
    words = ("1 samples", "at least 8 samples", "[too-few-rows]\n")
    refused(run("check", "run.csv", *COLUMNS, "--each", "block"), *words)
    answered(run("fit", "run.csv", *COLUMNS, "--each", "block", *FIT), *words)


def test_a_sequence_of_one_row_is_said():
    put(blocks(ROWS, ROWS[:1]))
    said = run("check", "run.csv", *COLUMNS, "--group", "block")
    assert said.code == 0
    assert "1 sequence of one row, first 'B'. [short-sequence]" in said.out


# 23, 24, 25, 32, 33: what a fit leaves in its folder


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    """A line and its chains."""
    place = tmp_path_factory.mktemp("fitted")
    put(text(others.sponge()), place / "good.csv")
    keep = ("--conditioning", "keep", "--out", place / "good")
    assert run("fit", place / "good.csv", *COLUMNS, *FIT[:-2], *keep).code == 0
    assert run("sample", place / "good", "--steps", 40, "--ensembles", 2).code == 0
    return place


@pytest.fixture
def folder(fitted) -> Path:
    """A copy that may be spoilt, `out`, beside `run.csv`."""
    shutil.copy(fitted / "good.csv", "run.csv")
    return Path(shutil.copytree(fitted / "good", "out"))


def document(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "fit.json").read_text("utf-8"))


def edited(**changes: Any) -> Callable[[Path], Any]:
    """By somebody who knows how: the checksums are made again."""
    return lambda folder: put(json.dumps(sealed(document(folder) | changes)), folder / "fit.json")


def cut(name: str, length: int = 300) -> Callable[[Path], Any]:
    return lambda folder: put((folder / name).read_bytes()[:length], folder / name)


def no_text(folder: Path) -> None:
    (folder / "fit.json").write_bytes(bytes(range(256)))


class Touch:
    """What a pickle would run: it makes a file."""

    def __reduce__(self):
        return os.system, ("touch ran",)


def forged(name: str, content: bytes) -> Callable[[Path], None]:
    """Another file, and its checksum with it."""

    def forge(folder: Path) -> None:
        (folder / name).write_bytes(content)
        files = document(folder)["files"] | {name: sha256(content).hexdigest()}
        edited(files=files)(folder)

    return forge


def pickled_array(folder: Path) -> None:
    arrays = {"K": np.array([Touch()], object), "b": np.array(0.0), "threshold": np.array(0.0)}
    np.savez("forged.npz", allow_pickle=True, **arrays)
    forged("model.npz", Path("forged.npz").read_bytes())(folder)


def leads_out(folder: Path) -> None:
    """The fit of a value of `each` is said to be in a folder elsewhere."""
    selection = document(folder)["selection"] | {"each": "cycle"}
    edited(folders={"1": "../elsewhere"}, selection=selection)(folder)
    shutil.copytree(folder, "elsewhere")


class Spoilt(NamedTuple):
    """A folder that is refused: what was done to it, the code, words of the message, the command."""

    spoil: Callable[[Path], Any]
    code: str
    words: tuple[str, ...]
    command: tuple[object, ...] = ("predict", "out", "run.csv")


SAMPLE = ("sample", "out", "--ensembles", 2, "--resume")

BETTER = {"score_percent": 0.0, "trusted": True, "seconds": 0}
FOLDERS = {
    "32: newer": Spoilt(edited(schema=99), "newer-schema", ("out: ", "schema 99", "update hysid")),
    "32: better figures": Spoilt(
        lambda folder: put(json.dumps(document(folder) | BETTER), folder / "fit.json"),
        "edited-file", ("out: ", "score_percent, seconds", '"checksums"', "fit.json")),
    "32: cut": Spoilt(cut("fit.json"), "damaged-file", ("out: ", "fit.json", "cut off", "make it")),
    "32: no text": Spoilt(no_text, "damaged-file", ("fit.json", "make it again")),
    "32: cut arrays": Spoilt(cut("model.npz"), "wrong-checksum", ("model.npz", "fit again")),
    "32: another checksum": Spoilt(
        lambda folder: edited(files=document(folder)["files"] | {"data.npz": "0"})(folder),
        "wrong-checksum", ("data.npz", "not the file that was saved", "fit again")),
    "32: a pickle in an array": Spoilt(pickled_array, "damaged-file", ("out: ", "fit again")),
    "32: a pickle for arrays": Spoilt(
        forged("model.npz", pickle.dumps(Touch())), "damaged-file", ("out: ", "fit again")),
    "32: a foreign class": Spoilt(
        edited(structure={"class": "os.system"}), "unknown-model", ("'os.system'", "edited")),
    "32: a file elsewhere": Spoilt(
        edited(files={"../../secret.npz": "0"}), "file-not-found", ("secret.npz is missing",)),
    **{
        f"32: a folder elsewhere, {command[0]}": Spoilt(
            leads_out, "outside-folder", ("'../elsewhere'", "edited", "Fit again"), command)
        for command in (("predict", "out", "run.csv"), ("sample", "out", "--steps", 20))
    },
    "32: columns that are none": Spoilt(
        edited(selection={"x": 1}), "damaged-file", ("which columns", "Fit again")),
    **{
        f"32: a selection of another kind, {name}": Spoilt(
            lambda folder, name=name, odd=odd: edited(
                selection=document(folder)["selection"] | {name: odd}
            )(folder),
            "damaged-file", ("which columns", name, "Fit again"))
        for name, odd in {"where": 1e308, "time": 5, "decimal": ":", "group": [1]}.items()
    },
    "32: no columns": Spoilt(edited(selection=[1]), "damaged-file", ("which columns", "Fit again")),
    "32: no fit": Spoilt(
        lambda folder: (folder / "fit.json").unlink(), "file-not-found", ("out: ", "hysid fit --out DIR")),
    "24: another seed": Spoilt(
        lambda folder: None, "other-checkpoint",
        ("chains.npz", "another seed (0, now 1)", "without --resume"),
        (*SAMPLE, "--steps", 60, "--seed", 1)),
    "24: fewer steps": Spoilt(
        lambda folder: None, "more-steps-kept", ("40 steps were kept", "at least 40"),
        (*SAMPLE, "--steps", 30)),
    "33: chains cut": Spoilt(
        cut("chains.npz", 900), "damaged-file", ("chains.npz: ", "cut off", "without --resume"),
        (*SAMPLE, "--steps", 60)),
}  # fmt: skip


@pytest.mark.parametrize("spoilt", FOLDERS.values(), ids=FOLDERS.keys())
def test_a_bad_folder_is_refused_and_nothing_in_it_runs(spoilt, folder):
    spoilt.spoil(folder)
    before = tree(Path())
    refused(run(*spoilt.command), *spoilt.words, f"[{spoilt.code}]\n")
    assert tree(Path()) == before
    assert not Path("ran").exists()


def test_readings_beyond_the_fit_are_flagged_and_none_raises(folder):
    far = [[t, f"{3 * float(f):g}", f"{3 * float(x):g}", c] for t, f, x, c in ROWS]
    put(text(far), "far.csv")
    found = run("predict", "out", "far.csv", "--json").json()
    assert 0 < found["flagged"] < found["rows"]
    assert "beyond the trained inputs" in Path(found["file"]).read_text()
    backwards = run("predict", "out", "far.csv", "--inverse", "--json").json()
    assert np.isfinite(backwards["rmse"])


# 8, 11, 15, 20, 21: Python


def record() -> Record:
    force, displacement = np.array([row[1:3] for row in ROWS], float).T
    return Record.from_arrays(force, displacement, input_unit="N", output_unit="mm")


class NeverANumber(LinearSponge):
    """A root of what is negative for every K."""

    def curve(self, u: Any) -> Any:
        return jnp.sqrt(-1 - self.K**2) * u


PYTHON: dict[str, tuple[Callable[[], Any], str, tuple[str, ...]]] = {
    "8: a model that is never a number": (
        lambda: identify.fit(record(), NeverANumber(1.0), starts=2, noise="gaussian"),
        "no-finite-start", ("the data are finite; the model is not", "start", "give a model to start from"),
    ),
    "11: another dimension": (
        lambda: identify.fit(record(), "LinearSponge").predict(replace(record(), input_unit="V")),
        "wrong-unit", ("input is in V", "fitted to N", "say so in its header")),
    "12: a step of none": (
        lambda: Record.from_arrays([1, 2], [1, 2], dt=0.0), "bad-option", ("dt=0.0", "above 0")),
}  # fmt: skip


@pytest.mark.parametrize(("call", "code", "words"), PYTHON.values(), ids=PYTHON.keys())
def test_what_python_is_given_is_answered_alike(call, code, words):
    refuses(code, call, *words)
