"""The exported step of an oscillator: C99 and plain Python give what the model gives."""

import ctypes
import subprocess

import numpy as np
import pytest

import compensate
from compensate import Status
from compensate.export._export import Program
from hysteresis import (
    BoucWen,
    BoucWenForce,
    DuhemForce,
    GeneralizedPlays,
    InputError,
    Oscillator,
    Sum,
)
from tests.c_harness import COMPILERS, STRICT, Compiled

MIXED = BoucWenForce(alpha=4e4, beta_gamma=700.0, beta_delta=-900.0)
PLAYS = GeneralizedPlays([0.0, 2e-4, 6e-4], [2e-3] * 3, np.linspace(1, -1, 9) * 20, (2, 4, 3))
DUHEM = DuhemForce([7e4, 5e4, 4e4, 3e4, 1e4], [1e4, 3e4, 4e4, 6e4, 7e4], 60.0)
T = np.arange(600) / 750
FORCE = 40 * np.sin(2 * np.pi * (18 * T + 20 * T**2)) + 1.0
SOURCE = """
#include "plant.h"
void run(long n, const double *u, double *y);
int wrong(void);
void run(long n, const double *u, double *y)
{
    plant_state s;
    plant_reset(&s);
    for (long k = 0; k < n; ++k) { y[k] = plant_step(&s, u[k]); }
}
int wrong(void)
{
    plant_state s;
    return plant_self_test(&s);
}
"""
SPRINGS = {"mixed": MIXED, "plays": PLAYS, "both": Sum(DUHEM, PLAYS)}


def plant(name: str) -> Oscillator:
    return Oscillator(1.7, 12.0, 4.5e4, SPRINGS[name], 10)


@pytest.mark.parametrize("name", SPRINGS)
def test_plain_python_steps_as_the_model(name: str, tmp_path):
    model = plant(name)
    file = compensate.export_oscillator(model, tmp_path / "plant.json", 1 / 750, FORCE)
    step = compensate.runtime.load_oscillator(file)
    assert isinstance(step, compensate.runtime.OscillatorStep)
    wanted = model.displacement(T, FORCE)
    for _ in range(2):
        found = [step.step(float(u)) for u in FORCE]
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()
        step.reset()


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
@pytest.mark.parametrize("name", SPRINGS)
def test_c99_steps_as_the_model(name: str, tmp_path):
    model = plant(name)
    compensate.export_oscillator(model, tmp_path / "plant.h", 1 / 750, FORCE, title="a */ title")
    (tmp_path / "run.c").write_text(SOURCE)
    library = tmp_path / "run.so"
    command = [COMPILERS[0], *STRICT, "-O1", "-shared", "-fPIC", "-o", library, tmp_path / "run.c"]
    subprocess.run(command, check=True)
    code = ctypes.CDLL(str(library))
    assert code.wrong() == 0
    found, pointer = np.empty(len(T)), ctypes.POINTER(ctypes.c_double)
    code.run(ctypes.c_long(len(T)), FORCE.ctypes.data_as(pointer), found.ctypes.data_as(pointer))
    wanted = model.displacement(T, FORCE)
    assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
def test_targets_step_as_the_model(tmp_path):
    """What every target is written from: plain Python as the model, C bit for bit as Python; a lost sample
    makes the next step longer."""
    program = Program(plant("both"), FORCE, times=T)
    wanted = plant("both").displacement(T, FORCE)
    step = np.diff(T, prepend=T[0])
    sensor = compensate.runtime.load(program.write_runtime(tmp_path / "it.json").path)
    assert isinstance(sensor, compensate.runtime.Compensator)
    found = [sensor.step(u, dt).value for u, dt in zip(FORCE, step, strict=True)]
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


def test_a_changed_file_is_refused(tmp_path):
    file = compensate.export_oscillator(plant("mixed"), tmp_path / "plant.json", 1 / 750, FORCE)
    file.write_text(file.read_text().replace("1.7", "1.8"))
    with pytest.raises(compensate.runtime.FileError):
        compensate.runtime.load_oscillator(file)


def test_what_has_no_step_in_c_is_refused(tmp_path):
    for model in (
        Oscillator(1.0, 1.0, 1.0, BoucWen(1.0, 0.5, 1.0)),
        Oscillator(1.0, 1.0, 1.0, MIXED, integrator="runge-kutta"),
    ):
        with pytest.raises(InputError) as caught:
            compensate.export_oscillator(model, tmp_path / "plant.h", 1.0, FORCE)
        assert caught.value.code == "not-exportable"
    with pytest.raises(InputError) as caught:
        compensate.export_oscillator(plant("mixed"), tmp_path / "plant.h", 0.0, FORCE)
    assert caught.value.code == "bad-option"
