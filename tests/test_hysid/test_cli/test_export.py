"""`hysid export`: files of a fit that run without JAX, and what is said where there can be none."""

from pathlib import Path

import numpy as np
import pytest

import identify
from compensate import invert
from compensate.runtime import load
from tests.test_hysid.command import COLUMNS, refused, run, sponge, text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("export")
    (place / "run.csv").write_text(text(sponge()))
    done = run(
        "fit", place / "run.csv", *COLUMNS, "--model", "LinearSponge", "--out", place / "fit"
    )
    assert done.code == 0, done.err
    return place / "fit"


def test_both_files_are_the_compensator(folder: Path):
    c, runtime = folder / "foam.h", folder / "foam.json"
    found = run("export", folder, "--c", c, "--runtime", runtime, "--json").json()
    assert found["files"] == {"c": str(c), "runtime": str(runtime)}
    y = identify.load(folder).train.output[:50]
    wanted = np.asarray(invert(identify.load(folder).model).simulate(None, y).value)
    compensator = load(runtime)
    found = [compensator.step(v).value for v in y.tolist()]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    assert (compensator.reading["unit"], compensator.estimate["unit"]) == ("mm", "N")
    assert "foam_state *s, foam_real reading, foam_real *estimate" in c.read_text()
    assert compensator.step(10.0).deviation > 0


def test_limits_and_precision(folder: Path):
    c = folder / "foam.h"
    assert run("export", folder, "--c", c, "--float", "--limits", 1, 9).code == 0
    assert "typedef float foam_real;" in c.read_text()
    assert "from 1 to 9;" in c.read_text()


def test_what_is_at_fault_is_said(folder: Path):
    refused(run("export", folder), "--c FILE.h")
    refused(run("export", folder, "--c", folder / "1 2.h"), "cannot be a name in C")
    refused(run("export", folder / "none", "--c", folder / "it.h"), "none")
