"""Exported compensators, in Python and in C, are the JAX one, and finite on what a broken sensor gives."""

import copy
import json
import pickle
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from compensate import Status, calibrated, export_c, export_runtime, export_to, invert
from compensate.export._export import Program
from compensate.runtime import FileError, load
from hysteresis import (
    AbstractModel,
    BoucWen,
    Burgers,
    CyclicDrift,
    DegradingBoucWen,
    LinearSponge,
    MonotoneCurve,
    Preisach,
    Record,
    Sum,
    TimeDrift,
)  # fmt: skip
from hysteresis.preisach import GaussianDensity, GridDensity
from tests.c_harness import COMPILERS, STRICT, Compiled, checksum, ran
from tests.problems import (
    INVERTIBLE,
    Problem,
    kinds_often,
    random_histories,
    variants_thorough,
    weights,
)
from tests.refusals import raises, refuses
from tests.thorough import rest_thorough

ROWS = 200
"""As many as the golden pair has, so that exports compile no other program."""
OF_LONG_STEPS = {"degrading-bouc-wen": 60}
"""Rows of a model whose step takes Python 4 ms, twenty times that of any other."""
every = pytest.mark.parametrize("problem", variants_thorough(INVERTIBLE))
DEPTH, GOLDEN = 128, 200


class Run(NamedTuple):
    """A model, a history with its outputs, and what the JAX compensator makes of them."""

    model: AbstractModel
    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    value: np.ndarray
    status: np.ndarray
    program: Program

    @property
    def dt(self) -> np.ndarray:
        return np.diff(self.t, prepend=self.t[0])


@cache
def run(problem: Problem) -> Run:
    model, rows = problem.model(), OF_LONG_STEPS.get(problem.name, ROWS)
    u = random_histories(np.random.default_rng(0), problem.low, problem.high, (1, 240))[0, :rows]
    step = 10.0 ** np.random.default_rng(1).uniform(-2, 0.5, rows)
    if isinstance(model, Burgers) and model.hold == "constant":
        step = np.minimum(step, 0.9 * model.largest_stable_step())
    t = np.cumsum(step)
    y = np.asarray(model.simulate(t, u))
    value, status = invert(model).simulate(t, y)
    program = Program(model, y, times=t, depth=DEPTH)
    assert program.notes == ()
    return Run(model, t, u, y, np.asarray(value), np.asarray(status), program)


