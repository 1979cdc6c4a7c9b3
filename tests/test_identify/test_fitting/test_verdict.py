"""The verdict on a fit: each sentence is recomputed from the arrays."""

import re
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from hysteresis import LinearSponge, Record
from identify import FitResult, fit, fit_step
from identify.diagnostics._residual_breakdown import loops_left
from identify.fitting._verdict import judge
from identify.internal import Verdict, estimate_noise, members_and_questions, root_difference
from identify.noise._model import NoiseModel
from tests.problems import play, rms
from tests.refusals import refuses

QUICK: dict[str, Any] = {"model": LinearSponge(K=1.0, b=0.0), "noise": "gaussian", "starts": 1}
TIME = np.arange(321) / 80
NORMAL_95 = 1.6448536269514722


def record(amplitudes: tuple[float, ...], loop: float, noise: float = 0.02) -> Record:
    """Four cycles of these amplitudes: a line, a play of radius 1 with weight `loop`, and noise."""
    u = np.array(amplitudes)[np.minimum(TIME.astype(int), 3)] * (1 - np.abs(2 * (TIME % 1.0) - 1))
    y = 0.5 * u + 1 + loop * play(u, 1.0) + np.random.default_rng(0).normal(0, noise, len(u))
    return Record.from_arrays(u, y, TIME, input_unit="N", output_unit="mm")


@pytest.fixture(scope="module")
def loops() -> FitResult:
    """A line through loops; the last cycle is half as large again."""
    return fit(record((10.0, 10.0, 10.0, 15.0), 0.5), test_cycles=1, **QUICK)


@pytest.fixture(scope="module")
def line() -> FitResult:
    """A line through a line; the last cycle is a fifth as large."""
    return fit(record((10.0, 10.0, 10.0, 2.0), 0.0, 0.05), test_cycles=1, **QUICK)


def numbers(verdict: Verdict, code: str) -> list[float]:
    """Of the one sentence with this code."""
    (said,) = [r for r in verdict.reasons if getattr(r, "code", "") == code]
    return [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e[+-]\d+)?", said.replace("+- ", ""))]


def errors(found: FitResult) -> tuple[np.ndarray, np.ndarray]:
    """On the fitted rows, and on the held-out ones."""
    train, test = ((found.predict(r) - r.output) for r in (found.train, found.test))
    return train[found.used], test[found.test.mask]


def test_the_error_is_that_of_the_held_out_rows(loops: FitResult, line: FitResult):
    for found in (loops, line):
        _, error = errors(found)
        y = found.test.output[found.test.mask]
        percent, rmse, largest = numbers(found.verdict, "error")[:3]
        assert percent == pytest.approx(100 * rms(error) / np.ptp(y), rel=0.06)  # two digits
        assert rmse == pytest.approx(rms(error), rel=0.006)
        assert largest == pytest.approx(np.abs(error).max(), rel=0.006)


def test_the_best_baseline_is_named_with_the_difference():
    """Ten blocks of paired squared errors; a baseline that wins by more than a standard error bars PASS."""
    loops = fit(record((10.0, 10.0, 10.0, 10.0), 0.5), test_cycles=1, **QUICK)
    verdict = loops.verdict
    assert verdict.level != "PASS"
    best = min(loops.baselines, key=lambda one: one.metrics["test"].rmse)  # type: ignore[union-attr]
    assert verdict.best_baseline == best.name
    assert f" {best.name}, " in verdict.reasons[verdict.codes.index("baseline-better")]
    _, error = errors(loops)
    ours = np.array([np.mean(block**2) for block in np.array_split(error, 10)])
    difference = np.sqrt(ours.mean()) - np.sqrt(best.test_blocks.mean())
    each = ours / np.sqrt(4 * ours.mean()) - best.test_blocks / np.sqrt(4 * best.test_blocks.mean())
    deviation = each.std(ddof=1) / np.sqrt(10)
    theirs, own, apart, uncertain = numbers(verdict, "baseline-better")
    test = best.metrics["test"]
    assert (theirs, own) == pytest.approx((test.rmse, rms(error)), rel=0.006)
    assert (apart, uncertain) == pytest.approx((difference, deviation), rel=0.06)
    assert apart > uncertain


