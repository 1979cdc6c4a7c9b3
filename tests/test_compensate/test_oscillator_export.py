"""The exported step of an oscillator: C99 and plain Python give what the model gives."""

import numpy as np
import pytest

import compensate
from compensate import Status
from compensate.export._export import Program
from hysteresis import (
    BoucWenForce,
    DuhemForce,
    GeneralizedPlays,
    Oscillator,
    Sum,
)
from tests.c_harness import COMPILERS, Compiled

MIXED = BoucWenForce(alpha=4e4, beta_gamma=700.0, beta_delta=-900.0)
PLAYS = GeneralizedPlays([0.0, 2e-4, 6e-4], [2e-3] * 3, np.linspace(1, -1, 9) * 20, (2, 4, 3))
DUHEM = DuhemForce([7e4, 5e4, 4e4, 3e4, 1e4], [1e4, 3e4, 4e4, 6e4, 7e4], 60.0)
T = np.arange(600) / 750
FORCE = 40 * np.sin(2 * np.pi * (18 * T + 20 * T**2)) + 1.0
SPRINGS = {"mixed": MIXED, "plays": PLAYS, "both": Sum(DUHEM, PLAYS)}


def plant(name: str) -> Oscillator:
    return Oscillator(1.7, 12.0, 4.5e4, SPRINGS[name], 10)


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
@pytest.mark.parametrize("name", SPRINGS)
def test_targets_step_as_the_model(name: str, tmp_path):
    """What every target is written from: plain Python as the model, C bit for bit as Python; a lost sample
    makes the next step longer."""
    program = Program(plant(name), FORCE, times=T, title="a */ title")
    wanted = plant(name).displacement(T, FORCE)
    step = np.diff(T, prepend=T[0])
    sensor = compensate.runtime.load(program.write_runtime(tmp_path / "it.json").path)
    assert type(sensor).__name__ == "Compensator"
    found = [sensor.step(*now).value for now in zip(step, FORCE, strict=True)]
    assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()
    it = Compiled(program.write_c(tmp_path / "it.h").path)
    np.testing.assert_array_equal(it.run(step, FORCE)[0], found)
    assert it.wrong == 0
    at = T < 0.3
    straight = np.interp(T[at], T[at][::3], FORCE[at][::3])
    lost = np.where(np.arange(len(straight)) % 3, np.nan, straight)
    value, status, *_ = it.run(step[at], lost)
    whole = it.run(step[at], straight)[0]
    known = status == Status.OK
    assert known.sum() == (len(straight) + 2) // 3
    # Newmark's error with steps three times as long, at 18 to 30 Hz.
    assert np.abs(value - whole)[known].max() < 0.02 * np.abs(whole).max()