def stepped(compensator: Any, dt: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
    found = [compensator.step(b, a) for a, b in zip(y, dt, strict=True)]
    return np.array([e.value for e in found]), np.array([int(e.status) for e in found])


def exported(run: Run, folder: Path) -> Any:
    return load(run.program.write_runtime(folder / "it.json").path)


@every
def test_python_is_the_same(problem: Problem, tmp_path: Path):
    """To 1e-9 of the range; statuses too. One signature, and a call without a reading says so."""
    done = run(problem)
    compensator = exported(done, tmp_path)
    value, status = stepped(compensator, done.dt.tolist(), done.y.tolist())
    assert np.abs(value - done.value).max() <= 1e-9 * np.ptp(done.u)
    np.testing.assert_array_equal(status, done.status)
    assert compensator.rates == ("rates" in problem.tags)
    with pytest.raises(TypeError, match=r"step\(dt, reading\)"):
        compensator.step(float(done.y[0]))


@pytest.mark.parametrize("problem", INVERTIBLE[::7], ids=lambda p: p.name)
def test_copies_go_on_by_themselves(problem: Problem, tmp_path: Path):
    """From the state of the original, which they leave as it is: other processes get them pickled."""
    done = run(problem)
    it, half = exported(done, tmp_path), len(done.y) // 2
    stepped(it, done.dt[:half], done.y[:half])
    before = json.dumps(it.state())
    copies = pickle.loads(pickle.dumps(it)), copy.deepcopy(it), copy.copy(it)
    rest = [stepped(one, done.dt[half:], done.y[half:]) for one in copies]
    assert json.dumps(it.state()) == before
    same = stepped(it, done.dt[half:], done.y[half:])
    assert all(np.array_equal(pair, same, equal_nan=True) for pair in rest)


def test_readings_at_the_end_of_a_flat_place_do_not_damage_a_file(tmp_path: Path):
    """Rounding decides there which end of it is the estimate; the golden readings keep away from it."""
    problem = next(p for p in INVERTIBLE if p.name == "preisach-sparse")
    model = problem.model()
    u = random_histories(np.random.default_rng(3), problem.low, problem.high, (1, ROWS))[0]
    y = np.asarray(model.simulate(None, u))
    export_runtime(model, tmp_path / "it.json", y)
    load(tmp_path / "it.json")


@every
@pytest.mark.parametrize("real", rest_thorough(["float", "double"], 1))
@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
def test_c_is_the_same(problem: Problem, real: str, tmp_path: Path):
    """Double: to 1e-9 of the range, statuses too. Float: the model gives the readings back to 1e-4; in u it
    is off by more where the output hardly changes."""
    done, path = run(problem), tmp_path / "it.h"
    done.program.write_c(path, real)
    for compiler in COMPILERS if real == "double" else COMPILERS[:1]:
        it = Compiled(path, compiler)
        value, status = it.run(done.dt, done.y)
        if real == "double":
            assert np.abs(value - done.value).max() <= 1e-9 * np.ptp(done.u)
            np.testing.assert_array_equal(status, done.status)
        again = np.asarray(done.model.simulate(done.t, value))
        assert np.abs(again - done.y).max() <= (1e-4 if real == "float" else 1e-9) * np.ptp(done.y)
        forward = it.predict(done.dt, done.u)
        assert np.abs(forward - done.y).max() <= (1e-4 if real == "float" else 1e-9) * np.ptp(
            done.y
        )
        assert it.wrong == 0
        assert f"State: {it.size} bytes" in it.text


@pytest.mark.parametrize("problem", kinds_often(INVERTIBLE))
def test_bad_samples_leave_no_trace(problem: Problem, tmp_path: Path):
    """NaN and infinities: the estimates of the others are those of a record without them."""
    done = run(problem)
    compensator = exported(done, tmp_path)
    random = np.random.default_rng(5)
    bad = random.random(len(done.y)) < 0.1
    y = np.where(bad, random.choice([np.nan, np.inf, -np.inf], len(bad)), done.y)
    value, status = stepped(compensator, done.dt.tolist(), y.tolist())
    np.testing.assert_array_equal(status == Status.INVALID, bad)
    assert np.isfinite(value).all()
    compensator.reset()
    t = done.t[~bad]
    alone, _ = stepped(compensator, np.diff(t, prepend=t[0]).tolist(), y[~bad].tolist())
    np.testing.assert_allclose(value[~bad], alone, rtol=0, atol=1e-12 * np.ptp(done.u))
    # Readings of single precision do not make what is remembered single.
    dt, single = done.dt.astype(np.float32), done.y.astype(np.float32)
    each = []
    for both in ((dt, single), (dt.astype(float).tolist(), single.astype(float).tolist())):
        compensator.reset()
        each.append(stepped(compensator, *both)[0])
    np.testing.assert_array_equal(*each)


def relays(depth: int = 64, rows: int = 400) -> tuple[Preisach, np.ndarray]:
    model = Preisach(GridDensity(0.0, 1.0, weights(np.random.default_rng(0))), initial="negative")
    swing = np.linspace(1.0, 0.0, rows) * np.where(np.arange(rows) % 2, 1.0, -1.0)
    return model, np.asarray(model.simulate(None, 0.5 + 0.5 * swing))


def test_the_deviation_is_the_calibrated_one(tmp_path: Path):
    """By level and branch, held where a reading is none; NaN where none was learnt."""
    model, random = LinearSponge(2.0, 1.0), np.random.default_rng(0)
    u = 10 + 8 * np.sin(np.linspace(0, 30, 300))
    rising = np.gradient(u) > 0
    noise = np.where(rising, 0.2, 0.8) * u / 10 * random.normal(size=300)
    y = np.asarray(model.simulate(None, u)) + noise
    error = calibrated(invert(model), Record.from_arrays(u, y))
    wanted = np.asarray(error.simulate(None, y).deviation)
    assert np.ptp(wanted) > 0.2 * wanted.mean()
    export_runtime(model, tmp_path / "it.json", y, error=error)
    compensator = load(tmp_path / "it.json")
    found = [compensator.step(0.01, reading).deviation for reading in y.tolist()]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    assert compensator.step(0.01, float("nan")).deviation == found[-1]
    export_c(model, tmp_path / "it.h", y, error=error)
    if COMPILERS:
        _, _, off = Compiled(tmp_path / "it.h", COMPILERS[0]).run_with_deviation(np.zeros(300), y)
        np.testing.assert_allclose(off, wanted, rtol=1e-12)
    export_runtime(model, tmp_path / "it.json", y)
    assert np.isnan(load(tmp_path / "it.json").step(0.01, 10.0).deviation)


def test_a_stack_too_small_for_the_readings_says_so(tmp_path: Path):
    """An alternation that decays opens a loop at every turn."""
    model, y = relays(rows=100)
    (note,) = export_c(model, tmp_path / "it.h", y, depth=16).notes
    assert "keeps 16" in note
    needed = int(note.rsplit("depth of ")[1].split()[0])
    assert 60 < needed <= 100
    assert export_c(model, tmp_path / "it.h", y, depth=needed).notes == ()


@pytest.mark.skipif("gcc" not in COMPILERS, reason="no gcc")
def test_sanitizers_find_nothing(tmp_path: Path):
    """Of a composition, fed with numbers of any kind: no undefined behaviour, no byte out of place."""
    model, y = relays()
    export_c(Sum([model, LinearSponge(0.5, 0.0)]), tmp_path / "it.h", y, depth=8)
    (tmp_path / "fuzz.c").write_text(FUZZ, "utf-8")
    flags = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    ran("gcc", *STRICT, *flags, tmp_path / "fuzz.c", "-o", tmp_path / "fuzz", "-lm")
    assert ran(tmp_path / "fuzz").stderr == ""


FUZZ = """\
#include "it.h"

static unsigned long long state = 1;

static double next(void)
{
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    unsigned kind = (unsigned)(state >> 60);
    double x = (double)(state >> 11) / 9007199254740992.0;
    switch (kind) {
    case 0: return 1e300 * (x - 0.5);
    case 1: return (double)NAN;
    case 2: return (double)INFINITY;
    default: return 8.0 * (x - 0.5);
    }
}

int main(void)
{
    it_state s;
    it_reset(&s);
    for (long k = 0; k < 100000; ++k) {
        double u;
        int status = it_step(&s, 0.01, next(), &u, 0);
        if (!isfinite(u) || status < IT_OK || status > IT_INVALID) {
            return 1;
        }
    }
    return 0;
}
"""


def test_import_is_light():
    """Neither JAX nor NumPy nor SciPy."""
    code = "import sys, compensate.runtime; print({'jax', 'numpy', 'scipy'} & set(sys.modules))"
    assert ran(sys.executable, "-c", code).stdout == "set()\n"


def edited(**changes: Any) -> Any:
    return lambda text: json.dumps(json.loads(text) | changes)


@pytest.mark.parametrize(("spoil", "words"), [
    (lambda text: text[: len(text) // 2], "not whole"),
    (lambda text: "[1, 2]", "not a compensator"), (edited(schema=99), "format 99"),
    (edited(schema=True), "format True"), (edited(kind=[]), "not a compensator"),
    (edited(limits=[0.0, 0.5]), "checksum"),
])  # fmt: skip
def test_files_that_cannot_be_trusted_are_refused(spoil: Any, words: str, tmp_path: Path):
    model, y = relays()
    path = tmp_path / "it.json"
    export_runtime(model, path, y, depth=DEPTH * 4)
    path.write_text(spoil(path.read_text()))
    with pytest.raises(FileError, match=words):
        load(path)
    with pytest.raises(FileError, match="No such file"):
        load(tmp_path / "none.json")


@pytest.mark.parametrize(("change", "words"), [
    (lambda d: d.pop("limits"), "limits is missing"),
    (lambda d: d.update(rates="no"), "rates is 'no'"),
    (lambda d: d["reading"].update(unit=1), "reading.unit is 1"),
    (lambda d: d["golden"].update(dt="x"), "golden.dt is 'x'"),
    (lambda d: next(iter(_nodes(d)))["parameters"].popitem(), "is missing"),
    (lambda d: next(iter(_nodes(d)))["state"].update(status=[]), "state.status is "),
])  # fmt: skip
def test_an_entry_of_another_type_is_named(change: Any, words: str, tmp_path: Path):
    model, y = relays()
    path = tmp_path / "it.json"
    export_runtime(model, path, y, depth=DEPTH * 4)
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document | {"checksum": checksum(document)}))
    with pytest.raises(FileError, match=words):
        load(path)


def _nodes(document: Any) -> Any:
    trees = [document["tree"]]
    while trees:
        one = trees.pop()
        if "parameters" in one:
            yield one
        trees += one.get("parts", [])


def test_a_density_is_tabulated_and_its_error_told(tmp_path: Path):
    """A note says how far outputs are off: the readings come back as closely. Its own cells are kept."""
    model = Preisach(GaussianDensity(-1.0, 2.0, 1.0, 0.3, 0.3, 0.3, 0.5), np.full(5, 0.1))
    u = random_histories(np.random.default_rng(0), -1.0, 2.0, (1, ROWS))[0]
    y = np.asarray(model.simulate(None, u))
    done = export_runtime(model, tmp_path / "it.json", y, depth=DEPTH)
    (note,) = done.notes
    told = float(note.rsplit("at most ")[1].split()[0]) / 100
    assert 0 < told < 5e-4
    compensator = load(done.path)
    again = np.asarray(model.simulate(None, [compensator.step(0.01, x).value for x in y.tolist()]))
    assert np.abs(again - y)[:GOLDEN].max() <= 1.1 * told * np.ptp(y[:GOLDEN])
    own = Preisach(GridDensity(-1.0, 2.0, np.tril(np.ones((5, 5)))), np.full(5, 0.1))
    y = np.asarray(own.simulate(None, u))
    done = export_runtime(own, tmp_path / "own.json", y, depth=DEPTH)
    assert done.notes == ()
    found = [load(done.path).step(0.01, float(y[0])).value]
    np.testing.assert_allclose(found, u[:1], atol=1e-12)


def test_what_cannot_be_exported_is_refused(tmp_path: Path):
    model, y = relays()
    for name in ("3 d", "math", "String"):
        refuses("bad-name", lambda name=name: export_c(model, tmp_path / f"{name}.h", y))
    taken = (("mujoco", "mujoco"), ("mujoco", "class"), ("ros2", "math"), ("sklearn", "json"))
    for target, name in taken:
        out = tmp_path / name
        refuses("bad-name", lambda to=target, out=out: export_to(to, model, out, y))
    refuses("bad-option", lambda: export_c(model, tmp_path / "it.h", y, real="half"))
    refuses("no-rows", lambda: export_c(model, tmp_path / "it.h", [np.nan, 1.0]))
    refuses("no-time", lambda: export_c(Burgers(1.0, 1.0, 1.0, 1.0), tmp_path / "it.h", y))
    with raises("bad-option"):
        demagnetised = Preisach(model.density, initial="demagnetised")
        export_c(demagnetised, tmp_path / "it.h", y, depth=8)
    with raises("not-invertible"):
        worn = DegradingBoucWen(BoucWen(1.0, 0.1, 1.0), strength_loss=0.2)
        export_c(worn, tmp_path / "it.h", y)
    assert not list(tmp_path.iterdir())


def test_an_export_keeps_what_its_first_readings_need(tmp_path: Path):
    """A demagnetised grid of 40 cells begins with 64 reversals, and turns once more."""
    density = GridDensity(-2.0, 2.0, np.tril(np.ones((40, 40))))
    model = Preisach(density, initial="demagnetised")
    y = np.asarray(model.simulate(None, [0.003, 0.112, 0.25, 0.4]))
    assert export_runtime(model, tmp_path / "it.json", y).notes == ()
    with raises("bad-option", "need 65 stored reversals"):
        export_runtime(model, tmp_path / "it.json", y, depth=64)


def test_drifts_of_long_runs_in_float_are_those_in_double(tmp_path: Path):
    """Of two million steps: the sum of the steps is rounded as one number, not once a step."""
    cycles = CyclicDrift(0.0, 1.0, [0.0], [1.0], length=100.0)
    line = MonotoneCurve.even(0.0, 1.0, [0.5, 0.5], 0.0)
    model = Sum([line, TimeDrift([2000.0], [10.0]), cycles])
    rows = np.arange(2_000_000)
    u = 0.5 + (rows % 2) / 1024
    golden = {"times": 0.001 * rows[:50], "limits": (-20.0, 20.0)}
    y = np.asarray(model.simulate(golden["times"], u[:50]))
    done = Compiled(export_c(model, tmp_path / "long.h", y, real="float", **golden).path)
    got = done.predict(np.full(len(u), 0.001), u)
    drift = 10 * -np.expm1(-0.001 * rows / 2000.0) + np.log1p(np.maximum(rows - 1, 0) / 102_400)
    # Near 7 the last digit of a float is 5e-7, and four terms are added.
    np.testing.assert_allclose(got, u + drift, atol=4e-6)


HUGE = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200)
CLOCKS = (np.nan, np.inf, -np.inf, 1e308, 1e150, -1.0, 0.0, 1e12)
FEW = 60


