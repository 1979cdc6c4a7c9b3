"""Guards: estimates stay within the trained inputs, the same in JAX, Python and C; run-in is told."""

import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from compensate import Status, calibrated, export_c, export_runtime, invert
from compensate.export._export import Origin
from compensate.runtime import load
from hysteresis import (
    AbstractModel,
    Burgers,
    GeneralizedMaxwell,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    Record,
    Sum,
)
from hysteresis.preisach import GridDensity
from tests.c_harness import COMPILERS, Compiled, checksum
from tests.problems import PROBLEMS, random_histories, weights
from tests.refusals import refuses
from tests.thorough import rest_thorough

MODES = ("limit", "nan", "free")
ROWS = 120
RELAYS = Preisach(GridDensity(0.0, 1.0, weights(np.random.default_rng(0))), initial="negative")
CREEP = Burgers(E1=2.0, eta1=40.0, E2=1.0, eta2=5.0)
MODELS: dict[str, AbstractModel] = {
    "relays": RELAYS,
    "creep": CREEP,
    "sum": Sum([RELAYS, GeneralizedMaxwell(1.0, np.array([3.0]), np.array([0.5]))]),
    "curve": MonotoneCurve(np.array([0.0, 0.5, 1.0]), np.array([1.0, 0.001]), 0.0),
    "plays": next(p for p in PROBLEMS if p.name == "play-rates-bent").model(),
}