def test_without_held_out_rows_folds_decide(line: FitResult):
    found = fit(record((10.0, 10.0, 10.0, 10.0), 0.5), **QUICK)
    verdict = found.verdict
    assert {"baseline-better", "nothing-held-out", "loops-left"} <= set(verdict.codes)
    best = min(found.baselines, key=lambda one: one.blocks.mean())
    theirs, own, *apart = numbers(verdict, "baseline-better")
    wanted = [np.sqrt(one.blocks.mean()) for one in (best, found)]
    assert [theirs, own] == pytest.approx(wanted, rel=0.006)
    assert tuple(apart) == pytest.approx(root_difference(best.blocks, found.blocks), rel=0.06)
    percent = numbers(verdict, "nothing-held-out")[0]
    y = found.train.output[found.train.mask]
    assert percent == pytest.approx(100 * np.sqrt(found.blocks.mean()) / np.ptp(y), rel=0.06)


def test_loops_in_the_residuals_are_measured(loops: FitResult, line: FitResult):
    """A play of radius 1 and weight 0.5: branches are 1 mm apart, but for its ends; a line leaves them."""
    percent, left, width = numbers(loops.verdict, "loops-left")
    assert 0.7 < width < 1.0  # all cycles, the smallest has most of its width in its ends
    assert percent == pytest.approx(100 * left / width, abs=1.1)  # both are told by three digits
    assert percent > 80
    assert "loops-left" not in line.verdict.codes
    # An input that is read with noise opens a line as far as the noise goes.
    clean = record((10.0, 10.0, 10.0, 10.0), 0.0)
    noisy = replace(clean, input=clean.input + np.random.default_rng(1).normal(0, 0.3, len(clean)))
    noisy = fit(noisy, test_cycles=1, **QUICK)
    assert loops_left(noisy).width > 3 * 0.02
    assert "loops-left" not in noisy.verdict.codes


def test_a_line_through_a_line_passes(line: FitResult):
    same = fit(record((10.0, 10.0, 10.0, 10.0), 0.0, 0.05), test_cycles=1, **QUICK)
    assert same.verdict.level == "PASS"
    assert "best-baseline" in same.verdict.codes


def test_rows_beyond_what_was_trained_are_counted_and_scored(loops: FitResult):
    found, test = loops.extrapolation, loops.test
    highest = loops.train.input[loops.used].max()
    beyond = test.mask & (test.input > highest + 0.1)
    error = loops.predict(test) - test.output
    assert found.input.rows == beyond.sum()
    assert found.input.rmse == pytest.approx(rms(error[beyond]))
    share, there, *inside = numbers(loops.verdict, "beyond")
    assert share == pytest.approx(100 * beyond.sum() / test.mask.sum(), abs=0.6)
    assert there == pytest.approx(rms(error[beyond]), rel=0.006)
    assert inside == []  # it moves faster too, in every row
    assert (found.rate.rows, found.inside.rows) == (test.mask.sum(), 0)


def test_questions_are_asked_by_folds_and_by_rows_beyond(loops: FitResult):
    asked = {one.what: one for one in members_and_questions(loops)}
    assert asked["a later time"].error == pytest.approx(np.sqrt(loops.blocks.mean()))
    assert (asked["another amplitude"].share, asked["another amplitude"].error) == ("no row", None)
    assert asked["an input beyond the trained ones"].error == loops.extrapolation.input.rmse
    other = fit(record((10.0, 10.0, 5.0, 10.0), 0.5), test_tail=0.25, **QUICK)
    (found,) = (x for x in members_and_questions(other) if x.what == "another amplitude")
    assert found.error is not None


def test_held_out_loops_of_another_size_are_told():
    """Trained on strokes of 1, judged on one of half that: the error there, of their own range."""
    found = fit(record((1.0, 1.0, 1.0, 0.5), 0.3), "LinearSponge", test_cycles=1, noise="gaussian")
    (note,) = (n for n in found.verdict.reasons if n.code == "other-loops")
    error, output = errors(found)[1], found.test.output[found.test.mask]
    assert note.values["loops"] == 1
    # The cycle's rows, to the row that it shares with the one before.
    assert note.values["rmse"] == pytest.approx(rms(error), rel=0.05)
    assert note.values["percent"] == pytest.approx(100 * rms(error) / np.ptp(output), rel=0.05)


