"""Compensators that recalibrate themselves: they learn what changed, keep an inverse, and say so."""

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensate import adaptive, export_c, export_runtime, invert
from compensate.internal import Advice
from compensate.runtime import FileError, load
from hysteresis import (
    AbstractModel,
    Burgers,
    Conditioned,
    InputError,
    LinearSponge,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    Record,
    Scaled,
    Sum,
)
from hysteresis.laws import adaptive as law
from hysteresis.preisach import GridDensity
from tests.c_harness import COMPILERS, Compiled
from tests.refusals import refuses
from tests.thorough import rest_thorough

ROWS = 40
"""Of a cycle."""


def relays(leading: bool = False) -> Preisach:
    weights = np.tril(np.full((5, 5), 0.1))
    steep = np.full(5, 1.6 if leading else 0.8)
    return Preisach(GridDensity(0.0, 10.0, weights), steep, 0.5, leading=leading, capacity=8)


def bent() -> Sum:
    curve = MonotoneCurve(np.array([0.0, 5.0, 10.0]), np.array([3.0, 2.0]))
    plays = PrandtlIshlinskii(np.array([0.5, 2.0]), np.array([0.2, 0.1]), 0.1)
    return Sum(curve, plays)


MODELS = {
    "relays": relays(),
    "leading": relays(True),
    "falling": Scaled(relays(), -2.0, 3.0),
    "plays": PrandtlIshlinskii(np.array([0.5, 2.0]), np.array([0.3, 0.2]), 0.5),
    "sum": bent(),
    "gain alone": LinearSponge(2.0, 0.0, 0.0),
    "with rates": Sum(MonotoneCurve(np.array([0.0, 10.0]), np.array([4.0])),
                      Burgers(2.0, 400.0, 4.0, 20.0)),
}  # fmt: skip
several = pytest.mark.parametrize("name", rest_thorough(["falling", "with rates"], 1))


class Run(NamedTuple):
    """Cycles: time, input, and readings of a model, with noise of 0.2 per cent."""

    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    noise: np.ndarray


