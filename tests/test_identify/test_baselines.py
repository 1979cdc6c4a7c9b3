"""Baselines: what each of them is exact on, that they are causal, and that folds and rows are the fit's."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import Record
from identify.baselines._contract import scored
from identify.baselines._curves import MonotoneBaseline, replay
from identify.baselines._holds import of_holds
from identify.baselines._input_memory import branches_of, directions, lags, slow_states, stops
from identify.baselines._linear import constant, cubic_per_branch, ridges, straight_line
from identify.fitting._baselines import baselines_of
from identify.records._folds import parts

ROWS = 401
TIME = np.arange(ROWS) / 80


def stroke(amplitude: float = 10.0) -> np.ndarray:
    """Five triangles from 0 up and back."""
    return amplitude * (1 - np.abs(2 * (TIME % 1.0) - 1))


def play(u: np.ndarray, radius: float) -> np.ndarray:
    """The slow oracle: row by row."""
    found, p = [], u[0]
    for x in u:
        p = max(x - radius, min(x + radius, p))
        found.append(p)
    return np.array(found)


def record(output: np.ndarray, u: np.ndarray | None = None) -> Record:
    return Record.from_arrays(stroke() if u is None else u, output, TIME)


def predictions(made: Record) -> dict[str, np.ndarray]:
    cut = parts(made)
    single = (
        constant(),
        straight_line(()),
        MonotoneBaseline(),
        cubic_per_branch(made, branches_of(made)),
        replay(made, branches_of(made)),
    )
    return {one.name: scored(one, made, cut).output for one in (*single, ridges(made, ())[0])}


@pytest.mark.parametrize(
    ("made", "exact"),
    [
        (lambda u: 0 * u + 3, "constant"),
        (lambda u: 2 * u - 1, "straight line"),
        (lambda u: 5 - 0.3 * u, "straight line"),
        (lambda u: 5 - 0.3 * u, "cubic per branch"),
        (lambda u: (u / 10) ** 3 - u, "cubic per branch"),
    ],
)
def test_each_is_exact_on_its_own_data(made, exact):
    output = made(stroke())
    assert predictions(record(output))[exact] == pytest.approx(output, abs=1e-9)


def test_a_repeated_loop_is_replayed_exactly():
    u = stroke()
    output = u**2 / 10 + 2 * play(u, 2.0)
    found = predictions(record(output))["replay of the last loop"]
    later = TIME > 1.0  # the first loop begins elsewhere
    assert found[later] == pytest.approx(output[later], abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_monotone_curve_follows_the_output_up_or_down(sign):
    u = stroke()
    output = sign * np.sqrt(u + 0.1)
    cut = parts(record(output))
    curve = MonotoneBaseline()
    seen = curve.prepared(record(output))
    fitted = curve.fitted(seen, output, np.flatnonzero(cut.label >= 0), np.ones(len(u)))
    y = curve.predicted(np.linspace(-1, 11, 200), fitted)
    assert (sign * np.diff(y) >= 0).all()
    assert y[:15] == pytest.approx(y[0])  # held beyond the trained inputs
    assert np.sqrt(np.mean((curve.predicted(seen, fitted) - output) ** 2)) < 0.02


def test_ridge_beats_a_line_on_a_play():
    u = stroke()
    output = u + 5 * play(u, 3.0)
    found = predictions(record(output))
    later = TIME > 1.0  # the first loop begins elsewhere, and may be left out
    error = {name: np.std((y - output)[later]) for name, y in found.items()}
    assert error["ridge on lags, stops and slow states"] < 0.05 * error["straight line"]


@given(st.lists(st.integers(-9, 9), min_size=2, max_size=60), st.integers(1, 59))
def test_what_is_read_of_an_input_is_causal_and_right(values, cut):
    """Rows to come change nothing; stops are those of the oracle, row by row."""
    u = np.array(values, float)
    whole = Record.from_arrays(u, u, np.arange(len(u)))
    few = Record.from_arrays(u[:cut], u[:cut], np.arange(len(u[:cut])))
    radii, times = np.array([0.5, 2.0]), np.array([1.0, 5.0])
    for read in (
        lambda r: directions(r, 1.5),
        lambda r: stops(r, radii),
        lambda r: slow_states(r, times),
        lambda r: lags(r, (1, 3)),
    ):
        assert np.array_equal(read(whole)[: len(few)], read(few))
    for k, radius in enumerate(radii):
        assert stops(whole, radii)[:, k] == pytest.approx(u - play(u, radius), abs=1e-12)


def test_a_direction_turns_only_beyond_the_noise():
    u = np.array([0, 1, 2, 1.9, 2.1, 3, 2.95, 2.5, 1, 1.1, 0.5, 2])
    turned = directions(Record.from_arrays(u, u), 0.3)
    assert turned.tolist() == [1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, 1]


@pytest.mark.parametrize("exponent", [-0.3, 0.0, 0.5])
def test_a_power_law_of_time_is_found(exponent):
    t = np.geomspace(0.01, 1000, 80)
    law = np.log(t) if exponent == 0 else t**exponent
    made = Record.from_arrays(np.full(80, 2.0), 2 * (30 + 0.5 * law), t)
    found = {one.name: scored(one, made, parts(made)) for one in of_holds()}
    assert found["power law of time"].output == pytest.approx(made.output, rel=1e-9)
    assert found["power law of time"].blocks.mean() < 1e-9 * found["constant"].blocks.mean()


def test_folds_and_rows_are_those_of_the_fit():
    u = stroke()
    output = 2 * u + np.random.default_rng(0).normal(0, 0.1, ROWS)
    train, test = record(output).split_cycles(1)
    cut = parts(train)
    line = next(one for one in baselines_of(train, cut, test) if one.name == "straight line")
    counted = cut.label >= 0
    x = np.column_stack([np.ones(ROWS), u])
    held = np.isin(cut.label, cut.folds[0].test)

    def rms(fit_rows: np.ndarray, judged: np.ndarray) -> float:
        weights = np.linalg.lstsq(x[fit_rows], output[fit_rows], rcond=None)[0]
        return float(np.sqrt(np.mean((x @ weights - output)[judged] ** 2)))

    fold = rms(np.isin(cut.label, cut.folds[0].train), held)
    assert np.sqrt(line.blocks.mean()) == pytest.approx(fold, rel=0.01)  # blocks differ by a row
    assert line.metrics["test"].rmse == pytest.approx(rms(counted, test.mask), rel=1e-9)
    assert line.judged == (line.metrics["test"].rmse, line.metrics["test"].nrmse_percent)


def test_further_columns_are_regressors():
    u, heat = stroke(), np.sin(3 * TIME)
    made = replace(record(u + 2 * heat), columns={"heat": heat})
    cut = parts(made)
    alone, both = (scored(straight_line(c), made, cut).blocks.mean() for c in ((), ("heat",)))
    assert both < 1e-9 * alone


def test_a_condition_may_change_the_size_of_an_effect():
    u, heat = stroke(), np.repeat([1.0, 2.0, 1.5, 1.2, 1.8], 81)[:ROWS]
    made = replace(record(heat * play(u, 2.0)), columns={"heat": heat})
    cut = parts(made)
    alone, both = (
        min(scored(one, made, cut).blocks.mean() for one in ridges(made, c))
        for c in ((), ("heat",))
    )
    assert both < 0.05 * alone
