"""Models that a record or a file cannot bear, through the command line: time constants, time, moduli."""

import json
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import hysid
from hysteresis import Burgers
from identify.internal import read_document, sealed
from tests.test_hysid.command import COLUMNS, LINE, answered, put, refused, run, sponge, text

BURGERS = ("--model", "Burgers", *LINE[2:], "--out", "out", "--json")
NAMES = ("time", "force", "displacement", "cycle")
PLAIN = ("--input", "force", "--output", "displacement", "--time", "time", "--units-row", 2)

pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.fixture(scope="module")
def line(tmp_path_factory) -> Path:
    """The folder of a line through the sponge, in N and mm."""
    place = tmp_path_factory.mktemp("line")
    put(text([["s", "N", "mm", "1"], *sponge()], NAMES), place / "run.csv")
    assert run("fit", place / "run.csv", *PLAIN, *LINE, "--out", place / "out").code == 0
    return place


def creep(constant: float, seconds: int = 200) -> str:
    """A Burgers element whose delayed part has this time constant, in steps of 1 s."""
    t = np.arange(float(seconds))
    force = 5 + 4 * np.interp(t % 50, [0, 20, 30, 50], [-1, 1, 1, -1])
    x = np.array(Burgers(2.0, 400.0, 1.0, constant).simulate(t, force))
    x += np.random.default_rng(0).normal(0, 1e-4 * np.ptp(x), len(x))
    rows = zip(t, force, x, strict=True)
    return text([[f"{a:g}", f"{b:.6g}", f"{c:.9g}", "1"] for a, b, c in rows])


@pytest.mark.parametrize(("constant", "words"), [
    (0.1, ("shorter than the sampling steps (1 s)", "only as a spring", "sample faster")),
    (3000.0, ("longer than the record (199 s)", "only as a dashpot", "measure longer holds")),
])  # fmt: skip
def test_time_constants_that_the_record_cannot_show(constant, words):
    put(creep(constant))
    reasons = run("fit", "run.csv", *COLUMNS, *BURGERS).json()["verdict"]["reasons"]
    (said,) = [reason["text"] for reason in reasons if reason["code"] == "unseen-time-constant"]
    for word in words:
        assert word in said


def test_a_saved_model_with_a_negative_modulus_is_refused(line):
    """Edited by hand, checksum and all."""
    shutil.copytree(line, ".", dirs_exist_ok=True)
    fit = replace(hysid.load("out"), model=Burgers(2.0, 40.0, 1.0, 5.0))
    hysid.save(fit, "other")
    with np.load("other/model.npz") as kept:
        arrays = dict(kept) | {"E2": np.array(-1.0)}
    np.savez("out/model.npz", allow_pickle=False, **arrays)
    digest = sha256(Path("out/model.npz").read_bytes()).hexdigest()
    document = read_document("out") | {"structure": read_document("other")["structure"]}
    document["files"]["model.npz"] = digest
    Path("out/fit.json").write_text(json.dumps(sealed(document)))
    words = ("E2 = -1.0", "a sign or a unit slipped", "above 0", "[parameter-out-of-bounds]")
    refused(run("predict", "out", "run.csv"), *words)


def test_a_column_in_another_unit_than_the_fits_is_refused(line):
    """Also where it is only compared, and that of the time."""
    for *units, said in (
        ("s", "kN", "mm", "force is in kN; the model was fitted to N"),
        ("s", "N", "m", "displacement is in m; the model was fitted to mm"),
        ("ms", "N", "mm", "time is in ms; the model was fitted to s"),
    ):
        put(text([[*units, "1"], *sponge()], NAMES), "other.csv")
        for command in (("predict",), ("predict", "--inverse"), ("qualify",)):
            refused(run(*command, line / "out", "other.csv"), said, "[wrong-unit]")


def test_an_output_without_a_range_has_no_error_in_per_cent(line):
    rows = [["s", "N", "mm", "1"], *([t, u, "3", c] for t, u, _, c in sponge())]
    put(text(rows, NAMES), "other.csv")
    assert " mm rms; 0 of " in run("predict", line / "out", "other.csv").out


def test_what_is_known_of_parameters_is_said_on_the_command_line():
    put(sponge())
    known = ("--parameter", "b fixed=0", "--parameter", "K prior=log-normal(2, 1.5) bounds=0.1,9")
    found = run("fit", "run.csv", *COLUMNS, *LINE, *known, "--json").json()
    K, b, _ = found["parameters"]
    assert (b["name"], b["value"], b["status"]) == ("b", 0.0, "fixed")
    assert K["low"] < K["value"] < K["high"]
    assert found["settings"]["K"] == {
        "bounds": [0.1, 9.0], "prior": "log-normal(2, 1.5)", "fixed": False, "tied": None,
    }  # fmt: skip
    assert found["noise_model"]["kind"] == "Gaussian"


@pytest.mark.parametrize(("said", "words"), [
    ("K", ("K", "is not a name with settings")),
    ("K start=none", ("'none'", "not a number")),
    ("K bounds=5,9", ("starts at", "outside", "start inside")),
])  # fmt: skip
def test_what_cannot_be_meant_of_a_parameter_is_refused(said, words):
    put(sponge())
    known = ("--parameter", said, "--parameter", "b fixed=1")
    answered(run("fit", "run.csv", *COLUMNS, *LINE, *known), *words)