def run(model: AbstractModel, cycles: int = 8, seed: int = 0) -> Run:
    random = np.random.default_rng(seed)
    rise = np.linspace(0, 1, ROWS // 2, endpoint=False)
    shape = np.append(rise, 1 - rise)
    u = np.concatenate([random.uniform(7, 9.5) * shape for _ in range(cycles)])
    t = np.arange(len(u)) * 0.5
    y = np.asarray(model.simulate(t, u))
    return Run(t, u, y, 2e-3 * np.ptp(y) * random.normal(size=len(u)))


@cache
def made(name: str, drift: float = 0.0) -> Any:
    found = run(MODELS[name])
    record = Record.from_arrays(found.u, found.y + found.noise, found.t)
    return adaptive(MODELS[name], record, drift=drift)


def loaded(file: Path) -> Any:
    found = load(file)
    assert type(found).__name__ == "Compensator"
    return found


def changed(name: str, gain: float, width: float) -> tuple[Run, np.ndarray]:
    """A run and its readings after a change of gain and width, the weights of the first two parts."""
    found, own = run(MODELS[name], seed=1), made(name)
    nominal = np.asarray(own.unknowns(own.init()))[2:]
    each = [
        np.asarray(p.simulate(found.t, found.u)) * w
        for p, w in zip(own.parts, nominal, strict=True)
    ]
    first, *rest = (one - one.min() for one in each)
    sign = np.sign(np.polyfit(found.u, found.y, 1)[0])
    zero = (sign * found.y - first - sum(rest)).mean()
    return found, sign * (zero + gain * (first + width * sum(rest))) + found.noise


def known_in(found: Run, cycles: tuple[int, ...]) -> np.ndarray:
    return np.where(np.isin(np.arange(len(found.u)) // ROWS, cycles), found.u, np.nan)


@several
def test_without_references_it_is_the_inverse(name: str):
    model = MODELS[name]
    found, own = run(model), made(name)
    value = np.asarray(own.simulate(found.t, found.y).value)
    # The same operations in another compiled program, which may round the last bit otherwise.
    wanted = np.asarray(invert(model).simulate(found.t, found.y).value)
    np.testing.assert_allclose(value, wanted, rtol=0, atol=1e-13 * np.ptp(wanted))


@several
def test_stream_is_batch_and_goes_on(name: str):
    """The state is all there is: a log in two parts is one log."""
    found, own = run(MODELS[name]), made(name)
    known = known_in(found, (0, 5))
    whole = own.follow(found.t, found.y, known)[1]
    half = 4 * ROWS
    state, first = own.follow(found.t[:half], found.y[:half], known[:half])
    _, rest = own.follow(found.t[half:], found.y[half:], known[half:], state)
    for a, b, c in zip(whole, first, rest, strict=True):
        np.testing.assert_allclose(np.append(b, c), a, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["falling", "sum"])
def test_a_change_is_learnt_from_two_cycles(name: str):
    """Four fifths of the accuracy lost come back; the change is counted, and its reason is the gain."""
    found, y = changed(name, 0.85, 1.2)
    own = made(name)
    frozen = np.asarray(own.simulate(found.t, y).value) - found.u
    out = own.follow(found.t, y, known_in(found, (0, 4)))[1]
    error = np.asarray(out.value) - found.u
    fit = float(own.settings["error"])
    last = slice(5 * ROWS, None)
    lost = np.sqrt(np.mean(frozen[last] ** 2)) - fit
    assert np.sqrt(np.mean(error[last] ** 2)) - fit <= 0.2 * lost
    assert int(out.changes[ROWS]) == 1
    assert Advice(int(out.advice[ROWS // 2])) == Advice.GAIN
    assert float(out.lost[ROWS // 2]) > 0
    assert Advice(int(out.advice[-1])) == Advice.NONE


def test_nothing_is_learnt_where_nothing_changed():
    """No alarm, and estimates no worse by more than a twentieth."""
    own = made("sum")
    for seed in range(6):
        found = run(MODELS["sum"], seed=seed + 2)
        y = found.y + found.noise
        out = own.follow(found.t, y, known_in(found, (0, 4)))[1]
        frozen = own.simulate(found.t, y)
        assert int(out.changes[-1]) == 0
        error, before = (np.asarray(x.value) - found.u for x in (out, frozen))
        assert np.sqrt(np.mean(error**2)) <= 1.05 * np.sqrt(np.mean(before**2))


def test_a_drifting_zero_is_extrapolated():
    """Between references the learnt drift goes on."""
    found = run(MODELS["sum"], seed=3)
    y = found.y + found.noise + 5e-3 * found.t
    known, off = known_in(found, (0, 2, 4)), []
    for drift in (0.0, 5e-3):
        value = np.asarray(made("sum", drift).follow(found.t, y, known)[1].value)
        off.append(np.sqrt(np.mean((value - found.u)[5 * ROWS :] ** 2)))
    assert off[1] < 0.5 * off[0]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_bounded_is_the_constrained_minimum(seed: int):
    """Weights are at their bounds or above, and no nearer point in the metric of the covariance is among
    those that hold the same weights."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(5, 5))
    covariance = root @ root.T + 0.1 * np.eye(5)
    theta, least = random.normal(size=5), random.normal(size=3)
    p, s = law.Parameters(), law.State()
    p.parts, p.least = 3, least.tolist()
    s.theta, s.covariance = theta.tolist(), covariance.ravel().tolist()
    s.along, s.work = [0.0] * 5, [0.0] * 25
    law.held_up(p, s)
    found = np.asarray(s.theta)
    assert (found[2:] >= least - 1e-12).all()
    held = np.flatnonzero(np.isclose(found[2:], least)) + 2
    free = np.setdiff1d(np.arange(5), held)
    gradient = np.linalg.solve(covariance, found - theta)
    # Only where clipping at the end was not needed is it the minimum over the free ones.
    held_up = np.linalg.solve(covariance[np.ix_(held, held)], found[held] - theta[held])
    moved = theta + covariance[:, held] @ held_up
    np.testing.assert_allclose(found[free], moved[free], atol=1e-8)
    np.testing.assert_allclose(gradient[free], 0.0, atol=1e-8)


@several
def test_weights_keep_an_inverse(name: str):
    """Whatever the references say: the weights stay above their least ones, and the model rises."""
    found, own = run(MODELS[name]), made(name)
    wrong = found.u.max() - found.u
    state, out = own.follow(found.t, found.y, wrong)
    theta = np.asarray(own.unknowns(state))
    assert np.isfinite(theta).all()
    assert np.isfinite(np.asarray(out.value)).all()
    assert (theta[2:] >= np.asarray(own.settings["least"])).all()
    outputs = [
        sum(w * float(p.simulate(found.t, u)[-1]) for w, p in zip(theta[2:], own.parts, strict=True))
        for u in (np.append(found.u[:-1], end) for end in (own.low, own.high))
    ]  # fmt: skip
    assert outputs[1] > outputs[0]


@several
def test_python_and_c_are_the_same(name: str, tmp_path: Path):
    """Estimates, accuracy lost and advice: to 1e-9 of the range, with references, gaps and a restart."""
    model, own = MODELS[name], made(name)
    found, y = changed(name, 0.85, 1.2)
    known, y = known_in(found, (0, 4)), y.copy()
    y[[7, 50]] = np.nan
    wanted = own.follow(found.t, y, known)[1]
    options: dict[str, Any] = {"times": found.t, "adaptive": own}
    limits: dict[str, Any] = {"limits": (float(np.nanmin(y)) - 1.0, float(np.nanmax(y)) + 1.0)}
    file = export_runtime(model, tmp_path / "it.json", found.y, **options, **limits).path
    sensor, dt = loaded(file), np.diff(found.t, prepend=found.t[0])
    values, lost, advice = [], [], []
    for k, reading in enumerate(y):
        values.append(sensor.step(dt[k], reading, reference=known[k]).value)
        lost.append(sensor.lost)
        advice.append(sensor.advice)
        if k == 100:
            kept = json.loads(json.dumps(sensor.state()))
            sensor = loaded(file)
            sensor.restore(kept)
    compared: list[Any] = [(values, lost, advice)]
    if COMPILERS:
        header = export_c(model, tmp_path / "it.h", found.y, **options, **limits).path
        it = Compiled(header)
        assert it.wrong == 0
        assert f"State: {it.size} bytes" in it.text
        compared.append(it.learn(dt, y, known))
    for values, lost, advice in compared:
        np.testing.assert_allclose(values, wanted.value, atol=1e-8 * np.ptp(found.u))
        np.testing.assert_allclose(lost, wanted.lost, atol=1e-7 * np.ptp(found.u))
        np.testing.assert_array_equal(advice, wanted.advice)


def test_a_state_of_another_file_is_refused(tmp_path: Path):
    y, model = run(relays()).y, relays()
    files = [export_runtime(model, tmp_path / f"{k}.json", y + k).path for k in (0, 1)]
    first, second = map(loaded, files)
    with pytest.raises(FileError):
        second.restore(first.state())
    with pytest.raises(TypeError):
        first.step(0.01, 1.0, reference=2.0)


def test_what_cannot_be_recalibrated_is_refused():
    found = run(relays())
    record = Record.from_arrays(found.u, found.y, found.t)
    for options in ({"false_alarms": 0.0}, {"drift": -1.0}):
        refuses("bad-option", lambda options=options: adaptive(relays(), record, **options))
    pair = Conditioned([relays(), relays()], np.array([0.0, 1.0]), "temperature")
    with pytest.raises(InputError):
        adaptive(pair, record)
    refuses("length-mismatch", lambda: made("sum").follow(found.t, found.y, [1.0]))


def test_it_runs_in_any_loop():
    """`step` is a pure function, under `jit` and `vmap`."""
    own = made("sum")
    steps = jax.jit(jax.vmap(own.step, in_axes=(None, None, 0)))
    _, found = steps(own.init(), 0.0, np.array([[1.0, np.nan], [2.0, 1.0]]))
    assert found.value.shape == (2,)
