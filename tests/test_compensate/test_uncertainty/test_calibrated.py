"""Bands: of draws, calibrated ones and how long their errors last, and those that hold whole runs."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compensate import calibrated, estimate, export_c, export_runtime, guaranteed, invert
from compensate.internal import CalibratedCompensator
from compensate.runtime import load
from hysteresis import AbstractModel, Burgers, LinearSponge, MonotoneCurve, Preisach, Record
from hysteresis.preisach import GridDensity
from tests.problems import HIGH, LOW, SAMPLES, random_histories, weights
from tests.refusals import raises, refuses
from tests.streams import check_stream
from tests.thorough import rest_thorough

DRAWS = 9


def grid(rng: np.random.Generator) -> Preisach:
    return Preisach(GridDensity(LOW, HIGH, weights(rng)), rng.uniform(0.3, 0.6, 7), rng.normal())


def burgers(rng: np.random.Generator) -> Burgers:
    return Burgers(*rng.uniform([1, 20, 1, 2], [4, 80, 4, 10]), rng.normal())


def sponge(rng: np.random.Generator) -> LinearSponge:
    return LinearSponge(*rng.uniform([1, 5], [2, 8]), 1.5)


def stacked(make: Any, draws: int = DRAWS) -> tuple[list[Any], Any]:
    each = [make(np.random.default_rng(k)) for k in range(draws)]
    return each, jax.tree.map(lambda *leaves: np.stack(leaves), *each)


both = pytest.mark.parametrize("make", rest_thorough([grid, burgers, sponge], 2))
t = 0.1 * np.arange(SAMPLES)


def history(seed: int = 1) -> np.ndarray:
    return random_histories(np.random.default_rng(seed), LOW, HIGH, (4, SAMPLES))[-1]


@both
def test_side_by_side_as_one_by_one(make: Any):
    each, models = stacked(make)
    y = np.asarray(each[0].simulate(t, history()))
    found = invert(models).simulate(t, y)
    alone = np.stack([np.asarray(invert(model).simulate(t, y).value) for model in each])
    np.testing.assert_allclose(found.draws, alone, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.value, alone.mean(0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.deviation, alone.std(0), rtol=0, atol=1e-9)
    wanted = np.quantile(alone, [0.1, 0.5], axis=0)
    np.testing.assert_allclose(found.quantile([0.1, 0.5]), wanted, rtol=0, atol=1e-9)
    assert found.quantile(0.5).shape == y.shape


@both
def test_a_stream_equals_the_batch_and_holes_leave_no_trace(make: Any):
    each, models = stacked(make)
    y = np.asarray(each[0].simulate(t, history()))
    hole = np.isin(np.arange(SAMPLES), [0, 5, 6, 17])
    broken = np.where(hole, np.resize([np.nan, np.inf, -np.inf], SAMPLES), y)
    error = jnp.array([[0.1, 0.2], [0.3, 0.4]])
    levels, scores = jnp.array([LOW, HIGH]), jnp.array([-1.0, 1.0])
    inner = invert(models)
    for compensator in (inner, CalibratedCompensator(inner, levels, error, scores, 0.01)):
        check_stream(compensator, t, broken, 1e-8)
        # There is no deviation before a reading.
        assert np.isfinite(np.asarray(compensator.simulate(t, broken).draws)[:, 1:]).all()


def wrong(seed: int, cycles: int = 8) -> tuple[AbstractModel, Record]:
    """A line, and a record whose readings it misses by a wave per cycle: larger on the way up."""
    rng, per = np.random.default_rng(seed), 200
    u = 5 - 5 * np.cos(2 * np.pi * np.arange(cycles * per + 1) / per)
    amplitude = np.append(np.repeat(rng.normal(0, 1, cycles), per), 0.0)
    up = np.gradient(u) > 0
    y = u + np.where(up, 0.3, 0.1) * amplitude * np.sin(u / 2 + 1)
    return LinearSponge(1.0, 0.0), Record.from_arrays(u, y, dt=0.01)


def test_the_error_is_added_in_quadrature_and_carried_over():
    _, models = stacked(lambda rng: LinearSponge(1.0, 0.05 * rng.normal()), 40)
    _, record = wrong(0)
    plain = invert(models)
    known = calibrated(plain, record)
    found, spread = known.simulate(None, record.output), plain.simulate(None, record.output)
    error = np.sqrt(np.asarray(found.deviation) ** 2 - np.asarray(spread.deviation) ** 2)
    assert error.min() >= 0.99 * np.asarray(known.error).min()
    np.testing.assert_array_equal(found.value, spread.value)
    other = known.around(invert(LinearSponge(1.0, 0.0)))
    assert other.error is known.error
    assert other.simulate(None, record.output).deviation.max() < np.asarray(found.deviation).max()


def test_no_row_to_learn_from_is_refused():
    model, record = wrong(0, 4)
    refuses("no-rows", lambda: calibrated(invert(model), record.split_rows(record.cycle >= 9)[1]))


DT, SLOPE, TIME, ROWS = 0.1, 2.0, 1.5, 6000
LINE = LinearSponge(K=SLOPE, b=0.0, threshold=0.0)


def error_of(share: float) -> tuple[Record, float, float]:
    """A line whose readings have noise of which a share decays within 1.5 s."""
    random, phi = np.random.default_rng(7), np.exp(-DT / TIME)
    slow, white = np.zeros(ROWS), random.normal(size=ROWS)
    for k in range(1, ROWS):
        slow[k] = phi * slow[k - 1] + np.sqrt(1 - phi**2) * random.normal()
    t = DT * np.arange(ROWS)
    u = 10 - 5 * np.cos(0.2 * t)
    y = SLOPE * u + 0.1 * (np.sqrt(share) * slow + np.sqrt(1 - share) * white)
    record = Record.from_arrays(u, y, t)
    found = calibrated(invert(LINE), record)
    return record, found.share, found.lasts


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_share_and_time_are_found(share: float):
    """600 s are 200 decays, which give the correlations to 0.07 or so."""
    _, found, lasts = error_of(share)
    assert found == pytest.approx(share, abs=0.12)
    assert lasts == pytest.approx(TIME, rel=0.3)


def test_white_noise_does_not_last_and_the_file_says_so(tmp_path: Path):
    record, found, lasts = error_of(0.0)
    assert (found, lasts) == (0.0, 0.0)
    error = calibrated(invert(LINE), record)
    file = export_runtime(LINE, tmp_path / "line.json", record.output, error=error).path
    assert load(file).lasting == {"share": 0.0, "time": 0.0}
    plain = export_runtime(LINE, tmp_path / "plain.json", record.output).path
    assert load(plain).lasting is None


CURVE = MonotoneCurve(np.array([0.0, 10.0]), np.array([20.0]))


def runs(count: int, seed: int, spread: float = 0.2) -> Record:
    """Runs of a line whose slope and noise differ from run to run."""
    random = np.random.default_rng(seed)
    u = np.tile(np.append(np.linspace(0, 5, 8), np.linspace(4, 1, 4)), (count, 1))
    slope = 2.0 + spread * random.normal(size=(count, 1))
    y = slope * u + 0.05 * random.normal(size=u.shape)
    return Record.from_arrays(u.ravel(), y.ravel(), groups=np.repeat(np.arange(count), u.shape[1]))


def test_a_run_is_held_where_all_its_rows_are():
    record = runs(30, 1)
    band = guaranteed(invert(CURVE), record, 0.9)
    low, high = band.around(estimate(band.compensator, record))
    inside = (low <= record.input) & (record.input <= high)
    whole = [inside[rows].all() for _, rows in record.sequences()]
    assert sum(whole) == 28  # ceil(31 x 0.9)
    assert "exchangeable with the 30 runs" in band.statement


def test_too_few_runs_cannot_guarantee():
    refuses("too-few-runs", lambda: guaranteed(invert(CURVE), runs(8, 0), 0.9))
    assert guaranteed(invert(CURVE), runs(9, 0), 0.9).runs == 9
    for guarantee, kind in ((1.0, "auto"), (0.5, "row")):
        with raises("bad-option"):
            guaranteed(invert(CURVE), runs(9, 0), guarantee, kind)


@pytest.mark.parametrize("shaped", [False, True])
def test_files_give_the_band(shaped: bool, tmp_path: Path):
    """Python and C give the ends that JAX gives, of constant width and by the deviation."""
    record, later = runs(30, 1), runs(20, 2)
    inner = invert(CURVE)
    error = calibrated(inner, later)
    band = guaranteed(error if shaped else inner, record, 0.9)
    y = record.output[:12]
    low, high = band.around(band.compensator.simulate(None, y))
    options = {"error": error, "band": band}
    sensor = load(export_runtime(CURVE, tmp_path / "it.json", y, **options).path)
    assert type(sensor).__name__ == "Compensator"
    assert sensor.band is not None
    for k, reading in enumerate(y.tolist()):
        sensor.step(0.01, reading)
        np.testing.assert_allclose(sensor.band, (low[k], high[k]), atol=1e-9)
    text = export_c(CURVE, tmp_path / "it.h", y, **options).path.read_text("utf-8")
    assert "it_band(const it_state *s, it_real *low, it_real *high)" in text
    if shaped:
        refuses("not-exportable", lambda: export_runtime(CURVE, tmp_path / "no.json", y, band=band))
