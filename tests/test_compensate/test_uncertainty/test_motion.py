"""Deviations that know their motion, and intervals of the input where the output is flat."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import Status, calibrated, export_c, export_runtime, flat_intervals, invert, qualify
from compensate.internal import CalibratedCompensator
from compensate.runtime import load
from hysteresis import AbstractModel, Preisach, Record
from hysteresis.preisach import GridDensity
from tests.c_harness import COMPILERS, Compiled
from tests.thorough import rest_thorough

RANDOM = np.random.default_rng(4)
RELAYS = Preisach(GridDensity(0.0, 10.0, np.tri(8)), 4.0 * np.ones(8))
DT = 0.05


def motion(*turns: float, speed: float = 5.0) -> np.ndarray:
    """Straight from turn to turn at a speed."""
    ends = np.cumsum([0.0, *np.abs(np.diff(turns)) / speed])
    return np.interp(np.arange(0, ends[-1] + DT / 2, DT), ends, turns)


def record(u: np.ndarray, noise: float = 0.02) -> Record:
    y = np.asarray(RELAYS.simulate(None, u)) + noise * RANDOM.normal(size=len(u))
    return Record.from_arrays(u, y, dt=DT)


CYCLES = motion(*[0.0, 10.0] * 6, 0.0)
OTHERS = {
    "the same": CYCLES,
    "small loops": motion(0.0, 6.0, 4.0, 6.0, 4.0, 6.0, 4.0, 6.0),
    "lower peaks": motion(0.0, 4.0, 0.0, 5.0, 0.0, 4.0, 0.0),
    "eight times as fast": motion(*[0.0, 10.0] * 8, 0.0, speed=40.0),
}


@pytest.fixture(scope="module")
def band() -> CalibratedCompensator:
    """Learnt on equal cycles at one speed."""
    return calibrated(invert(RELAYS), record(CYCLES))


def widening(band: CalibratedCompensator, u: np.ndarray) -> np.ndarray:
    """The deviation over that of a band which is the same on every motion."""
    t, y = DT * np.arange(len(u)), RELAYS.simulate(None, u)
    plain = CalibratedCompensator(band.inner, band.levels, band.error, band.scores, band.width)
    return np.asarray(band.simulate(t, y).deviation) / np.asarray(plain.simulate(t, y).deviation)


def test_it_is_wider_on_other_motions_and_as_it_was_on_the_same(band: CalibratedCompensator):
    assert np.quantile(widening(band, CYCLES), 0.9) < 1.1
    for name in ("small loops", "lower peaks", "eight times as fast"):
        later = widening(band, OTHERS[name])[len(OTHERS[name]) // 2 :]
        assert np.median(later) > 1.5, name


@pytest.mark.parametrize("name", rest_thorough(list(OTHERS)[1:], 1))
def test_stream_batch_file_and_c_agree(band: CalibratedCompensator, name: str, tmp_path: Path):
    u = OTHERS[name]
    t, y = DT * np.arange(len(u)), np.asarray(RELAYS.simulate(None, u))
    y = np.where(np.arange(len(y)) % 17 == 5, np.nan, y)
    whole = np.asarray(band.simulate(t, y).deviation)
    half, step = len(u) // 2, jax.jit(lambda s, t, y: band.step(s, t, y))
    state: Any = band.init()
    for k in range(half):
        state, found = step(state, jnp.asarray(t[k]), jnp.asarray(y[k]))
        assert float(found.deviation) == pytest.approx(whole[k], rel=1e-9)
        assert (found.status == Status.INVALID) == np.isnan(y[k])
    rest = band.simulate(t[half:], y[half:], state).deviation
    np.testing.assert_allclose(rest, whole[half:], rtol=1e-9)

    readings, dt = np.nan_to_num(RELAYS.simulate(None, CYCLES)), np.diff(t, prepend=t[0])
    options: dict[str, Any] = {"error": band, "times": DT * np.arange(len(CYCLES))}
    runtime = load(export_runtime(RELAYS, tmp_path / "it.json", readings, **options).path)
    found = [runtime.step(float(a), float(b)).deviation for a, b in zip(dt, y, strict=True)]
    np.testing.assert_array_equal(found, whole)
    if COMPILERS:
        header = export_c(RELAYS, tmp_path / "it.h", readings, **options).path
        _, _, off = Compiled(header, COMPILERS[0]).run_with_deviation(dt, y)
        np.testing.assert_allclose(off, found, rtol=1e-12)
        said = header.read_text()
        assert "turned down at 10 to 10 and up at 0 to 0, in strokes of a mean speed from" in said


def relays() -> AbstractModel:
    """Inputs of 0 to 10: relays switch up in [5, 6] and [7, 8], down in [5, 6] and [2, 3]."""
    weights = np.zeros((10, 10))
    weights[5, 5] = weights[7, 2] = 1.0
    return Preisach(GridDensity(0.0, 10.0, weights))


def open_inputs(u: np.ndarray) -> tuple[np.ndarray, Any]:
    model = relays()
    found = invert(model).simulate(None, model.simulate(None, u))
    flat = found.status == Status.FLAT
    return np.asarray(flat), flat_intervals(model, None, found.value, 0.0, 10.0, flat)


@given(st.lists(st.floats(0, 10), min_size=1, max_size=12))
@settings(max_examples=10)
def test_the_input_is_within_the_interval_where_flat(stops: list[float]):
    u = np.resize(stops, 12)
    flat, interval = open_inputs(u)
    low, high = np.asarray(interval.low), np.asarray(interval.high)
    # 1e-6: where the output starts with the square of the input, 1e-12 of it is a millionth.
    assert (u[flat] >= low[flat] - 1e-5).all()
    assert (u[flat] <= high[flat] + 1e-5).all()
    assert (np.asarray(interval.width)[~flat] == 0).all()


def test_intervals_of_known_relays():
    _, interval = open_inputs(np.array([1.0, 6.5, 9.0, 4.0, 1.0]))
    # No relay is up; the first one is; both are; the second alone; none, the way down from 5.
    assert np.asarray(interval.low) == pytest.approx(np.array([0.0, 6.0, 8.0, 3.0, 0.0]), abs=1e-5)
    np.testing.assert_allclose(interval.high, [5.0, 7.0, 10.0, 5.0, 2.0], atol=1e-5)


def test_a_verdict_tells_the_widest():
    u = np.array([0.0, 4.0, 6.5, 9.0, 6.5, 4.0, 1.0, 0.0])
    record = Record.from_arrays(u, np.asarray(relays().simulate(None, u)), input_unit="N")
    found = qualify(invert(relays()), record, relays())
    assert found.flat_width == pytest.approx(5.0, abs=1e-4)
    assert "up to 5 N are open" in " ".join(found.reasons)
