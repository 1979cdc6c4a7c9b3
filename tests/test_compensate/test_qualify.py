"""The verdict on a compensator, where what is right is known."""

import re
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from compensate import AbstractCompensator, Status, estimate, invert, qualify
from compensate._qualification import Step, latency, loop_widths
from compensate.internal import Estimate
from hysteresis import Burgers, InputError, LinearSponge, PrandtlIshlinskii, Preisach, Record
from hysteresis.preisach import GridDensity
from tests.problems import rms, weights
from tests.refusals import refuses

THRESHOLD = 1.0
NORMAL_95 = 1.6448536269514722


def model(slope: float = 1.0, threshold: float = THRESHOLD) -> PrandtlIshlinskii:
    """y = slope u + play(u)."""
    return PrandtlIshlinskii(jnp.array([threshold]), jnp.array([1.0]), jnp.asarray(slope))


def stroke(cycles: int = 4, rows: int = 400) -> np.ndarray:
    """From 0 up to 10 and down to -10, again and again; then the cycle is not finished."""
    return 10 * np.sin(np.linspace(0, 2 * np.pi * (cycles + 0.3), rows * cycles))


def record(u: np.ndarray | None = None, **options) -> Record:
    """What `model` makes of a stroke."""
    u = stroke() if u is None else u
    y = np.asarray(model().simulate(None, u))
    units = {"input_name": "force", "input_unit": "N", "output_name": "path", "output_unit": "mm"}
    return Record.from_arrays(u, y, 0.01 * np.arange(len(u)), **(units | options))


def test_the_share_before_the_start_is_known_is_told():
    """It is no fault of the data up to half of the rows. Strokes that move no play never tell the start."""
    late = invert(model(), trained=(-10.0, 10.0), start="unknown")
    for u, level in ((stroke(), "PASS"), (0.05 * stroke(), "CAUTION")):
        found = qualify(late, record(u), model())
        assert (found.round_trip is None) == ("OK" not in found.statuses)
        early = found.statuses["RUN_IN"]
        assert (early > 0.5) == (level == "CAUTION")
        (said,) = (reason for reason in found.verdict.reasons if reason.code == "run-in")
        assert f"{100 * early:.3g} %" in said
        assert found.verdict.level == level


def test_the_round_trip_goes_on_from_what_was_found_beyond_the_trained_inputs():
    """Of a creeping model the estimates that are told, limited for a while, do not give the readings."""
    creeping = Burgers(E1=2.0, eta1=500.0, E2=1.0, eta2=3.0)
    t, u = 0.1 * np.arange(400), 10 * np.sin(np.linspace(0, 12, 400))
    far = Record.from_arrays(u, np.asarray(creeping.simulate(t, u)), t)
    found = qualify(invert(creeping, trained=(-8.0, 8.0)), far, creeping)
    assert 0.1 < found.statuses["OK"] < 1
    assert found.round_trip < 1e-9
    assert all(reason.code != "round-trip" for reason in found.verdict.reasons)
    # Noise takes relays at rest beyond the outputs that they have: OK, as the training had such readings.
    relays = Preisach(GridDensity(0.0, 1.0, weights(np.random.default_rng(0))), initial="negative")
    u = 0.5 - 0.5 * np.cos(np.linspace(0, 12, 400))
    y = np.asarray(relays.simulate(None, u)) + 0.05 * np.sin(np.arange(400))
    for beyond in ("limit", "nan", "free"):
        guarded = invert(relays, trained=(0.0, 1.0), beyond=beyond, seen=(y.min(), y.max()))
        assert qualify(guarded, Record.from_arrays(u, y), relays).round_trip < 1e-9


class Off(AbstractCompensator[AbstractCompensator, Estimate]):
    """The inverse, off by so much, a status for every third sample, two thirds of the way to y / slope."""

    inner: AbstractCompensator
    by: float = 0.0
    status: int = 0
    slope: float | None = None

    def init(self):
        return self.inner.init()

    def stream(self, t, y, state):
        state, (value, status) = self.inner.stream(t, y, state)
        if self.slope is not None:
            value = (value + 2 * y / self.slope) / 3
        third = jnp.arange(len(y)) % 3 == 0
        return state, Estimate(value + self.by, jnp.where(third, self.status, status))


