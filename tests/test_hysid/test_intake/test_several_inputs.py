"""Several inputs on the command line: combined in a fit, found again by what reads its folder."""

from pathlib import Path

import numpy as np
import pytest

import hysid
from tests.test_hysid.command import LINE, T, X, put, read, refused, run, sponge, text

A, B, STILL = "near (mT)", "far (V)", "temperature (K)"
HEADER = (T, A, B, STILL, X, "cycle")
COLUMNS = ("--input", A, "--input", B, "--output", X, "--time", T)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two channels of the force, one of which falls and bends, and one that stays."""
    place, rows = tmp_path_factory.mktemp("channels"), []
    for t, force, x, cycle in sponge():
        f = float(force)
        rows.append([t, f"{3 + 0.2 * f:.6g}", f"{np.exp(-0.1 * f):.6g}", "293", x, cycle])
    put(text(rows, HEADER), place / "run.csv")
    put(text([row[:3] for row in rows], HEADER[:3]), place / "inputs.csv")
    return place


@pytest.fixture(scope="module")
def fitted(folder) -> dict:
    options = (*LINE, "--test-cycles", 1, "--out", folder / "out", "--json")
    return run("fit", folder / "run.csv", *COLUMNS, *options).json()


def test_a_fit_says_what_it_combined(folder, fitted):
    assert (fitted["channels"]["names"], fitted["channels"]["units"]) == ([A, B], ["mT", "V"])
    assert fitted["data"]["input"] == {"name": "2 channels combined", "unit": "mm"}
    assert fitted["selection"]["input"] == [A, B]
    assert any("Combined 2 channels" in said for said in fitted["data"]["history"])
    # Half the width of the sponge's loop, which no curve explains, is 7 per cent of its range.
    assert fitted["metrics"]["test"]["nrmse_percent"] < 8
    assert {file.suffix for file in (folder / "out").iterdir()} == {".json", ".npz"}


def test_the_command_and_python_agree(folder, fitted):
    record = hysid.read_csv(folder / "run.csv", input=[A, B], output=X, time=T)
    found = hysid.fit(record, "LinearSponge", test_cycles=1, noise="gaussian", starts=2)
    test = found.metrics["test"]
    assert test._asdict() == pytest.approx(fitted["metrics"]["test"])
    turned = hysid.read_csv(folder / "run.csv", input=(B, A), output=X, time=T)
    back = hysid.load(folder / "out")
    np.testing.assert_allclose(back.predict(turned), found.predict(record), rtol=1e-9)


def test_predict_reads_all_channels(folder, fitted):
    found = run("predict", folder / "out", folder / "run.csv", "--json").json()
    assert found["rows"] == fitted["data"]["rows"]
    assert found["nrmse_percent"] < 8
    assert list(read(found["file"])[0])[1:3] == ["2 channels combined", X]
    alone = run("predict", folder / "out", folder / "inputs.csv", "--json").json()
    assert (alone["rows"], alone["rmse"]) == (found["rows"], None)


def test_no_output_tells_several_inputs_apart(folder, fitted):
    said = run("predict", folder / "out", folder / "run.csv", "--inverse")
    refused(said, "2 inputs", "[not-invertible]")


@pytest.mark.thorough
def test_a_report_shows_each_curve(folder, fitted):
    page = Path(run("report", folder / "out", "--json").json()["file"]).read_text("utf-8")
    for words in ("Curves of 2 channels", "far", "2 inputs cannot be recovered from one output"):
        assert words in page


def test_a_still_channel_is_left_out_and_said(folder):
    options = ("--input", STILL, *LINE, "--out", folder / "still")
    found = run("fit", folder / "run.csv", *COLUMNS, *options, "--json").json()
    assert found["channels"]["names"] == [A, B]
    assert any(f"Left out '{STILL}'" in said for said in found["data"]["history"])


@pytest.mark.parametrize(
    ("inputs", "code", "words"),
    [
        ((A, A), "given-twice", f"'{A}'"),
        ((A, "nearer"), "no-column", "'nearer'"),
        ((f"{A},{B}",), "no-column", "--input COL --input COL"),
    ],
)
def test_bad_inputs_are_named(folder, inputs: tuple[str, ...], code: str, words: str):
    options = [word for name in inputs for word in ("--input", name)]
    said = run("check", folder / "run.csv", *options, "--output", X, "--time", T)
    refused(said, words, f"[{code}]")
