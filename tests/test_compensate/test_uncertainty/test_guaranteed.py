"""Bands that hold whole runs: the finite-sample law, the statement, and the exported band."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest

from compensate import calibrated, estimate, export_c, export_runtime, guaranteed, invert
from compensate.runtime import load
from hysteresis import InputError, MonotoneCurve, Record
from tests.c_harness import COMPILERS, STRICT

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
    band = invert(MODEL).calibrated(record, 0.9)
    assert type(band).__name__ == "GuaranteedCompensator"
    found = estimate(band, record)
    inside = (np.asarray(found.low) <= record.input) & (record.input <= np.asarray(found.high))
    whole = [inside[rows].all() for _, rows in record.sequences()]
    assert sum(whole) == 28  # ceil(31 x 0.9)
    assert "exchangeable with the 30 runs" in band.statement
    assert np.isnan(np.asarray(found.deviation)).all()


def test_too_few_runs_cannot_guarantee():
    with pytest.raises(InputError) as error:
        guaranteed(invert(MODEL), runs(8, 0), 0.9)
    assert error.value.code == "too-few-runs"
    assert guaranteed(invert(MODEL), runs(9, 0), 0.9).runs == 9
    for guarantee, kind in ((1.0, "auto"), (0.5, "row")):
        with pytest.raises(InputError) as error:
            guaranteed(invert(MODEL), runs(9, 0), guarantee, kind)
        assert error.value.code == "bad-option"


def test_a_band_follows_runs_that_become_known():
    band, later = guaranteed(invert(MODEL), runs(12, 0), 0.9), runs(12, 1, 1.0)
    after = band.follow(later)
    assert float(after.factor) > float(band.factor)  # their slopes differ five times as much
    assert after.followed == 12
    assert "long run" in after.statement


SOURCE = """
#include "it.h"
double follow(long runs, const double *given, const double *known, const long *ends);
double follow(long runs, const double *given, const double *known, const long *ends)
{
    it_state s;
    it_followed f;
    it_followed_reset(&f);
    long k = 0;
    double u, low, high;
    for (long j = 0; j < runs; ++j) {
        it_reset(&s);
        for (; k < ends[j]; ++k) {
            (void)it_step(&s, 0.01, given[k], &u, 0);
            it_watch(&f, &s, known[k]);
        }
        it_watch(&f, &s, NAN);
        it_follow(&f);
    }
    it_band(&s, &low, &high);
    it_followed_band(&f, &s, &low, &high);
    return f.factor;
}
"""


def in_c(folder: Path, given: np.ndarray, ends: np.ndarray) -> float:
    """The factor of it.h after runs whose inputs became known."""
    (folder / "follow.c").write_text(SOURCE)
    library = folder / "follow.so"
    command = [
        COMPILERS[0],
        *STRICT,
        "-O1",
        "-shared",
        "-fPIC",
        "-o",
        library,
        folder / "follow.c",
        "-lm",
    ]
    subprocess.run(command, check=True)
    code = ctypes.CDLL(str(library)).follow
    code.restype = ctypes.c_double
    reals, longs = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_long)
    y, u = np.ascontiguousarray(given)
    count = ends.astype(np.int64)
    return code(
        ctypes.c_long(len(ends)), y.ctypes.data_as(reals), u.ctypes.data_as(reals),
        count.ctypes.data_as(longs),
    )  # fmt: skip


@pytest.mark.parametrize("shaped", [False, True])
def test_files_give_the_band(shaped: bool, tmp_path: Path):
    """Python and C give the ends that JAX gives, of constant width and by the deviation."""
    record, later = runs(30, 1), runs(20, 2)
    inner = invert(MODEL)
    error = calibrated(inner, later)
    band = guaranteed(error if shaped else inner, record, 0.9)
    y = record.output[:12]
    wanted = band.simulate(None, y)
    options = {"error": error, "band": band}
    sensor = load(export_runtime(MODEL, tmp_path / "it.json", y, **options).path)
    assert type(sensor).__name__ == "Compensator"
    assert sensor.band is not None
    for k, reading in enumerate(y.tolist()):
        sensor.step(0.01, reading)
        np.testing.assert_allclose(sensor.band, (wanted.low[k], wanted.high[k]), atol=1e-9)
    text = export_c(MODEL, tmp_path / "it.h", y, **options).path.read_text("utf-8")
    assert "it_band(const it_state *s, it_real *low, it_real *high)" in text
    # As a sensor drifts, runs whose inputs become known move the band as in JAX; a state holds it.
    drifted = runs(12, 3, 1.0)
    after = float(band.follow(drifted).factor)
    rows = [rows for _, rows in drifted.sequences()]
    for k, one in enumerate(rows):
        sensor.reset()
        for reading, known in zip(drifted.output[one], drifted.input[one], strict=True):
            sensor.step(0.01, float(reading))
            sensor.watch(float(known))
        sensor.follow()
        if k == 5:
            kept = sensor.state()
            sensor = load(tmp_path / "it.json")
            assert type(sensor).__name__ == "Compensator"
            sensor.restore(kept)
    found, (low, high) = sensor.step(0.01, 5.0), sensor.band or (0.0, 0.0)
    half = after * (found.deviation if shaped else 1.0)
    assert (high - low) / 2 == pytest.approx(half, rel=1e-9)
    if COMPILERS:
        given = np.stack(
            [np.concatenate([x[one] for one in rows]) for x in (drifted.output, drifted.input)]
        )
        ends = np.cumsum([one.stop - one.start for one in rows])
        assert in_c(tmp_path, given, ends) == pytest.approx(after, rel=1e-9)
    if shaped:
        with pytest.raises(InputError) as refused:
            export_runtime(MODEL, tmp_path / "no.json", y, band=band)
        assert refused.value.code == "not-exportable"