def test_a_perfect_compensator_removes_all(monkeypatch):
    monkeypatch.setattr("compensate._qualification.latency", latency)
    found = qualify(invert(model()), record(), model(), max_error=1e-6, rate=1.0)
    assert found.level == "PASS"
    assert found.errors.max_abs < 1e-9
    assert (found.errors.rows, found.loop.cycles) == (len(record()), 4)
    assert found.loop.ratio < 1e-9
    assert found.round_trip < 1e-9
    assert found.statuses == {"OK": 1.0}
    assert found.output_range == pytest.approx((record().output.min(), record().output.max()))
    assert 0 < found.latency.median <= found.latency.tail < 1


def test_only_counted_rows_of_whole_cycles_make_a_loop():
    whole = record()
    wrong = np.where(whole.cycle == 2, 5.0 * whole.branch, 0.0) + whole.input
    assert loop_widths(whole, wrong).after > 1
    assert loop_widths(whole.select(cycle=[1, 3]), wrong).after == 0
    rising = Record.from_arrays(np.linspace(0, 1, 50), np.linspace(0, 2, 50))
    loop = loop_widths(rising, rising.input)
    assert (loop.cycles, np.isnan(loop.ratio)) == (0, True)
    assert "no-loop" in qualify(invert(model()), rising).verdict.codes


def test_a_line_that_stands_for_the_loop_is_doubtful():
    whole = record()
    slope, level = np.polyfit(whole.output, whole.input, 1)
    best = LinearSponge(K=1 / slope, b=-level / slope)
    found = qualify(invert(best), whole, best)
    assert found.level == "CAUTION"
    assert found.errors.rmse == pytest.approx(found.line_rmse, rel=1e-12)
    assert found.loop.ratio == pytest.approx(1, abs=0.1)
    assert any("little hysteresis is removed" in reason for reason in found.reasons)


def test_what_is_worse_than_a_line_fails():
    whole = record()
    found = qualify(invert(LinearSponge(K=3.0, b=0.0)), whole)
    slope, level = np.polyfit(whole.output, whole.input, 1)
    line = np.sqrt(np.mean((slope * whole.output + level - whole.input) ** 2))
    assert found.line_rmse == pytest.approx(line, rel=1e-9)
    assert (found.level, found.verdict.codes[:2]) == ("FAIL", ("error", "worse-than-line"))
    assert f"errs by {line:.3g} N rms only" in found.reasons[1]
    flat = replace(whole, output=np.ones(len(whole)))
    assert qualify(invert(LinearSponge(K=1.0, b=0.0)), flat).line_rmse is None


@pytest.mark.parametrize(("compensator", "needs", "level", "words"), [
    (Off(invert(model()), 0.4), {}, "PASS", "0.4 N rms"),
    (Off(invert(model()), 0.4), {"max_error": 0.3}, "FAIL", "above the 0.3 N asked for"),
    (Off(invert(model()), 0.4), {"max_error": 0.5}, "PASS", "No error is above the 0.5 N"),
    (Off(invert(model()), 3.0), {}, "FAIL", "of the range, above 5 %"),
    (Off(invert(model()), np.nan), {}, "FAIL", "not finite"),
    (Off(invert(model()), 0.0, int(Status.FLAT)), {}, "CAUTION", "% FLAT"),
    (invert(model()), {"rate": 1e9}, "FAIL", "too long for 1e+09 Hz"),
    (invert(model()), {"rate": 0.5}, "PASS", "0.5 Hz can be kept up"),
    (invert(model()), {"model": model(2.0)}, "CAUTION", "not the model's inverse"),
], ids=lambda x: str(x) if isinstance(x, (str, dict)) else "")  # fmt: skip
def test_verdicts_and_their_reasons(compensator, needs, level, words):
    found = qualify(compensator, record(), **needs)
    assert found.level == level
    assert ("not-finite" in found.verdict.codes) == (words == "not finite")
    assert any(words in reason for reason in found.reasons)


def test_a_slow_step_of_the_target_is_a_caution_and_one_of_this_computer_is_none():
    assert qualify(invert(model()), record(), rate=1000.0).level == "PASS"
    found = qualify(invert(model()), record(), rate=1000.0, step=Step("c", 1e-5, 1e-2))
    assert found.level == "CAUTION"
    assert numbers(found, "sometimes-slow") == [1e4, 1000]
    found = qualify(invert(model()), record(), rate=1000.0, step=Step("c", 1e-2, 1e-2))
    assert found.level == "FAIL"
    found = qualify(
        invert(model()), record(), rate=1000.0,
        step=Step("c", operations=500.0, most_operations=2000),
    )  # fmt: skip
    assert found.level == "PASS"
    assert numbers(found, "needs-processor")[-1] == 2.0  # 1000 steps of 2000 operations a second