def history(model: AbstractModel, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times in 64ths, which add up without rounding, inputs from -0.2 to 1.2 and outputs; every twentieth
    reading is missing."""
    random = np.random.default_rng(seed)
    t = np.cumsum(random.integers(7, 65, ROWS) / 64)
    u = random_histories(random, -0.2, 1.2, (1, ROWS))[0]
    y = np.asarray(model.simulate(t, u))
    return t, u, np.where(np.arange(ROWS) % 20 == 7, np.nan, y)


@pytest.mark.parametrize(("name", "beyond"), rest_thorough([
    *(("relays", mode) for mode in MODES),
    ("creep", "limit"), ("curve", "limit"), ("sum", "nan"), ("plays", "free"),
], 3))  # fmt: skip
def test_jax_python_and_c_are_the_same(name: str, beyond: Any, tmp_path: Path):
    """Values and statuses, for inputs and readings that leave the range, from an unknown start."""
    model = MODELS[name]
    t, _, y = history(model)
    low, high = 0.2, 0.8
    readings = np.nanquantile(y, 0.05), np.nanquantile(y, 0.95)
    past = (t, invert(model).simulate(t, y).value)
    own = invert(model, trained=(low, high), start="unknown", past=past)
    assert type(own).__name__ == "GuardedCompensator"
    seen = np.nanquantile(y, 0.2), np.nanquantile(y, 0.8)
    compensator = type(own)(own.inner, low, high, beyond, own.starts, seen=seen, readings=readings)
    wanted = compensator.simulate(t, y)
    value, status = np.asarray(wanted.value), np.asarray(wanted.status)
    assert (status == Status.EXTRAPOLATED).sum() > 5
    options = {
        "times": t, "trained": (low, high), "beyond": beyond, "start": "unknown", "seen": seen,
    }  # fmt: skip
    path = tmp_path / "it.json"
    export_runtime(model, path, y, limits=readings, depth=128, **options)
    runtime, dt = load(path), np.diff(t, prepend=t[0])
    found = [runtime.step(*now) for now in zip(dt.tolist(), y.tolist(), strict=True)]
    scale = 1e-9 * np.nanmax(np.abs(value))
    np.testing.assert_array_equal([e.value for e in found], value)
    np.testing.assert_array_equal([int(e.status) for e in found], status)
    assert (runtime.trained, runtime.beyond) == ((low, high), beyond)
    if COMPILERS:
        export_c(model, tmp_path / "it.h", y, limits=readings, depth=128, **options)
        it = Compiled(tmp_path / "it.h", COMPILERS[0], ("-O0",))
        found_c, status_c = it.run(dt, y)
        np.testing.assert_allclose(found_c, value, rtol=0, atol=scale)
        np.testing.assert_array_equal(status_c, status)
        assert it.wrong == 0
        assert f"State: {it.size} bytes" in it.text


def test_the_law_of_each_mode():
    """limit is the clipped inverse, nan has no value there, free is the inverse; all tell the same rows."""
    model = RELAYS
    t, _, y = history(model)
    free = invert(model).simulate(t, y)
    inside = (np.asarray(free.value) >= 0.2) & (np.asarray(free.value) <= 0.8)
    found = {m: invert(model, trained=(0.2, 0.8), beyond=m).simulate(t, y) for m in MODES}
    np.testing.assert_array_equal(found["free"].value, free.value)
    np.testing.assert_array_equal(found["limit"].value, np.clip(free.value, 0.2, 0.8))
    np.testing.assert_array_equal(found["nan"].value, np.where(inside, free.value, np.nan))
    sound = np.isin(free.status, (Status.OK, Status.FLAT))
    expected = np.where(~inside & sound, Status.EXTRAPOLATED, free.status)
    for estimate in found.values():
        np.testing.assert_array_equal(estimate.status, expected)


@pytest.mark.parametrize("name", rest_thorough(["sum", "relays", "creep", "plays"], 2))
def test_no_start_within_the_past_gives_another_ok_estimate(name: str):
    """A specimen that has been through a part of the training: OK estimates are right to the deviation."""
    model, deviation, random = MODELS[name], 0.02, np.random.default_rng(5)
    t = np.arange(240) * 0.5
    u = np.clip(random_histories(random, -0.2, 1.2, (1, 240))[0], 0.0, 1.0)
    if name == "creep":  # the inverse forgets in 63 s, and what has flowed is 600 deviations
        t = 16 * t
    own = invert(model, trained=(0, 1), start="unknown", past=(t, u), deviation=deviation)
    worst, ok = 0.0, 0
    for cut in (60, 107, 171, 220):  # of one length, for which one program is compiled
        past = slice(cut - 60, cut)
        clock = np.concatenate([t[past] - t[cut] + t[0], t])
        y = np.asarray(model.simulate(clock, np.concatenate([u[past], u])))[60:]
        found = own.simulate(t, y)
        known = np.asarray(found.status) == Status.OK
        worst = max(worst, float(np.abs(np.asarray(found.value) - u)[known].max(initial=0.0)))
        ok += int(known[120:].sum())
    # The truth lies between the starts, but for branches that cross.
    assert worst <= 1.5 * deviation
    assert ok > 0.9 * 4 * 120


@pytest.mark.parametrize(
    ("strength", "time"), rest_thorough([(20.0, 0.1), (5.0, 0.3), (20.0, 0.02)], 1)
)
def test_starts_that_cross_are_not_ok(strength: float, time: float):
    """A fast Maxwell element beside plays, switched on in motion: up to 11 deviations where they cross."""
    curve = MonotoneCurve.even(0, 1, [2.0, 2.0], 0)
    plays = PrandtlIshlinskii([0.02, 0.12, 0.4], [2, 0.8, 0.2], 0.2)
    model = Sum(curve, GeneralizedMaxwell(0.0, [strength], [time]), plays)
    t, deviation, random = np.arange(2000) * 0.01, 0.003, np.random.default_rng(3)
    u = [
        np.interp(t, np.append(0, np.cumsum(random.uniform(0.05, 2, 99))), random.random(100))
        for _ in range(4)
    ]
    own = invert(model, trained=(0, 1), start="unknown", past=(t, u[0]), deviation=deviation)
    worst, ok = 0.0, 0
    for one in u[1:]:
        y = np.asarray(model.simulate(t, one))
        for cut in range(100, 1100, 200):
            rows = slice(cut, cut + 900)
            found = own.simulate(t[rows] - t[cut], y[rows])
            known = np.asarray(found.status) == Status.OK
            off = np.abs(np.asarray(found.value) - one[rows])
            worst, ok = max(worst, off[known].max(initial=0)), ok + known.sum()
    assert worst <= 1.5 * deviation
    assert ok > 1000


def test_files_say_what_they_know(tmp_path: Path):
    """Verdict, codes and date, in JSON and as macros in C; files of format 1 are still read."""
    _, _, y = history(RELAYS)
    origin = Origin("CAUTION", ("no-test", "flat"), "2024-05-03")
    given = {"trained": (0.0, 1.0), "origin": origin, "start": "unknown"}
    path = export_runtime(RELAYS, tmp_path / "it.json", y, **given).path
    assert load(path).origin == {
        "verdict": "CAUTION", "codes": ["no-test", "flat"], "date": "2024-05-03", "sha256": "",
    }  # fmt: skip
    text = export_c(RELAYS, tmp_path / "it.h", y, real="float", **given).path.read_text()
    tiny = MonotoneCurve.even(0, 1, [1.0, 1.0], 1e-300)
    assert "e-300" not in export_c(tiny, tmp_path / "tiny.h", y, real="float").path.read_text()
    for macro in (
        "IT_TRAINED_LOW 0.0f", "IT_TRAINED_HIGH 1.0f", 'IT_VERDICT "CAUTION"',
        'IT_CODES "no-test flat"', 'IT_DATA_DATE "2024-05-03"',
    ):  # fmt: skip
        assert f"#define {macro}\n" in text
    document = json.loads(path.read_text())
    assert document["schema"] == 3
    old = {k: v for k, v in document.items() if k not in ("guard", "origin")} | {"schema": 1}
    again = invert(RELAYS).simulate(None, old["golden"]["reading"]).value
    old["golden"]["value"] = np.asarray(again).tolist()
    path.write_text(json.dumps(old | {"checksum": checksum(old)}))
    assert (load(path).trained, load(path).origin) == (None, None)


def test_what_does_not_fit_is_refused():
    refuses("bad-option", lambda: invert(RELAYS, trained=(0.0, 1.0), beyond="clip"))
    refuses("bad-option", lambda: invert(RELAYS, start="unknown"))
    refuses("bad-option", lambda: invert(RELAYS, trained=(0.0, 1.0), start="cold"))
    refuses("zero-range", lambda: invert(RELAYS, trained=(1.0, 1.0)))


@pytest.mark.parametrize("name", rest_thorough(["creep", "relays"], 1))
def test_derivatives_are_those_of_what_is_found_and_never_a_silent_zero(name: str):
    """By readings: as differences within the trained inputs, 0 where an end is held. What a law says
    beside the estimate has no known derivative, which is NaN."""
    model = MODELS[name]
    t, u = np.arange(20) * 0.5, 0.5 + 0.45 * np.sin(0.6 * np.arange(20))
    y = np.asarray(model.simulate(t, u))
    guard = invert(model, trained=(0.2, 0.8))
    band = calibrated(guard, Record.from_arrays(u, y, t), levels=2)
    value = np.asarray(guard.simulate(t, y).value)
    inside = (value > 0.21) & (value < 0.79)
    assert 5 < inside.sum() < 15
    for one in (guard, band):
        simulated = jax.jit(lambda y, one=one: one.simulate(t, y))
        _, slope = jax.jvp(simulated, (y,), (np.ones(20),))
        shift = 1e-6
        ends = [np.asarray(simulated(y + s * shift).value) for s in (-1, 1)]
        # Rounding of 1e-16 over a shift of 1e-6, and the inverse's own to 1e-9 of it.
        wanted = np.where(inside, np.subtract(*ends[::-1]) / (2 * shift), slope.value)
        np.testing.assert_allclose(slope.value, wanted, rtol=1e-4)
        np.testing.assert_array_equal(slope.value[(value == 0.2) | (value == 0.8)], 0)
    assert np.isnan(slope.deviation).all()


def test_what_is_no_series_of_samples_is_refused():
    """One number, and times that are dates: their numbers would be taken for seconds."""
    t, y = np.arange(3.0), np.array([0.1, 0.2, 0.3])
    not_real = np.ma.masked_less(y, 0.2), [0.1, None, 0.3], ["0.1", "0.2", "0.3"], y + 0j
    for one in (CREEP, invert(CREEP, trained=(0.2, 0.8))):
        refuses("wrong-shape", lambda one=one: one.simulate(0.0, 1.0))
        refuses("wrong-unit", lambda one=one: one.simulate(t.astype("datetime64[ns]"), y))
        refuses("wrong-unit", lambda one=one: one.simulate(t.astype("timedelta64[s]"), y))
        for values in not_real:
            refuses("not-numbers", lambda one=one, values=values: one.simulate(t, values))
        found = one.simulate([], [])
        assert getattr(found, "value", found).shape == (0,)
