"""Fits of butterfly loops, of loops that settle, and of foam curves."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from benchmarks._other_rigs import RIGS, motion, record_of
from compensate import Status, invert
from hysteresis import AbstractModel, CyclicDrift, Record, TimeDrift, read_csv
from identify import FitResult, fit, load, sample, save
from tests.refusals import refuses
from tests.thorough import rest_thorough


def tanh_of_play(u: np.ndarray) -> np.ndarray:
    """A state that lags its input, between -1 and 1."""
    play, found = 0.0, []
    for x in u:
        play = np.clip(play, x - 0.3, x + 0.3)
        found.append(np.tanh(3 * play))
    return np.array(found)


U = motion(RIGS["magnetostriction"])
STATE = tanh_of_play(U)


@pytest.mark.parametrize(
    "y", [STATE, -STATE, np.sin(40 * U) / 100 + STATE, U, np.abs(U) * 0.0 + U**3]
)
def test_loops_without_valleys_are_no_butterflies(y: np.ndarray):
    record = Record.from_arrays(U, y)
    refuses("nothing-fits", lambda: fit(record, "Butterfly", test_cycles=1))


@pytest.fixture(scope="module", params=rest_thorough(["magnetostriction", "piezo strain"], 1))
def found(request: pytest.FixtureRequest) -> FitResult:
    """At amplitudes of which some were trained and some not."""
    rig = RIGS[request.param]
    return fit(record_of(rig), "Composition,Butterfly", test_cycles=rig.tested)


def test_a_rig_is_predicted_better_than_by_the_best_baseline(found: FitResult):
    assert found.name == "Butterfly"
    test = found.metrics["test"]
    assert test.rmse < 0.25 * min(baseline.judged[0] for baseline in found.baselines)
    assert found.verdict.level != "FAIL"


def test_it_comes_back_from_its_folder(found: FitResult, tmp_path: Path):
    again = load(save(found, tmp_path / "fit"))
    assert type(again.detail).__name__ == "FoldedState"
    np.testing.assert_array_equal(again.predict(found.train), found.predict(found.train))


def test_what_has_two_inputs_has_no_inverse_and_no_posterior(found: FitResult):
    refuses("not-invertible", lambda: invert(found.model))
    refuses("no-posterior", lambda: sample(found, steps=20))


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


def test_every_candidate_predicts_what_its_model_does(fits: dict[str, FitResult]):
    """Candidates read one memory of the input together, their models each its own."""
    for one in fits["auto"].candidates:
        alone = one.model.simulate(one.train.time, one.train.input)
        np.testing.assert_allclose(one.predict(one.train), alone, atol=1e-9)


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


SPONGE = Path(__file__).resolve().parents[3] / "datasets" / "sponge-50mm-cycles.csv"


def test_loading_branch_of_the_virtual_sponge():
    """The first of five cycles is another curve, and left out."""
    record = read_csv(SPONGE, input="displacement (mm)", output="force (N)")
    result = fit(record.select(branch="loading"), "FoamCurve", noise="gaussian", starts=6)
    assert result.metrics["train"].nrmse_percent < 0.5
    found = invert(result.model).simulate(None, record.output)
    assert np.all(found.status == Status.OK)
