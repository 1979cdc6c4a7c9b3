"""A deviation that knows its motion: as it was learnt, and wider where reversals or speed are others."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compensate import Status, calibrated, export_c, export_runtime, invert
from compensate.internal import CalibratedCompensator
from compensate.runtime import load
from hysteresis import Preisach, Record
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
