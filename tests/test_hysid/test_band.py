"""The band of a fit is learnt once, kept with it, and told alike by all that use it; `invert` has it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hysid
from compensate import Status
from compensate.runtime import load as load_runtime
from hysteresis import BoucWen, Burgers, LinearSponge, Record
from hysteresis.internal import Units
from identify import FitResult
from tests.test_hysid.command import LINE, read, run, write

RANDOM = np.random.default_rng(8)
TIME = np.arange(600) / 100
FORCE = 10 - 9 * np.cos(2 * np.pi * TIME)
READING = 0.5 * FORCE + 1 + 0.1 * RANDOM.normal(size=600)
COLUMNS = ("--input", "force (N)", "--output", "reading (mm)", "--time", "time (s)")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A file, and the folder of a fit of it."""
    folder = tmp_path_factory.mktemp("band")
    columns = {"time (s)": TIME, "force (N)": FORCE, "reading (mm)": READING}
    file = write(folder / "run.csv", columns)
    chosen = (*LINE, "--test-cycles", 2, "--out", folder / "fit")
    assert run("fit", file, *COLUMNS, *chosen).code == 0
    return file, folder / "fit"


@pytest.fixture(scope="module")
def fit(place: tuple[Path, Path]) -> FitResult:
    return hysid.load(place[1])


def test_every_consumer_tells_the_same_coverage(place: tuple[Path, Path], tmp_path, monkeypatch):
    file, folder = place
    known = json.loads((folder / "fit.json").read_text())["compensator"]["band"]["coverage"]
    assert 0.8 < known <= 1

    def refused(*_: Any, **__: Any) -> None:
        raise AssertionError("the band was learnt again")

    monkeypatch.setattr("hysid._compensator.calibrated", refused)
    assert hysid.invert(hysid.load(folder)).coverage == known
    found = run("predict", folder, file, "--inverse", "--json").json()
    assert found["band"]["held_out"] == known
    assert json.loads(run("qualify", folder, file, "--json").out)["band"] == known
    assert run("export", folder, "--runtime", tmp_path / "it.json").code == 0
    assert load_runtime(tmp_path / "it.json").coverage == known


def test_a_model_that_a_line_beats_backwards_is_exported_with_a_verdict_that_says_so(fit, tmp_path):
    hysid.save(replace(fit, model=LinearSponge(K=0.4, b=2.0)), tmp_path / "fit")
    written = run("export", tmp_path / "fit", "--runtime", tmp_path / "it.json", "--json").json()
    assert any("straight line" in note and "better" in note for note in written["notes"])
    origin = load_runtime(tmp_path / "it.json").origin
    assert (origin["verdict"], "worse-than-line" in origin["codes"]) == ("FAIL", True)


@pytest.mark.thorough
def test_a_cycle_that_alone_tells_a_parameter_does_not_widen_the_band():
    """Without the one large cycle nothing says where the model yields: what it does there then is no error
    of the fit. Half widths were 800 to 2,400 times the 90 % quantile of the errors."""
    u = np.interp(np.arange(161) / 20, np.arange(9), [0.0, 1.0, 0.0, 1.1, 0.0, 10.0, 0.0, 1.0, 0.0])
    truth = BoucWen(k=1.0, alpha=0.2, yield_at=3.0, n=1.5)
    y = np.asarray(truth.simulate(None, u)) + 0.02 * RANDOM.normal(size=len(u))
    record = Record.from_arrays(u, y)
    fit = hysid.fit(record, truth, noise="gaussian", starts=1, conditioning="keep")
    found = hysid.invert(fit).simulate(None, y)
    off, half = np.abs(np.asarray(found.value) - u), 1.645 * np.asarray(found.deviation)
    assert 0.6 < half.mean() / np.quantile(off, 0.9) < 2


def test_the_default_band_holds_and_says_so(fit: FitResult):
    compensator = hysid.invert(fit)
    found = compensator.simulate(None, fit.test.output)
    held = np.abs(np.asarray(found.value) - FORCE) <= 1.645 * np.asarray(found.deviation)
    # 200 rows give 0.9 to 0.021, and so do the residuals that the band was learnt from.
    assert compensator.coverage == pytest.approx(held[fit.test.mask].mean())
    assert compensator.coverage == pytest.approx(0.9, abs=0.06)
    assert np.median(found.deviation) == pytest.approx(0.1 / 0.5, rel=0.3)
    assert found.draws is None  # 200 numbers a sample would fill the memory
    assert compensator.units == Units("mm", "N", "s")


def test_guards_are_those_that_are_asked_for(fit: FitResult):
    far = [30.0, 1.0]
    assert float(hysid.invert(fit).simulate(None, far).value.max()) == pytest.approx(FORCE.max())
    free = hysid.invert(fit, beyond="free").simulate(None, far)
    assert float(free.value.max()) > 50
    assert free.status[0] == Status.EXTRAPOLATED
    late = hysid.invert(fit, start="unknown").simulate(None, [5.0])
    assert late.status[0] in (Status.RUN_IN, Status.OK)


def test_the_longest_sequence_may_be_held_out_as_a_whole(tmp_path: Path):
    """Its clock is not that of the rows that were trained, and its readings are no golden ones."""
    t, name = 0.01 * np.arange(600.0), np.repeat(["a", "b"], [200, 400])
    times = np.where(name == "a", t, 50 * t)
    record = Record.from_arrays(FORCE, READING, times, groups=name, input_unit="N")
    train, test = record.split_rows(name == "b")
    found = hysid.fit(train, "LinearSponge", noise="gaussian", test=test)
    hysid.invert(found).simulate(t[:200], READING[:200])
    hysid.save(found, tmp_path / "fit")
    assert run("export", tmp_path / "fit", "--runtime", tmp_path / "inverse.json").code == 0


def test_predict_limits_readings_as_the_export_does(tmp_path: Path):
    """What creeps remembers how far a spike went."""
    creeping = Burgers(E1=2.0, eta1=40.0, E2=1.0, eta2=5.0)
    reading = np.asarray(creeping.simulate(TIME, FORCE)) + 0.01 * RANDOM.normal(size=600)
    columns = {"time (s)": TIME, "force (N)": FORCE, "reading (mm)": reading}
    file, out = write(tmp_path / "run.csv", columns), tmp_path / "fit"
    chosen = (*COLUMNS, *LINE[2:], "--model", "Burgers", "--test-cycles", 2, "--out", out)
    assert run("fit", file, *chosen).code == 0
    spiked = reading.copy()
    spiked[[0, 200]] = 1e6
    other = write(tmp_path / "other.csv", columns | {"reading (mm)": spiked})
    found = read(run("predict", out, other, "--inverse", "--json").json()["file"])
    assert run("export", out, "--runtime", tmp_path / "it.json").code == 0
    runtime = load_runtime(tmp_path / "it.json")
    told = [runtime.step(dt, y) for dt, y in zip(np.diff(TIME, prepend=0.0), spiked, strict=True)]
    assert [row["status"] for row in found] == [one.status.name for one in told]
    values = [float(row["estimated force (N)"]) for row in found]
    np.testing.assert_allclose(values, [one.value for one in told], rtol=1e-9)
