"""Compositions: columns are the model, parts are found, clocks are told from memory."""

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from compensate import invert
from hysteresis import ModulatedStops, MonotoneCurve, NonlinearMaxwell, Record, Sum
from identify import FitResult, fit, load, sample, save
from identify.linear._composition_fit import Problem, unknowns_for
from identify.records._folds import parts
from tests.refusals import refuses
from tests.thorough import rest_thorough

SAMPLES = 900


def walk(seed: int = 0, samples: int = SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    """Times of uneven steps, and triangles of changing height and speed."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.05, 0.15, samples))
    turns = np.cumsum(np.append(0, rng.uniform(2, 8, 60)))
    heights = np.where(np.arange(61) % 2, rng.uniform(0.5, 1.0, 61), rng.uniform(0.0, 0.3, 61))
    heights[0] = 0.0
    return t, np.interp(t, turns, heights)


def branches() -> Sum:
    """A curve and three relaxing branches, one of which is felt at high levels alone."""
    springs = np.array([np.linspace(0.2, 1.0, 6), np.zeros(6), np.full(6, 0.3)])
    curve = MonotoneCurve.even(0.0, 1.0, np.array([0.2, 0.4, 0.6, 1.0, 1.2, 1.6]), 0.3)
    return Sum([curve, NonlinearMaxwell(0.0, 1.0, np.array([0.3, 3.0, 30.0]), springs)])


def record(noise: float = 0.0, lag: float = 0.0, seed: int = 0) -> Record:
    t, u = walk(seed)
    y = np.asarray(branches().simulate(t, np.interp(t - lag, t, u)))
    y = y + noise * np.random.default_rng(seed + 1).normal(size=len(y))
    return Record.from_arrays(u, y, t)


@pytest.mark.parametrize(
    ("heights", "told"),
    rest_thorough([((1, 0.6, 0.3, 0.8, 1, 0.5, 0.9, 0.4), True), ((1,) * 6, False)], 1),
)
def test_only_several_amplitudes_tell_what_the_place_changes(heights, told):
    wave = np.sin(2 * np.pi * np.arange(120) / 120)
    u = np.concatenate([height * wave for height in heights])
    slopes = np.array([[9.0, 1.0, 9.0], [3.0, 1.0, 3.0]])
    levels = np.array([-1.0, 0.0, 1.0])
    sliders = ModulatedStops(-1.0, 1.0, np.array([0.05, 0.2]), levels, slopes, np.ones(3))
    data = Record.from_arrays(u, np.asarray(sliders.simulate(None, u)), dt=0.02)
    found = fit(data, "Composition", test_cycles=1)
    assert any(part in found.name for part in ("by position", "by span")) == told


def test_relaxing_branches_are_found_and_predict_other_histories():
    data, other = record(noise=0.003), record(seed=7)
    found = fit(data, "Composition", test_tail=0.3)
    assert "Maxwell" in found.name
    assert found.clocks.lag == 0.0
    predicted = found.predict(other)
    # Half a per cent of the range: the times are those of a grid, and the springs' nodes are others.
    assert np.sqrt(np.mean((predicted - other.output) ** 2)) < 0.005 * np.ptp(other.output)


@pytest.mark.parametrize("rest", rest_thorough([0.6, 0.0], 1))
def test_branches_begin_where_they_are_relaxed(rest: float):
    """A record that starts in the middle of its range: after a rest there, or stretched at once."""
    curve, relaxing = branches().parts
    relaxing = replace(relaxing, rest=rest)
    t, u = walk(1)
    u[: SAMPLES // 8] = np.linspace(0.6, u[SAMPLES // 8], SAMPLES // 8)
    y = np.asarray(Sum([curve, relaxing]).simulate(t, u))
    noisy = y + 0.003 * np.random.default_rng(0).normal(size=len(y))
    data = Record.from_arrays(u, noisy, t)
    best = fit(data, "Composition", clocks="keep")
    assert best.detail.linear.meaning.relaxed == (rest == 0.6)
    first = slice(0, SAMPLES // 8)
    # Stretched at once, the branches relax by 1.6; the times of the fit are those of a grid.
    np.testing.assert_allclose(best.predict(data)[first], y[first], rtol=0, atol=0.06)


@pytest.fixture(scope="module")
def lagging() -> FitResult:
    return fit(record(noise=0.003, lag=0.23), "Composition", test_tail=0.3)


def test_a_lag_is_told_from_relaxation(lagging: FitResult):
    found = lagging
    assert abs(found.clocks.lag - 0.23) < max(4 * found.clocks.lag_error, 0.01)
    assert any("lags" in note for note in found.notes)
    kept = fit(record(noise=0.003, lag=0.23), "Composition", test_tail=0.3, clocks="keep")
    assert kept.clocks.lag == 0.0
    assert kept.score > found.score


def test_a_staircase_is_made_linear_and_a_rest_stays(lagging: FitResult):
    t = np.arange(400) * 0.1
    smooth = np.interp(t, [0, 10, 25, 40], [0, 1, 1, 0])
    stairs = Record.from_arrays(smooth[(np.arange(400) // 5) * 5], smooth, t)
    made = lagging.clocks._replace(lag=0.0, interpolated=True).applied(stairs)
    error = np.abs(made.input - smooth)
    # Within a step's height where it moves, at a corner as much; exact in the rest.
    assert error.max() <= 0.06
    assert error[(t > 11) & (t < 24)].max() < 1e-12
    assert np.median(error) < 1e-9


def test_a_composition_is_saved_sampled_and_inverted(lagging: FitResult, tmp_path: Path):
    found, data = lagging, record(noise=0.003, lag=0.23)
    again = load(save(found, tmp_path / "fit"))
    assert again.clocks == found.clocks
    np.testing.assert_array_equal(again.predict(data), found.predict(data))
    posterior = sample(again, steps=20, ensembles=2)
    assert posterior.names[-3:] == ("sigma", "phi", "prior.strength")
    assert "output.rise" in posterior.names
    few = jax.tree.map(lambda draw: draw[:3], posterior.model)
    spread = jax.vmap(lambda model: invert(model).simulate(data.time, data.output).value)(few)
    assert spread.shape == (3, SAMPLES)
    # Back through the inverse and the clocks: the input, as far as the noise lets it be seen.
    estimate = invert(found.model).simulate(data.time, data.output)
    u = found.clocks.undone(data, np.asarray(estimate.value))
    assert np.sqrt(np.mean((u - data.input)[20:] ** 2)) < 0.02


@pytest.mark.thorough
def test_an_input_that_a_curve_maps_first_is_seen(tmp_path: Path):
    def steep(seed: int) -> Record:
        t, u = walk(seed)
        return Record.from_arrays(u, np.asarray(branches().simulate(t, u**8)), t)

    data, other = steep(0), steep(7)
    found = fit(data, "Composition", test_tail=0.3, clocks="keep")
    assert found.name.endswith("of a mapped input")
    *_, plain, mapped = sorted(found.candidates, key=lambda fit: -fit.score)
    assert not plain.name.endswith("of a mapped input")
    # Better by a fifth and more: half of the curve is not all of it.
    assert mapped.score < 0.8 * plain.score
    error = found.predict(other) - other.output
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.ptp(other.output)
    again = load(save(found, tmp_path / "fit"))
    np.testing.assert_array_equal(again.predict(other), found.predict(other))


def test_slack_is_seen_and_the_model_has_a_floor():
    data = record()
    floor = float(np.quantile(data.output, 0.3))
    cut = replace(data, output=np.maximum(data.output, floor))
    found = fit(cut, "Composition", clocks="keep")
    assert found.detail.linear.meaning.floor == pytest.approx(floor)
    assert found.predict(cut).min() == pytest.approx(floor)
    # Unknowns of an earlier version, whose parts had other cells: the model itself predicts.
    linear = found.detail.linear
    other = replace(linear, meaning=linear.meaning.of("curve"), last=None)
    old = replace(found, detail=replace(found.detail, linear=other))
    np.testing.assert_allclose(old.predict(cut), found.predict(cut), rtol=0, atol=1e-12)
    refuses("no-posterior", lambda: sample(old, steps=20))


def test_a_floor_above_which_nothing_is_fitted_is_none():
    """A spike among the held-out rows made a floor of the range of all others."""
    k = np.arange(400)
    u = 10 * (1 - np.abs(2 * (k / 80 % 1) - 1))
    y = 40 * np.where(k % 80 < 40, (u / 10) ** 1.5, (u / 10) ** 2.2)
    y = y + np.random.default_rng(0).normal(0, 0.05, 400)
    y[[50, 51, 120]] = -9999
    found = fit(Record.from_arrays(u, y, 0.05 * k), "Composition", test_cycles=1)
    assert found.success


def noisy(y: np.ndarray) -> np.ndarray:
    return y + 1e-3 * np.random.default_rng(0).normal(size=len(y))


def test_weights_are_those_of_the_squared_errors(monkeypatch: pytest.MonkeyPatch):
    """H and b over all rows are sums of w^2 a a' and w^2 a y, and held-out errors are times w."""
    data = record(noise=0.01)
    w, cut = np.linspace(0.5, 1.5, len(data)), parts(data)
    whole = unknowns_for(data, cut, "negative", ("curve", "Maxwell"))
    problem, plain = (Problem(data, cut, whole, weights=each) for each in (w, None))
    squares = w[problem.rows] ** 2
    want = (problem.A * squares[:, None]).T @ problem.A
    np.testing.assert_allclose(problem.total(cut.all).H, want, rtol=1e-9, atol=1e-9)
    tried = problem.tried(whole.parts, 1e-4).blocks
    assert not np.allclose(tried, plain.tried(whole.parts, 1e-4).blocks, rtol=0.01)
    # Chosen on a third of the rows, fitted to all.
    monkeypatch.setattr("identify.linear._composition_fit.ENOUGH_ROWS", 300)
    final = Problem(data, cut, whole, weights=w).final(whole.parts)
    np.testing.assert_allclose(final.H, want, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(final.b, problem.A.T @ (squares * problem.y), rtol=1e-9, atol=1e-9)
