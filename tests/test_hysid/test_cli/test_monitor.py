"""`hysid monitor`, and the guarantee of `hysid qualify` with what `hysid export` makes of it."""

import json
from pathlib import Path

import numpy as np
import pytest

from compensate.runtime import load
from tests.test_hysid.command import COLUMNS, LINE, F, T, X, put, read, refused, run, text

CYCLES, ROWS = 16, 40


def rows(gain: float = 1.0, known: tuple[int, ...] | None = None, seed: int = 0) -> list[list[str]]:
    """Cells of cycles of a line with noise; forces outside the cycles `known` are empty."""
    random = np.random.default_rng(seed)
    up = np.linspace(2, 20, ROWS // 2, endpoint=False)
    shape, cells = np.append(up, 22 - up), []
    for k in range(CYCLES * ROWS):
        force, cycle = shape[k % ROWS], k // ROWS
        length = gain * (1.3 * force + 6) + 0.05 * random.normal()
        cells.append([str(0.5 * k), f"{force:.3f}", f"{length:.5f}", str(cycle)])
        if known is not None and cycle not in known:
            cells[-1][1] = ""
    return cells


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("monitor")
    files = {
        "run": rows(), "same": rows(1.0, (1, 8), 1), "changed": rows(0.85, (1, 8), 2),
        "new": rows(seed=3), "few": rows(seed=4)[: 5 * ROWS],
    }  # fmt: skip
    for name, cells in files.items():
        put(cells, place / f"{name}.csv")
    bare = [[t, x] for t, _, x, _ in rows(seed=5)]
    put(text(bare, (T, X)), place / "bare.csv")
    line = (*LINE, "--test-cycles", 2, "--out", place / "fit")
    done = run("fit", place / "run.csv", *COLUMNS, *line)
    assert done.code == 0, done.err
    return place


def test_a_sensor_that_has_not_changed_needs_nothing(folder: Path):
    found = run("monitor", folder / "fit", folder / "same.csv", "--json").json()
    assert (found["advice"], found["found"], found["references"]) == ("NONE", [], 2 * ROWS)
    assert abs(found["gain"] - 1) < 0.002
    said = run("monitor", folder / "fit", folder / "same.csv").out
    assert "Nothing that was seen asks for a calibration now." in said
    assert f"80 references the error is {found['rmse']:.3g} N rms" in said
    assert f"{found['fit_error']:.3g} N of an unchanged sensor." in said
    in_kN = [[t, u and f"{float(u) / 1000:.6f}", *more] for t, u, *more in rows(1.0, (1, 8), 1)]
    put(text(in_kN, (T, "force (kN)", X, "cycle")), folder / "kN.csv")
    other = ("monitor", folder / "fit", folder / "kN.csv", "--reference", "force (kN)", "--json")
    assert run(*other).json()["rmse"] == pytest.approx(found["rmse"])


def test_a_change_is_found_with_its_line_and_its_size(folder: Path):
    found = run("monitor", folder / "fit", folder / "changed.csv", "--json").json()
    (change,) = found["found"]
    assert ROWS < change["line"] < 3 * ROWS
    assert abs(found["gain"] - 0.85) < 0.01
    assert change["lost"] > 3 * found["fit_error"]
    table = read(found["file"])
    assert list(table[0])[:5] == ["line", T, X, f"known {F}", f"estimated {F}"]
    assert len(table) == found["rows"] == CYCLES * ROWS
    # The last cycles have no reference, and are right again.
    wanted = [float(row[1]) for row in rows()][-ROWS:]
    off = np.array([float(row[f"estimated {F}"]) for row in table[-ROWS:]]) - wanted
    assert np.sqrt(np.mean(off**2)) < 4 * found["fit_error"]


def test_a_log_without_references_is_said_to_have_none(folder: Path):
    found = run("monitor", folder / "fit", folder / "bare.csv", "--json").json()
    assert found["references"] == 0
    assert found["notes"] == ["The log has no reference, so changes cannot be seen."]
    refused(run("monitor", folder / "fit", folder / "bare.csv", "--reference", F), F)


def test_the_guarantee_goes_with_the_export(folder: Path):
    place = folder / "fit"
    first = run("export", place, "--runtime", folder / "none.json", "--json")
    assert first.code == 0, first.err
    bare = load(folder / "none.json")
    assert type(bare).__name__ == "Compensator"
    assert bare.band is None
    # A line has no loop that could be removed, whatever the verdict.
    done = run("qualify", place, folder / "new.csv", "--guarantee", 0.9, "--json")
    given = json.loads(done.out)["guarantee"]
    assert given["given"]
    assert given["runs"] >= given["needed"] == 9
    kept = json.loads((place / "qualify.json").read_text())
    assert kept["guarantee"]["factor"] == given["factor"]
    assert run("export", place, "--runtime", folder / "band.json").code == 0
    banded = load(folder / "band.json")
    assert type(banded).__name__ == "Compensator"
    estimate = banded.step(0.01, 20.0)
    assert banded.band is not None
    low, high = banded.band
    assert high - low == pytest.approx(2 * given["factor"] * estimate.deviation)


def test_too_few_runs_are_said_to_be_too_few(folder: Path):
    done = run("qualify", folder / "fit", folder / "few.csv", "--guarantee", 0.9)
    assert "Cannot guarantee 90 %: that needs 9 runs or cycles" in done.out
    found = json.loads((folder / "fit" / "qualify.json").read_text())["guarantee"]
    assert not found["given"]
    assert found["half_width"] is None
