"""Butterfly loops: what an output that is even in a hysteretic state unfolds into, and fits of it."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks._other_rigs import RIGS, motion, record_of
from compensate import invert
from hysteresis import InputError, Record
from identify import FitResult, fit, load, sample, save
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
    with pytest.raises(InputError, match="nothing-fits"):
        fit(record, "Butterfly", test_cycles=1)


@pytest.fixture(scope="module", params=rest_thorough(["magnetostriction", "piezo strain"], 1))
def found(request: pytest.FixtureRequest) -> FitResult:
    """At amplitudes of which some were trained and some not."""
    rig = RIGS[request.param]
    return fit(record_of(rig), "Composition,Butterfly", test_cycles=rig.tested)


def test_a_rig_is_predicted_better_than_by_the_best_baseline(found: FitResult):
    assert found.name == "Butterfly"
    test = found.metrics["test"]
    assert test.rmse < 0.4 * min(baseline.judged[0] for baseline in found.baselines)
    assert found.verdict.level != "FAIL"


def test_it_comes_back_from_its_folder(found: FitResult, tmp_path: Path):
    again = load(save(found, tmp_path / "fit"))
    assert type(again.detail).__name__ == "FoldedState"
    np.testing.assert_array_equal(again.predict(found.train), found.predict(found.train))


def test_what_has_two_inputs_has_no_inverse_and_no_posterior(found: FitResult):
    with pytest.raises(InputError, match="not-invertible"):
        invert(found.model)
    with pytest.raises(InputError, match="no-posterior"):
        sample(found, steps=20)