def hostile(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Readings and clocks that no sensor means."""
    random = np.random.default_rng(7)
    return random.choice(HUGE, rows), random.choice(CLOCKS, rows)


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
@pytest.mark.parametrize("real", rest_thorough(["float", "double"], 1))
@pytest.mark.parametrize("problem", rest_thorough(INVERTIBLE[::5], 3))
def test_c_is_finite_whatever_it_is_fed(problem: Problem, real: str, tmp_path: Path):
    """Estimates, predictions and deviations, on one state; good samples are finite afterwards."""
    done, path = run(problem), tmp_path / "it.h"
    done.program.write_c(path, real)
    it = Compiled(path, COMPILERS[0], ("-O1",))
    y, dt = hostile(FEW)
    value, status = it.run(np.append(dt, done.dt[:FEW]), np.append(y, done.y[:FEW]))
    assert np.isfinite(value[1:]).all()
    assert (status[FEW:] != Status.INVALID).all()
    if "double it_predict(" in it.text.replace("it_real", "double"):
        u = np.append(y, done.u[:FEW])
        back = it.predict(np.append(dt, done.dt[:FEW]), u)
        limit = np.finfo(real if real == "double" else "f4").max
        assert np.array_equal(np.isnan(back), ~(np.abs(u) <= limit))


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
def test_a_long_pause_is_held_and_said(tmp_path: Path):
    """In C and in Python alike: the longest time is named, one beyond it is taken for it."""
    model, t = Burgers(2.0, 40.0, 1.0, 5.0), np.linspace(0, 10, 200)
    y = np.asarray(model.simulate(t, np.sin(t)))
    export_runtime(model, tmp_path / "it.json", y, times=t)
    export_c(model, tmp_path / "it.h", y, times=t)
    c, it = Compiled(tmp_path / "it.h", COMPILERS[0]), load(tmp_path / "it.json")
    assert it.longest == 10_000.0
    assert "at most 10000;" in c.text
    for pause in (9_999.0, 10_000.0, 1e300, np.inf):
        dt = np.append(np.full(20, 0.05), [pause, *[0.05] * 20])
        it.reset()
        found = [it.step(b, a) for a, b in zip(y[:41].tolist(), dt.tolist(), strict=True)]
        value, status = c.run(dt, y[:41])
        np.testing.assert_allclose(value, [e.value for e in found], rtol=1e-9, atol=1e-9)
        assert status.tolist() == [int(e.status) for e in found]
        late = np.flatnonzero(status == Status.EXTRAPOLATED).tolist()
        assert late == ([] if pause < 10_000 else [20])


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
def test_what_is_right_to_1e_4_is_not_flat_in_float(tmp_path):
    """Right behind a reversal the branch rises by a thirtieth of what the loop does."""
    masses = np.tril(np.random.default_rng(0).uniform(0.1, 1.0, (20, 20)))
    relays = Preisach(GridDensity(0.0, 1.0, masses / masses.sum()))
    model = Sum([relays, LinearSponge(K=0.05, b=0.0, threshold=-1.0)])
    u = np.interp(np.arange(600), [0, 150, 300, 420, 500, 600], [0.02, 0.95, 0.1, 0.7, 0.3, 0.9])
    y = np.asarray(model.simulate(None, u))
    single = Compiled(export_c(model, tmp_path / "it.h", y, real="float").path)
    found, status = single.run(np.zeros(600), y)
    assert np.abs(found - u)[1:].max() < 1e-4
    assert not np.any(status == Status.FLAT)


@pytest.mark.skipif(not COMPILERS, reason="no C compiler")
def test_a_record_that_begins_at_rest_passes_its_own_test_in_float(tmp_path):
    """Its first readings move by 1e-4 of the trained range, which float tells to 1e-6."""
    model = Sum([MonotoneCurve.even(0.0, 1.0, [0.5, 0.5], 1.0), LinearSponge(0.5, 0.0, -1.0)])
    u = 0.5 + 1e-4 * np.random.default_rng(0).uniform(size=60)
    y = np.asarray(model.simulate(None, u))
    single = export_c(model, tmp_path / "it.h", y, real="float", trained=(0.0, 1.0), limits=(0, 4))
    assert Compiled(single.path).wrong == 0
