"""`hysid export`: files of a fit that run without JAX, and what is said where there can be none."""

import hashlib
import os
import shutil
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import identify
from compensate import Quantity, Status, export_c, invert
from compensate.export._export import Origin
from compensate.runtime import load
from hysteresis import LinearSponge
from tests.c_harness import COMPILERS, Compiled, ran
from tests.test_hysid.command import COLUMNS, LINE, put, refused, run, sponge, text
from tests.thorough import rest_thorough


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("export")
    put(sponge(), place / "run.csv")
    written = datetime(2023, 5, 3, 12, tzinfo=UTC).timestamp()
    os.utime(place / "run.csv", (written, written))
    done = run("fit", place / "run.csv", *COLUMNS, *LINE, "--out", place / "fit")
    assert done.code == 0, done.err
    return place / "fit"


def test_both_files_are_the_compensator(folder: Path):
    c, runtime = folder / "foam.h", folder / "foam.json"
    found = run("export", folder, "--c", c, "--runtime", runtime, "--json").json()
    assert found["files"] == {"c": str(c), "runtime": str(runtime)}
    y = identify.load(folder).train.output[:50]
    wanted = np.asarray(invert(identify.load(folder).model).simulate(None, y).value)
    compensator = load(runtime)
    found = [compensator.step(0.01, v).value for v in y.tolist()]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    assert (compensator.reading["unit"], compensator.estimate["unit"]) == ("mm", "N")
    assert "foam_state *s, foam_real dt, foam_real reading, foam_real *estimate" in c.read_text()
    assert compensator.step(0.01, 10.0).deviation > 0


def test_the_files_carry_the_fit(folder: Path):
    """Trained range, verdict, codes, and the date of the file that was fitted; a guard of one's choice."""
    c, runtime = folder / "foam.h", folder / "new" / "foam.json"  # in a folder that is made
    fit = identify.load(folder)
    told = run("export", folder, "--runtime", runtime, "--c", c, "--json").json()
    assert (told["beyond"], told["start"], told["date"]) == ("limit", "unknown", "2023-05-03")
    compensator = load(runtime)
    assert compensator.trained == fit.trained == tuple(told["trained"])
    assert compensator.origin == {
        "verdict": fit.verdict.level, "date": "2023-05-03",
        "codes": [*fit.verdict.codes, "worse-than-cubic"],  # of the compensator, on these rows
        "sha256": hashlib.sha256((folder.parent / "run.csv").read_bytes()).hexdigest(),
    }  # fmt: skip
    assert fit.verdict.codes
    assert f'#define FOAM_VERDICT "{fit.verdict.level}"' in c.read_text()
    far = 1.4 * fit.train.output.max()
    assert compensator.step(0.01, far).value == fit.trained[1]
    assert compensator.step(0.01, far).status == Status.EXTRAPOLATED
    options = ("--beyond", "nan", "--start", "known", "--date", "1999-12-31")
    assert run("export", folder, "--runtime", runtime, *options).code == 0
    assert load(runtime).origin["date"] == "1999-12-31"
    assert np.isnan(load(runtime).step(0.01, far).value)
    refused(run("export", folder, "--runtime", runtime, "--beyond", "clip"), "limit or nan or free")
    assert run("export", folder, "--c", c, "--float", "--limits", 1, 9).code == 0
    assert "typedef float foam_real;" in c.read_text()
    assert "from 1 to 9;" in c.read_text()
    wrong = (("--limits", 9, 1), "Readings cannot be limited"), (("--date", "2020-02-31"), "--date")
    for options, said in (*wrong, (("--to", "c", c), "give one of them")):
        refused(run("export", folder, "--c", folder / "no.h", *options), said)
    beyond = run("export", folder, "--c", c, "--limits", 90, 99, "--json").json()
    assert beyond["ok_share"] == 0


def test_an_offset_that_takes_the_digits_of_float_is_told(tmp_path: Path):
    """The ends of its ranges have the digits that tell them apart."""
    rows = [[t, f, f"{float(x) + 1e7:.3f}", cycle] for t, f, x, cycle in sponge()]
    place, c = put(rows, tmp_path / "run.csv"), tmp_path / "foam.h"
    assert run("fit", place, *COLUMNS, *LINE, "--out", tmp_path / "fit").code == 0
    assert ": 10000000 to 100000" in run("check", place, *COLUMNS).out
    assert "In float estimates are" not in run("export", tmp_path / "fit", "--c", c).err
    assert "In float estimates are" in run("export", tmp_path / "fit", "--c", c, "--float").err
    reading = next(line for line in c.read_text().splitlines() if "reading: " in line)
    low, high = reading.split(" from ")[1].split(";")[0].split(" to ")
    assert 15 < float(high) - float(low) < 75


def test_a_target_is_written(folder: Path):
    found = run("export", folder, "--to", "arduino", folder / "foam", "--json").json()
    assert found["files"] == {"arduino": str(folder / "foam")}
    assert load(folder / "foam" / "hysid-export.json").origin["verdict"]
    refused(run("export", folder, "--to", "plc", folder / "plc"), "plc", "arduino", "opensees")


def test_a_clock_without_a_unit_tells_no_time(tmp_path: Path):
    put(text(sponge()).replace("time (s)", "time"), tmp_path / "run.csv")
    columns = [str(word).replace("time (s)", "time") for word in COLUMNS]
    assert run("fit", tmp_path / "run.csv", *columns, *LINE, "--out", tmp_path / "fit").code == 0
    said = run("export", tmp_path / "fit", "--runtime", tmp_path / "it.json").out
    assert "OK is reached after 0.095 cycles.\n" in said


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
@pytest.mark.parametrize(
    "name", rest_thorough(["force */ int planted; /* (N)", "a??/", "/*raw*/", "b\u202e\\"], 2)
)
def test_names_of_columns_run_nothing(name: str, tmp_path: Path):
    """A header says the names in a comment, and compiles as strictly as ever, as C++ too."""
    model, u = LinearSponge(0.4, 0.0), np.linspace(0.0, 10.0, 50)
    quantity = Quantity(name, name[::-1])
    export_c(
        model, tmp_path / "it.h", model.simulate(None, u), reading=quantity, estimate=quantity,
        title=f"{name}\n{name}", origin=Origin("PASS", (name,), f'2024" {name}'),
    )  # fmt: skip
    it = Compiled(tmp_path / "it.h", COMPILERS[0])
    assert it.wrong == 0
    assert "int planted" in it.text or "planted" not in name
    assert not hasattr(it.library, "planted")
    if shutil.which("g++"):
        (tmp_path / "it.cpp").write_text('#include "it.h"\nint main() { return 0; }\n')
        flags = ("-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only")
        ran("g++", *flags, "it.cpp", cwd=tmp_path)
