"""`hysid.invert` of a fit: its estimates have the band that holds, and say how often it held."""

from pathlib import Path

import numpy as np
import pytest

import hysid
from compensate import Status
from hysteresis import Record
from hysteresis.internal import Units
from identify import FitResult
from tests.test_hysid.command import run

RANDOM = np.random.default_rng(8)
U = 10 + 9 * np.sin(2 * np.pi * np.arange(600) / 100)
Y = 0.5 * U + 1 + 0.1 * RANDOM.normal(size=600)
RECORD = Record.from_arrays(U, Y, input_unit="N", output_unit="mm")


@pytest.fixture(scope="module")
def fit() -> FitResult:
    return hysid.fit(RECORD, "LinearSponge", noise="gaussian", test_cycles=2)


def test_the_default_band_holds_and_says_so(fit: FitResult):
    compensator = hysid.invert(fit)
    found = compensator.simulate(None, fit.test.output)
    held = np.abs(np.asarray(found.value) - U) <= 1.645 * np.asarray(found.deviation)
    # 200 rows give 0.9 to 0.021, and so do the residuals that the band was learnt from.
    assert compensator.coverage == pytest.approx(held[fit.test.mask].mean())
    assert compensator.coverage == pytest.approx(0.9, abs=0.06)
    assert np.median(found.deviation) == pytest.approx(0.1 / 0.5, rel=0.3)
    assert found.draws is None  # 200 numbers a sample would fill the memory
    assert compensator.units == Units("mm", "N", "1")


def test_guards_are_those_that_are_asked_for(fit: FitResult):
    far = [30.0, 1.0]
    assert float(hysid.invert(fit).simulate(None, far).value.max()) == pytest.approx(U.max())
    free = hysid.invert(fit, beyond="free").simulate(None, far)
    assert float(free.value.max()) > 50
    assert free.status[0] == Status.EXTRAPOLATED
    late = hysid.invert(fit, start="unknown").simulate(None, [5.0])
    assert late.status[0] in (Status.RUN_IN, Status.OK)


def test_the_longest_sequence_may_be_held_out_as_a_whole(tmp_path: Path):
    """Its clock is not that of the rows that were trained, and its readings are no golden ones."""
    t, name = 0.01 * np.arange(600.0), np.repeat(["a", "b"], [200, 400])
    record = Record.from_arrays(U, Y, np.where(name == "a", t, 50 * t), groups=name, input_unit="N")
    train, test = record.split_rows(name == "b")
    found = hysid.fit(train, "LinearSponge", noise="gaussian", test=test)
    hysid.invert(found).simulate(t[:200], Y[:200])
    hysid.save(found, tmp_path / "fit")
    assert run("export", tmp_path / "fit", "--runtime", tmp_path / "inverse.json").code == 0