def test_a_trained_loop_may_hold_smaller_ones():
    """Two loops with small ones on each way are trained, and one without them is judged."""
    way = [0.0, 0.3, 0.1, 0.6, 0.4, 1.0, 0.6, 0.8, 0.3, 0.5] * 2 + [0.0, 1.0, 0.0]
    u = np.interp(np.arange(20 * len(way) - 19), 20 * np.arange(len(way)), way)
    y = u + 0.3 * play(u, 0.1) + np.random.default_rng(0).normal(0, 0.01, len(u))
    found = fit(Record.from_arrays(u, y), test_tail=0.09, **QUICK)
    assert np.ptp(found.test.input[found.test.mask]) == pytest.approx(1.0)
    assert "other-loops" not in found.verdict.codes


@pytest.mark.parametrize(
    ("heights", "rows", "told"),
    [
        ([1.0] * 4, [80] * 4, True),
        ([0.4, 0.6, 0.8, 1.0], [80] * 4, False),
        ([1.0] * 4, [120, 90, 60, 40], False),
    ],
)
def test_an_error_grows_where_cycles_are_alike(heights: list[float], rows: list[int], told: bool):
    """Not where they are larger, or faster: then it grows with that."""
    cycles = [
        h * (1 - np.abs(np.linspace(-1, 1, n, endpoint=False)))
        for h, n in zip(heights, rows, strict=True)
    ]
    u = np.concatenate([np.tile(cycles[0], 4), *cycles])
    late = np.maximum(np.arange(len(u)) - 4 * len(cycles[0]), 0) / len(u)
    y = 2 * u + 0.3 * late * (1 + 2 * u) + np.random.default_rng(0).normal(0, 0.002, len(u))
    found = fit(Record.from_arrays(u, y, 0.02 * np.arange(len(u))), test_cycles=4, **QUICK)
    assert ("growth" in found.verdict.codes) == told


def test_constants_need_standard_errors(line: FitResult):
    """A parameter without one is good to know for a prediction, and grave for a constant."""
    parameters = tuple(p._replace(stderr=None, status="at bound") for p in line.parameters)
    free = replace(line, parameters=parameters, starts=None, metrics={**line.metrics})
    plain, constants = (judge(replace(free, purpose=p)) for p in ("predict", "constants"))
    assert "at-bound" in plain.codes
    assert numbers(constants, "at-bound")[-2:] == [len(parameters), len(parameters)]
    order = [verdict.codes.index("at-bound") for verdict in (constants, plain)]
    assert order[0] <= order[1]
    assert constants.level != "PASS"
    assert "compensator-not-tried" in judge(replace(line, purpose="compensate")).codes
    refuses("bad-option", lambda: fit(line.train, purpose="sell", **QUICK))


def test_a_hold_is_judged_by_its_reading():
    """Little range is left at the end of a hold, but a small error of the reading is a small error."""
    t = np.geomspace(0.1, 1000, 120)
    noise = np.random.default_rng(1).normal(0, 0.002, 120)
    y = (10 - 4 * np.exp(-t / 5)) * (1 + noise)
    found = fit_step(Record.from_arrays(np.full(120, 2.0), y, t), test_tail=0.3)
    counted = found.test.mask
    error = (found.predict(found.test) - found.test.output)[counted]
    relative = 100 * rms(error / found.test.output[counted])
    percent, rmse = numbers(found.verdict, "error")[:2]
    assert percent == pytest.approx(relative, rel=0.06)
    assert rmse == pytest.approx(rms(error), rel=0.006)
    assert relative < 1
    figures = found.metrics["test"]
    assert figures.nrmse_percent > 10
    assert found.verdict.level != "FAIL"
    assert [one.name for one in found.baselines][-1] == "power law of time"
    assert found.extrapolation.time.rows == counted.sum()
    detail, test = found.detail, found.test
    assert type(detail).__name__ == "DiscreteSpectrum"
    value, low, high = detail.spectrum.predict(test.time[counted])
    shared, noise = test.output[counted] / 2.0, NORMAL_95 * detail.spectrum.noise.sigma * value
    inside = 100 * np.mean((low - noise <= shared) & (shared <= high + noise))
    share, times, _ = numbers(found.verdict, "open-range")
    span = np.ptp(found.train.time[found.used]) if found.train.time is not None else np.nan
    assert share == pytest.approx(inside, abs=0.6)
    assert times == pytest.approx(test.time[counted][-1] / span, rel=0.01)
    figures = found.metrics | {"test": figures._replace(relative_percent=3.0)}
    worse = replace(found, metrics=figures)
    ratio, held, fitted = numbers(judge(worse), "worse-than-trained")
    train = found.metrics["train"]
    assert (held, fitted) == pytest.approx((3.0, train.relative_percent), rel=0.06)
    assert ratio == pytest.approx(3.0 / train.relative_percent, rel=0.06)


