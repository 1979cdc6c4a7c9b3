"""Exported oscillators and models with conditions: C99 and plain Python give what the model gives."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import compensate
from compensate import Status, export_c, export_runtime, invert
from compensate.export._export import Program
from compensate.export.targets._export_to import write_to
from compensate.runtime import load
from hysteresis import (
    BoucWenForce,
    Conditioned,
    DuhemForce,
    Feedback,
    GeneralizedPlays,
    Oscillator,
    StopsAndPowers,
    Sum,
)
from tests.c_harness import COMPILERS, Compiled
from tests.refusals import refuses
from tests.test_compensate.test_inverses.test_conditioned import model, part, walk
from tests.thorough import rest_thorough

MIXED = BoucWenForce(alpha=4e4, beta_gamma=700.0, beta_delta=-900.0)
PLAYS = GeneralizedPlays([0.0, 2e-4, 6e-4], [2e-3] * 3, np.linspace(1, -1, 9) * 20, (2, 4, 3))
DUHEM = DuhemForce([7e4, 5e4, 4e4, 3e4, 1e4], [1e4, 3e4, 4e4, 6e4, 7e4], 60.0)
T = np.arange(600) / 750
FORCE = 40 * np.sin(2 * np.pi * (18 * T + 20 * T**2)) + 1.0
SPRINGS = {"mixed": MIXED, "plays": PLAYS, "both": Sum(DUHEM, PLAYS)}


def plant(name: str) -> Oscillator:
    return Oscillator(1.7, 12.0, 4.5e4, SPRINGS[name], 10)


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
@pytest.mark.parametrize("name", rest_thorough(SPRINGS, lambda name: name != "plays"))
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
    library = write_to("arduino", program, tmp_path / "it", None).path
    assert "without hysteresis" not in (library / "README.md").read_text()
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


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
def test_channels_between_modes_step_in_c(tmp_path):
    """Two masses, the second one shaken and read, by joints of Bouc-Wen's force with an exponent and of
    stops, whose stiffness follows the level. `simulate` finds the same fixed point window by window."""
    joints = (
        BoucWenForce(2.0, 1.5, 0.5, 1.5),
        StopsAndPowers([0.2, 0.6], [1.0, 0.5], [0.1, 0.2, 0.0]),
    )
    both = Feedback.of_masses([2.0, 1.0], [0.3, 0.3], [5.0, 3.0], joints)
    of_one = both.entries[:, 1:], both.shapes[1:], np.zeros((3, 3))
    model = Feedback(both.poles, *of_one, 0.0, joints, [0.0, 0.3], 20.0)
    dt, force = 0.1, 2 * np.sin(np.arange(400) * 0.13) + np.sin(np.arange(400) * 0.31 + 1)
    path = export_c(model, tmp_path / "it.h", force, times=dt * np.arange(len(force))).path
    it = Compiled(path)
    assert it.wrong == 0
    # Forces that are straight within the steps of both: 16 to a sample in C, one of these in time.
    fine = np.interp(np.arange(16 * 399 + 1) / 16, np.arange(400), force)
    wanted = model.simulate(fine[:, None], dt / 16, finer=1)[::16, 0]
    found, status = it.run(np.full(len(force), dt), force)
    # The windows settle to 1e-9 of the largest reaction, each on top of those before.
    assert np.abs(found - wanted).max() < 1e-8 * wanted.std()
    assert set(status.tolist()) == {int(Status.OK)}
    late = replace(model, delay=0.05)
    refuses("not-exportable", lambda: export_c(late, path, force, times=np.arange(400.0)))


ROWS = 40


def conditioned(sign: float = 1.0, axis: str = "linear") -> Conditioned:
    return replace(model(sign), axis=axis)


def readings(one: Conditioned) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs, and pairs of reading and condition, two of which are beyond the knots."""
    u, c = walk(ROWS)
    c[[5, 30]] = 5.0, 60.0
    y = np.asarray(one.simulate(None, np.column_stack([u, c])))
    return u, y, c


@pytest.mark.parametrize(
    ("sign", "axis"), rest_thorough([(1.0, "logarithmic"), (-1.0, "reciprocal")], 1)
)
def test_python_and_c_are_the_same(sign: float, axis: str, tmp_path: Path):
    one = conditioned(sign, axis)
    u, y, c = readings(one)
    wanted = invert(one).simulate(None, np.column_stack([y, c]))
    pairs = np.column_stack([y, c])
    compensator = load(export_runtime(one, tmp_path / "it.json", pairs).path)
    rows = zip(y.tolist(), c.tolist(), strict=True)
    found = [compensator.step(0.01, a, b) for a, b in rows]
    np.testing.assert_allclose([each.value for each in found], wanted.value, atol=1e-9 * np.ptp(u))
    np.testing.assert_array_equal([int(each.status) for each in found], wanted.status)
    assert [int(s) for s in wanted.status[np.array([5, 30])]] == [Status.EXTRAPOLATED] * 2
    if not COMPILERS:
        pytest.skip("no C compiler")
    for real, tolerance in (("double", 1e-9), ("float", 1e-4)):
        path = export_c(one, tmp_path / f"{real}_it.h", pairs, real=real).path
        it = Compiled(path, COMPILERS[0])
        value, status = it.run(np.zeros(ROWS), y, c)
        again = one.simulate(None, np.column_stack([value, c]))
        np.testing.assert_allclose(again, y, atol=tolerance * float(np.ptp(y)))
        np.testing.assert_allclose(it.predict(np.zeros(ROWS), u, c), y, atol=tolerance * np.ptp(y))
        assert it.wrong == 0
        assert f"State: {it.size} bytes" in it.text
        assert "condition: temperature in degC" in it.text
        if real == "double":
            np.testing.assert_array_equal(status, wanted.status)


def test_a_step_without_the_condition_is_refused_and_a_bad_one_leaves_no_trace(tmp_path: Path):
    u, y, c = readings(conditioned())
    compensator = load(export_runtime(model(), tmp_path / "it.json", np.column_stack([y, c])).path)
    assert compensator.condition["name"] == "temperature"
    with pytest.raises(TypeError, match="temperature"):
        compensator.step(0.01, float(y[0]))
    before = compensator.step(0.01, float(y[0]), float(c[0]))
    bad = compensator.step(0.01, float(y[1]), float("nan"))
    assert (bad.value, bad.status) == (before.value, Status.INVALID)
    assert compensator.step(0.01, float(y[1]), float(c[1])).value == pytest.approx(u[1], abs=1e-7)
    refuses("wrong-shape", lambda: export_runtime(model(), tmp_path / "other.json", y))


def test_a_strange_condition_counts_in_the_run_in_of_a_file_as_in_python(tmp_path: Path):
    one = Conditioned((part(1.0, 3.0), part(2.0, 2.0)), [10.0, 50.0])
    u, c = walk(400)
    y = np.asarray(one.simulate(None, np.column_stack([u, c])))
    c[2:30] = 60.0
    options = {"trained": (-1.0, 2.0), "start": "unknown"}
    wanted = invert(one, **options).simulate(None, np.column_stack([y, c])).status
    file = export_runtime(one, tmp_path / "it.json", np.column_stack([y, c]), **options).path
    step = load(file).step
    found = [step(0.01, *pair).status for pair in zip(y.tolist(), c.tolist(), strict=True)]
    np.testing.assert_array_equal([int(each) for each in found], wanted)
