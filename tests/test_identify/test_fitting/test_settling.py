"""What one run shows of its own course explains its rows, and is in no model of the next run."""

from typing import Any

import jax
import numpy as np
import pytest

from hysteresis import AbstractModel, CyclicDrift, Record, TimeDrift
from identify import FitResult, fit

PERIOD = 10.0


def drifting(size: float = 0.3, cycles: int = 12) -> Record:
    """A loop that lags, whose stiffness and zero move with the logarithm of the cycles."""
    t = np.linspace(0, cycles * PERIOD, 50 * cycles + 1)
    u = 5 - 5 * np.cos(2 * np.pi * t / PERIOD)
    moved = size * np.log1p(t / PERIOD) * (0.5 + 0.05 * u)
    y = 0.4 * u + 0.02 * u**2 + 0.3 * np.sin(2 * np.pi * t / PERIOD) + moved
    y += 0.01 * np.random.default_rng(0).normal(size=len(t))
    return Record.from_arrays(u, y, t, input_unit="mm", output_unit="N")


def drifts(model: AbstractModel) -> list[Any]:
    kinds = CyclicDrift | TimeDrift
    parts = jax.tree_util.tree_leaves(model, is_leaf=lambda x: isinstance(x, kinds))
    return [part for part in parts if isinstance(part, kinds)]


@pytest.fixture(scope="module")
def fits() -> dict[str, FitResult]:
    record = drifting()
    return {way: fit(record, "Composition", test_cycles=1, drift=way) for way in ("auto", "keep")}


def test_a_drift_is_in_no_model_of_new_runs_unless_it_is_kept(fits: dict[str, FitResult]):
    assert not drifts(fits["auto"].model)
    assert "drift" not in fits["auto"].name
    (kept,) = drifts(fits["keep"].model)
    assert np.isfinite(kept.most)
    # It stops at its last value: ten runs on, nothing drifts from cycle to cycle.
    u = np.tile(drifting().input[:-1], 10)
    t = 0.2 * np.arange(len(u))
    late = np.asarray(fits["keep"].model.simulate(t, u))[-100:].reshape(2, 50)
    np.testing.assert_allclose(late[0], late[1], atol=1e-6)


def test_the_verdict_tells_the_change_with_its_error(fits: dict[str, FitResult]):
    found = fits["auto"]
    (note,) = [r for r in found.verdict.reasons if getattr(r, "code", "") == "drift"]
    k = np.arange(6, 11)
    true = np.polyfit(k, 0.3 * 0.75 * np.log1p(k + 0.5), 1)[0]
    assert note.values["rate"] == pytest.approx(true, rel=0.15)
    assert note.values["hourly"] == pytest.approx(note.values["rate"] * 3600 / PERIOD, rel=0.03)
    assert 0 < note.values["error"] < 0.3 * true


def test_the_model_is_of_the_last_state(fits: dict[str, FitResult]):
    """The held-out cycle is as far from it as a cycle drifts, and the mean one many times that."""
    found = fits["auto"]
    test, train = found.metrics["test"], found.metrics["train"]
    assert type(found.detail).__name__ == "Composition"
    assert test.rmse < 0.05
    assert train.rmse > 2 * test.rmse