def test_faster_rows_and_longer_holds_are_counted_and_scored_beside_the_rows_inside(line):
    """A held-out cycle of the trained amplitude: half of it as fast, half faster, then a hold."""
    time = np.concatenate([TIME[:120], 1.5 + (TIME[120:240] - 1.5) / 8, 1.7 + TIME[1:81]])
    u = np.append(np.tile(10 * (1 - np.abs(2 * (TIME[:80] % 1.0) - 1)), 3), np.zeros(80))
    off = np.select([time > 1.7, time > 1.5], [0.7, 0.5], 0.02)
    test = replace(Record.from_arrays(u, 0.5 * u + 1 + off, time), input_unit="N", output_unit="mm")
    train = line.train
    again = fit(train, test=test, **QUICK)
    verdict, predicted = again.verdict, again.predict(test)

    def held_for(record: Record, band: float) -> np.ndarray:
        """Times since the input was last further than this from where it is."""
        u, t = record.input, np.asarray(record.time)
        first, found = 0, np.empty(len(u))
        for k in range(len(u)):
            while np.ptp(u[first : k + 1]) > band:
                first += 1
            found[k] = t[k] - t[first]
        return found

    fastest = np.abs(np.diff(train.input) / np.diff(train.time))[line.used[1:]].max()
    fast = np.append(False, np.abs(np.diff(u) / np.diff(time)) > 1.01 * fastest)
    held = held_for(test, 0.02 * np.ptp(train.input[line.used]))
    longest = held_for(train, 0.02 * np.ptp(train.input[line.used]))[line.used].max()
    long = held > 1.01 * longest
    assert 0.1 < fast.mean() < 0.5
    assert 0.1 < long.mean() < 0.5
    error = predicted - test.output
    for code, rows in (("beyond-rate", fast), ("beyond-time", long)):
        share, there, inside = numbers(verdict, code)
        assert share == pytest.approx(100 * rows.mean(), abs=0.6)
        assert there == pytest.approx(rms(error[rows]), rel=0.006)
        assert inside == pytest.approx(rms(error[~fast & ~long]), rel=0.006)


def test_what_the_residuals_are_is_told_by_their_figures(loops: FitResult):
    """Of a line through loops: how large they are, how far correlated, and as how many rows they count."""
    train, _ = errors(loops)
    noise = estimate_noise([train], 2)
    verdict = judge(replace(loops, noise=noise, noise_model=None, noise_evidence={"gaussian": 0.0}))
    assert numbers(verdict, "model-error") == [pytest.approx(rms(train), rel=0.006)]
    samples, rows, effective = numbers(verdict, "correlated-residuals")
    assert rows == len(train)
    # The larger of two sums over the autocorrelations, of which this is one.
    rho = np.correlate(train, train, "full")[len(train) :] / (train @ train)
    of_rhythm = 1 + 2 * np.sum(rho[rho**2 > 9 / len(train)] ** 2)
    assert samples == pytest.approx(noise.correlation_time, abs=0.51)
    assert samples >= of_rhythm - 0.51
    assert effective == pytest.approx(len(train) / noise.correlation_time, abs=0.51)
    known = NoiseModel(jnp.asarray(loops.noise.sigma), phi=jnp.asarray(0.5))
    said = judge(replace(loops, noise_model=known))
    assert said.reasons[said.codes.index("noise-model")].endswith(": AR(1), Gaussian.")
