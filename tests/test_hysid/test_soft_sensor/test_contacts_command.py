"""`hysid microchannel train-pairs`: the shipped skin of two places, saved, run again, and without JAX."""

import json
from pathlib import Path

import numpy as np
import pytest

from compensate.runtime import FileError, load
from tests.test_hysid.command import put, read, refused, run

DATA = Path(__file__).parents[3] / "datasets" / "skin-two-places.csv"
INPUTS = ("--input", "layer 1 (V)", "--input", "layer 2 (V)", "--time", "time (s)")
FORCES = ("--force", "force B (N)", "--force", "force D (N)")


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("pairs") / "pair"
    done = run(
        "microchannel", "train-pairs", DATA, *INPUTS, *FORCES, "--group", "session", "--epochs", 40,
        "--out", out, "--json",
    )  # fmt: skip
    found = done.json()
    assert found["taught"] == {"force B": 6, "force D": 6}
    assert found["judged"] == 6  # those that press both at once
    for of in found["metrics"].values():
        # A second's training; the forces go up to 8 N, and a guess of their mean errs by 2.4.
        assert of["rmse"] < 0.5
        assert 0.8 < of["coverage_of_90_percent_bands"] <= 1.0
    return out


def test_what_was_learnt_runs_over_a_file_and_without_jax(trained: Path):
    lines = DATA.read_text().splitlines()
    both = [line for line in lines[1:] if line.split(",")[0] == "14"]
    file = put("\n".join([lines[0], *both]) + "\n", trained.parent / "new.csv")
    found = run("microchannel", "estimate", trained, file, "--json").json()
    assert found["rows"] == len(both)
    told = read(found["file"])
    value = np.array([[float(row["force B (N)"]), float(row["force D (N)"])] for row in told])
    truth = np.array([line.split(",")[3:5] for line in both], float)
    assert np.sqrt(np.mean((value - truth) ** 2)) < 0.5
    runtime = load(trained / "runtime.json")
    cells = np.array([line.split(",") for line in both], float)
    steps = zip(cells[:40, 5:].tolist(), np.diff(cells[:40, 2], prepend=cells[0, 2]), strict=True)
    same = [runtime.step(float(dt), y).value for y, dt in steps]
    np.testing.assert_allclose(same, value[:40], atol=1e-5)  # of six digits in the table
    assert runtime.step(0.05, (float("nan"), 1.0)).status.name == "INVALID"


def test_what_cannot_be_used_is_answered(trained: Path, tmp_path: Path):
    one = ("microchannel", "train-pairs", DATA, *INPUTS, *FORCES, "--group", "session")
    alone = ("--where", "session=1,2,3,4,13", "--out", tmp_path / "x")
    refused(run(*one, *alone), "No sequence presses force D alone")
    refused(run(*one, "--out", trained), "--overwrite")
    refused(run(*one, "--input", "force D (N)", "--out", tmp_path / "x"), "[given-twice]")
    document = json.loads((trained / "runtime.json").read_text())
    document["zero"][0] += 0.5
    (tmp_path / "changed.json").write_text(json.dumps(document))
    with pytest.raises(FileError, match="changed"):
        load(tmp_path / "changed.json")
