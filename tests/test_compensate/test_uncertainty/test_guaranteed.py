"""Bands that hold whole runs: the finite-sample law, the statement, and the exported band."""

from pathlib import Path

import numpy as np
import pytest

from compensate import calibrated, estimate, export_c, export_runtime, guaranteed, invert
from compensate.runtime import load
from hysteresis import MonotoneCurve, Record
from tests.refusals import raises, refuses

MODEL = MonotoneCurve(np.array([0.0, 10.0]), np.array([20.0]))


def runs(count: int, seed: int, spread: float = 0.2) -> Record:
    """Runs of a line whose slope and noise differ from run to run."""
    random = np.random.default_rng(seed)
    u = np.tile(np.append(np.linspace(0, 5, 8), np.linspace(4, 1, 4)), (count, 1))
    slope = 2.0 + spread * random.normal(size=(count, 1))
    y = slope * u + 0.05 * random.normal(size=u.shape)
    return Record.from_arrays(u.ravel(), y.ravel(), groups=np.repeat(np.arange(count), u.shape[1]))


def test_a_run_is_held_where_all_its_rows_are():
    record = runs(30, 1)
    band = guaranteed(invert(MODEL), record, 0.9)
    low, high = band.around(estimate(band.compensator, record))
    inside = (low <= record.input) & (record.input <= high)
    whole = [inside[rows].all() for _, rows in record.sequences()]
    assert sum(whole) == 28  # ceil(31 x 0.9)
    assert "exchangeable with the 30 runs" in band.statement


def test_too_few_runs_cannot_guarantee():
    refuses("too-few-runs", lambda: guaranteed(invert(MODEL), runs(8, 0), 0.9))
    assert guaranteed(invert(MODEL), runs(9, 0), 0.9).runs == 9
    for guarantee, kind in ((1.0, "auto"), (0.5, "row")):
        with raises("bad-option"):
            guaranteed(invert(MODEL), runs(9, 0), guarantee, kind)


@pytest.mark.parametrize("shaped", [False, True])
def test_files_give_the_band(shaped: bool, tmp_path: Path):
    """Python and C give the ends that JAX gives, of constant width and by the deviation."""
    record, later = runs(30, 1), runs(20, 2)
    inner = invert(MODEL)
    error = calibrated(inner, later)
    band = guaranteed(error if shaped else inner, record, 0.9)
    y = record.output[:12]
    low, high = band.around(band.compensator.simulate(None, y))
    options = {"error": error, "band": band}
    sensor = load(export_runtime(MODEL, tmp_path / "it.json", y, **options).path)
    assert type(sensor).__name__ == "Compensator"
    assert sensor.band is not None
    for k, reading in enumerate(y.tolist()):
        sensor.step(0.01, reading)
        np.testing.assert_allclose(sensor.band, (low[k], high[k]), atol=1e-9)
    text = export_c(MODEL, tmp_path / "it.h", y, **options).path.read_text("utf-8")
    assert "it_band(const it_state *s, it_real *low, it_real *high)" in text
    if shaped:
        refuses("not-exportable", lambda: export_runtime(MODEL, tmp_path / "no.json", y, band=band))