def numbers(found: Any, code: str) -> list[float]:
    """Of the one sentence with this code."""
    said = found.reasons[found.verdict.codes.index(code)]
    return [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e[+-]?\d+)?", said)]


def test_every_figure_of_a_verdict_comes_from_the_arrays():
    """Estimates that keep two thirds of the loop; sentences have two or three digits."""
    whole, lost = record(), model(0.5)
    slope = float(np.polyfit(whole.input, whole.output, 1)[0])
    off = Off(invert(model()), 0.0, int(Status.EXTRAPOLATED), slope)
    found = qualify(off, whole, lost, max_error=0.1, rate=1e9)
    value, status = estimate(off, whole)[:2]
    error = np.asarray(value) - whole.input
    rmse, percent, most = numbers(found, "error")
    assert (rmse, most) == pytest.approx((rms(error), np.abs(error).max()), rel=0.006)
    assert percent == pytest.approx(100 * rms(error) / np.ptp(whole.input), rel=0.06)
    asked, inside = numbers(found, "above-max-error")[0], numbers(found, "above-max-error")[-1]
    assert (asked, inside) == (0.1, pytest.approx(np.quantile(np.abs(error), 0.95), rel=0.006))
    assert numbers(found, "too-slow") == pytest.approx([1e6 * found.latency.median, 1e9], rel=0.006)
    shares = [100 * np.mean(np.asarray(status) == s) for s in (Status.OK, Status.EXTRAPOLATED)]
    assert sorted(numbers(found, "not-ok")) == pytest.approx(sorted(shares), rel=0.006)
    assert numbers(found, "loop-left") == [pytest.approx(found.loop.ratio, rel=0.06)]
    assert found.loop.ratio == pytest.approx(2 / 3, abs=0.05)
    again = np.asarray(lost.simulate(whole.time, value))
    fine = np.asarray(status) == Status.OK
    most = np.abs(again - whole.output)[fine].max()
    assert numbers(found, "round-trip")[0] == pytest.approx(most, rel=0.006)
    seconds = qualify(off, record(time_unit="s"))
    assert all(name.endswith(" N / s") for name in seconds.by_rate)
    far = qualify(Off(invert(model()), 3.0), whole, max_error=5.0, rate=0.5)
    assert numbers(far, "large-error") == [pytest.approx(15, rel=0.06), 5]
    assert numbers(far, "below-max-error") == [5]
    assert numbers(far, "fast-enough") == pytest.approx([1e6 * far.latency.median, 0.5], rel=0.006)
    assert numbers(far, "loop-removed") == [pytest.approx(far.loop.ratio, rel=0.06, abs=1e-9)]


class Band(NamedTuple):
    value: np.ndarray
    deviation: np.ndarray
    draws: np.ndarray | None = None


class Ensemble:
    """Estimates with a deviation, and two draws where asked."""

    def __init__(self, deviation: float, draws: bool):
        self.deviation, self.draws = deviation, draws

    def simulate(self, t, y):
        value = np.asarray(invert(model()).simulate(t, y).value)
        draws = np.stack([value - 1, value + 2]) if self.draws else None
        return Band(value, np.full(len(y), self.deviation), draws)


@pytest.mark.parametrize(("draws", "worst"), [(False, NORMAL_95 * 0.5), (True, 2.0)])
def test_the_worst_of_an_ensemble_counts(draws, worst):
    found = qualify(invert(model()), record(), ensemble=Ensemble(0.5, draws), max_error=0.1)
    assert (found.doubt.worst, found.doubt.coverage) == (pytest.approx(worst), 1)
    assert found.level == "CAUTION"
    assert numbers(found, "posterior-error") == [pytest.approx(worst, rel=0.006)]
    assert numbers(found, "coverage") == [90, 100]


@pytest.mark.parametrize("need", [0.0, -1.0, np.inf, np.nan])
@pytest.mark.parametrize("name", ["max_error", "rate"])
def test_a_need_that_can_never_be_met_is_refused(name, need):
    with pytest.raises(InputError, match="can never be met"):
        qualify(invert(model()), record(), **{name: need})


def test_no_row_and_several_inputs_are_refused():
    with pytest.raises(InputError, match="no row counts"):
        qualify(invert(model()), replace(record(), mask=np.zeros(len(record()), bool)))
    u = stroke()
    columns = {"a": u, "b": u + 1}
    two = Record.from_arrays(None, u, columns=columns, channels={"a": "1", "b": "1"})
    refuses("not-invertible", lambda: qualify(invert(model()), two), "2 inputs")
