"""`hysid qualify`: exit codes, what it prints and writes, what it refuses."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.test_hysid.command import (
    COLUMNS,
    HEADER,
    LINE,
    SPONGE,
    F,
    T,
    X,
    blocks,
    put,
    refused,
    run,
    sponge,
    text,
    tree,
)

PREISACH = ("--model", "Preisach", "--test-cycles", 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The shipped run, which is fitted, another of the same rig, and fits with and without `each`."""
    place = tmp_path_factory.mktemp("qualify")
    (place / "run.csv").write_bytes(SPONGE.read_bytes())
    put(sponge(), place / "other.csv")
    put(text([row[:2] for row in sponge()], (T, F)), place / "half.csv")
    assert run("fit", place / "run.csv", *COLUMNS, *PREISACH, "--out", place / "fit").code == 0
    put(blocks(), place / "blocks.csv")
    each = ("--each", "block", *LINE, "--out", place / "each")
    assert run("fit", place / "blocks.csv", *COLUMNS, *each).code == 0
    return place


@pytest.fixture(scope="module")
def found(folder) -> dict[str, Any]:
    return run("qualify", folder / "fit", folder / "other.csv", "--json").json()


def test_another_run_is_judged_row_by_row(found, folder):
    assert found["verdict"]["level"] in ("PASS", "CAUTION")
    assert found["errors"]["rows"] == 101
    assert found["nrmse_percent"] < 3
    assert found["loop"]["cycles"] == 5
    assert found["loop"]["ratio"] < 0.25
    assert found["doubt"] is None
    assert found["names"]["input"] == F
    written = json.loads((folder / "fit" / "qualify.json").read_text())
    assert found["file"] == str(folder / "fit" / "qualify.json")
    assert (written["source"], written["verdict"]) == ("other.csv", found["verdict"])


def test_it_judges_as_predict_does(found, folder):
    backwards = run("predict", folder / "fit", folder / "other.csv", "--inverse", "--json").json()
    assert found["errors"]["rmse"] == pytest.approx(backwards["rmse"])
    assert found["errors"]["max_abs"] == pytest.approx(backwards["max_abs"])
    assert backwards["flagged"] == round(101 * (1 - found["statuses"]["OK"]))


def test_in_the_file_of_the_fit_only_held_out_rows_count(folder):
    seen = run("qualify", folder / "fit", folder / "run.csv", "--json").json()
    assert seen["verdict"]["level"] == "PASS"
    assert seen["errors"]["rows"] == 20
    assert seen["loop"]["cycles"] == 1


@pytest.mark.parametrize(("needs", "code", "level", "words"), [
    (("--max-error", 5, "--rate", 1), 0, "PASS", "No error is above the 5 N"),
    (("--max-error", 0.001), 2, "FAIL", "above the 0.001 N asked for"),
    (("--rate", 1000), 0, "PASS", "1000 Hz needs a processor of"),
    (("--rate", 1e9, "--mhz", 100), 2, "FAIL", "too long for 1e+09 Hz"),
    (("--rate", 1e9, "--target", "python"), 2, "FAIL", "too long for 1e+09 Hz"),
])  # fmt: skip
def test_needs_decide_and_say_so(folder, needs, code, level, words):
    said = run("qualify", folder / "fit", folder / "run.csv", *needs)
    assert (said.code, said.err) == (code, "")
    assert said.out.startswith(f"{level}: {F} estimated from {X}\n  ")
    assert words in said.out
    assert "loop width: " in said.out
    assert said.out.endswith(f"{folder / 'fit' / 'qualify.json'}\n")
    as_json = run("qualify", folder / "fit", folder / "run.csv", *needs, "--json")
    assert as_json.code == code
    assert json.loads(as_json.out)["verdict"]["level"] == level


def test_a_step_is_that_of_the_export(folder, tmp_path):
    said = run("qualify", folder / "fit", folder / "run.csv", "--rate", 1000).out
    header = run("export", folder / "fit", "--c", tmp_path / "it.h", "--json").json()
    assert f"{header['operations']['most']:,} at most on the training's readings" in said


def test_each_is_qualified_by_its_own_fit(folder):
    said = run("qualify", folder / "each", folder / "blocks.csv")
    assert said.code == 0
    assert "block = soft\nCAUTION: " in said.out
    assert said.out.count("so the error on new data is not known") == 2
    result = run("qualify", folder / "each", folder / "blocks.csv", "--json").json()
    assert list(result["each"]) == ["soft", "thin"]
    assert result["verdict"]["level"] == "CAUTION"
    said = [(one["code"], one["text"][:15]) for one in result["verdict"]["reasons"]]
    assert said == [("error", "soft: CAUTION. "), ("error", "thin: CAUTION. ")]
    mean = np.mean([one["nrmse_percent"] for one in result["each"].values()])
    assert result["nrmse_percent"] == pytest.approx(mean)
    one = run("qualify", folder / "each", folder / "blocks.csv", "--where", "block=soft", "--json")
    assert list(one.json()["each"]) == ["soft"]
    worse = run("qualify", folder / "each", folder / "blocks.csv", "--max-error", 1e-3)
    assert worse.code == 2


@pytest.mark.thorough
def test_a_posterior_gives_the_worst_case(folder, monkeypatch):
    monkeypatch.setattr("hysid.commands._qualify.DRAWS", 5)
    drawn = run("sample", folder / "fit", "--steps", 20, "--ensembles", 2, "--json")
    assert drawn.code == 0
    result = run("qualify", folder / "fit", folder / "other.csv", "--json").json()
    assert result["doubt"]["worst"] >= 0.9 * result["errors"]["max_abs"]
    assert 0 < result["doubt"]["coverage"] <= 1
    assert "coverage" in [reason["code"] for reason in result["verdict"]["reasons"]]


ROWS = sponge()


@pytest.mark.parametrize(("content", "words"), [
    (text([*ROWS, *ROWS]), ("Time goes back",)),
    (text([row[:2] for row in ROWS], (T, F)), (f"No column {X!r}",)),
    (text([[row[0], row[2]] for row in ROWS], (T, X)), (f"No column {F!r}",)),
    (text([*ROWS[:9], [ROWS[9][0], "OVLD", "1", "1"], *ROWS[10:]]), ("OVLD",)),
    ("", ()),
], ids=["time backwards", "no output", "no input", "text", "empty"])  # fmt: skip
def test_bad_files_are_refused_in_a_line(folder, tmp_path, content, words):
    (tmp_path / "bad.csv").write_text(content)
    before = tree(folder / "fit")
    refused(run("qualify", folder / "fit", tmp_path / "bad.csv"), *words)
    assert tree(folder / "fit") == before


def test_a_fit_of_several_inputs_is_refused(folder, tmp_path):
    rows = [[*row, f"{2 * float(row[1]):g}"] for row in sponge()]
    put(text(rows, (*HEADER, "twice (N)")), tmp_path / "two.csv")
    out = (*LINE, "--out", tmp_path / "two")
    fitted = run("fit", tmp_path / "two.csv", *COLUMNS, "--input", "twice (N)", *out)
    assert fitted.code == 0, fitted.err
    refused(run("qualify", tmp_path / "two", tmp_path / "two.csv"), "2 inputs")
