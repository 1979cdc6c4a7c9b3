"""`hysid loops`: from a file to the table of its loops."""

import numpy as np
import pytest

import hysid
from tests.test_hysid.command import COLUMNS, LINE, F, T, X, put, read, refused, run, sponge, text


def test_a_file_alone_gives_the_loops_of_its_record(tmp_path):
    file = put(sponge(), tmp_path / "run.csv")
    found = run("loops", file, *COLUMNS, "--json").json()
    table = hysid.read_csv(file, "force (N)", "displacement (mm)", "time (s)").loops()
    assert [one["cycle"] for one in found["loops"]] == table.cycle.tolist()
    energy = [one["figures"]["energy lost"]["value"] for one in found["loops"]]
    assert energy == pytest.approx(table["energy lost"].value.tolist())
    assert found["kind"] == "mechanical"
    guessed = run("loops", file, "--json").json()  # hysid chooses the columns itself
    assert guessed["summary"] == found["summary"]
    said = run("loops", file).out
    assert "energy lost" in said
    assert "N * mm" in said


@pytest.mark.parametrize("each", [(), ("--each", "specimen")])
def test_smaller_loops_are_left_out_of_the_means_and_counted(tmp_path, each):
    x = np.concatenate([size * np.sin(np.linspace(0, 4 * np.pi, 400)) for size in (1, 0.5)])
    rows = [[str(k), f"{one:.4f}", f"{2 * one:.4f}", "A"] for k, one in enumerate(x)]
    names = (T, F, X, "specimen")
    file = put(text(rows, names), tmp_path / "sweep.csv")
    left = len(run("loops", file, *COLUMNS, "--json").json()["loops"])
    left -= run("loops", file, *COLUMNS, "--json").json()["summary"][0]["loops"]
    assert left > 0
    for command in ("loops", "datasheet") if not each else ("loops",):
        assert f"leave out {left} loop" in run(command, file, *COLUMNS, *each).out
    put(text(rows[:40], names), file)
    assert run("loops", file, *COLUMNS, *each).out.startswith("No loop: the input does not go")


def test_the_table_is_written_for_other_programs(tmp_path):
    file = put(sponge(), tmp_path / "run.csv")
    out = tmp_path / "loops.csv"
    assert run("loops", file, *COLUMNS, "--each", "cycle", "--csv", out).code == 0
    rows = read(out)
    assert {row["cycle"] for row in rows} >= {"1"}
    assert np.isfinite(float(rows[0]["width at mid-range (mm)"]))
    measured = file.read_bytes()
    refused(run("loops", file, *COLUMNS, "--csv", file), f"{file.name} would be read and written")
    assert file.read_bytes() == measured
    fault = run("loops", file, *COLUMNS, "--csv", file / "loops.csv")
    assert fault.code == 2
    assert "a file is where a folder is needed" in fault.err
    assert "cannot-write" in run("loops", file, *COLUMNS, "--csv", tmp_path, "--json").err
    assert "bad-option" in run("loops", file, *COLUMNS, "--kind", "round", "--json").err


def specimens(*softer: float) -> list[list[str]]:
    """The sponge so many times as soft each; the last column counts them."""
    cells = [(k, by, row) for k, by in enumerate(softer) for row in sponge()]
    return [[*row[:2], f"{float(row[2]) * by:.4f}", str(k)] for k, by, row in cells]


def test_specimens_have_a_row_each_and_outliers_are_told(tmp_path):
    rows = specimens(*(2.0 if k == 3 else 1 + 0.01 * k for k in range(6)))
    file = put(rows, tmp_path / "six.csv")
    asked = ("loops", file, *COLUMNS, "--each", "cycle")
    found = run(*asked, "--json").json()
    energy = found["specimens"]["energy lost"]
    assert energy["outliers"] == ["3"]
    each = [one["summary"] for one in found["each"].values()]
    lost = [next(s["value"] for s in one if s["name"] == "energy lost") for one in each]
    assert energy["mean"] == pytest.approx(np.mean(lost))
    assert energy["spread"] == pytest.approx(np.std(lost, ddof=1))
    said = run(*asked).out.splitlines()
    assert sum("*" in line for line in said if line.startswith("3 ")) == 1
    assert said[-1].startswith("* is further")


def test_two_groups_of_specimens_are_compared(tmp_path):
    for name, softer in (("new", 1.0), ("old", 1.5)):
        rows = specimens(*(softer * (1 + 0.01 * k) for k in range(3)))
        file = put(rows, tmp_path / f"{name}.csv")
        assert run("fit", file, *COLUMNS, "--each", "cycle", *LINE).code == 0
    found = run("compare", tmp_path / "new", tmp_path / "old", "--loops", "--json").json()
    figures = {row["name"]: row for row in found["figures"]}
    assert found["specimens"] == [3, 3]
    assert figures["stiffness"]["clear"]
    assert figures["stiffness"]["needed"] == 2
    assert not figures["duration"]["clear"]
    said = run("compare", tmp_path / "new", tmp_path / "old", "--loops").out
    assert "stiffness" in said.splitlines()[-1]
    assert '"too-few-fits"' in run("compare", tmp_path / "new", "--loops", "--json").err


def test_a_data_sheet_takes_two_commands(tmp_path):
    files = [put(sponge(), tmp_path / f"run{k}.csv") for k in range(2)]
    assert run("init", files[0]).code == 0
    found = run("datasheet", *files, "--json").json()
    assert [place.rpartition(".")[2] for place in found["files"]] == ["html", "pdf"]
    rows = {row["name"]: row for row in found["rows"]}
    assert rows["reproducibility"]["value"] == pytest.approx(0)
    assert rows["hysteresis"]["value"] > 1
    assert '"would-overwrite"' in run("datasheet", *files, "--json").err
    run("datasheet", *files, "--out", tmp_path / "sheet.pdf")
    assert {place.name for place in tmp_path.glob("sheet*")} == {"sheet.html", "sheet.pdf"}
    other = put(text(sponge()).replace("(N)", "(kN)"), tmp_path / "other.csv")
    columns = ("--input", "force (N)", "--output", "displacement (mm)", "--overwrite", "--json")
    assert '"no-column"' in run("datasheet", files[0], other, *columns).err
