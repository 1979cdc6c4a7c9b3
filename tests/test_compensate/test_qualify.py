"""The verdict on a compensator, where what is right is known."""

import json
import re
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from compensate import (
    AbstractCompensator,
    Estimate,
    Qualification,
    Status,
    estimate,
    invert,
    qualify,
)
from compensate.qualification._qualify import Latency, Step, latency, loop_widths
from hysteresis import InputError, LinearSponge, PrandtlIshlinskii, Record, Scaled

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
        found = qualify(late, record(u))
        early = found.statuses["RUN_IN"]
        assert (early > 0.5) == (level == "CAUTION")
        (said,) = (reason for reason in found.verdict.reasons if reason.code == "run-in")
        assert f"{100 * early:.3g} %" in said
        assert found.verdict.level == level


class Off(AbstractCompensator[AbstractCompensator, Estimate]):
    """The inverse, off by so much, a status for every third sample, two thirds of the way to y / slope."""

    inner: AbstractCompensator
    by: float = 0.0
    status: int = 0
    slope: float | None = None

    def init(self):
        return self.inner.init()

    def step(self, state, t, y):
        state, (value, status) = self.inner.step(state, t, y)
        return state, Estimate(value + self.by, status)

    def simulate(self, t, y, state=None):
        value, status = self.inner.simulate(t, y, state)
        if self.slope is not None:
            value = (value + 2 * y / self.slope) / 3
        third = jnp.arange(len(y)) % 3 == 0
        return Estimate(value + self.by, jnp.where(third, self.status, status))


def test_a_perfect_compensator_removes_all():
    found = qualify(invert(model()), record(), model(), max_error=1e-6, rate=1.0)
    assert found.level == "PASS"
    assert found.errors.max_abs < 1e-9
    assert found.errors.rows == len(record())
    assert found.loop.cycles == 4
    assert found.loop.ratio < 1e-9
    assert found.round_trip is not None
    assert found.round_trip < 1e-9
    assert found.statuses == {"OK": 1.0}
    assert found.output_range == pytest.approx((record().output.min(), record().output.max()))
    assert 0 < found.latency.median <= found.latency.tail < 1


def test_the_width_before_is_that_of_the_loop():
    """Of a pure play of half width r the inputs of both branches are 2 r apart at every output."""
    r, u = 1.5, np.tile(np.concatenate([np.linspace(-10, 10, 4001), np.linspace(10, -10, 4001)]), 3)
    y = np.asarray(model(1e-6, r).simulate(None, u))
    loop = loop_widths(Record.from_arrays(u, y), u)
    assert loop.before == pytest.approx(2 * r, rel=1e-3)
    assert loop.after == 0


def lens(bulge: float, rows: int = 2001) -> tuple[np.ndarray, np.ndarray]:
    """Four closed loops between (-1, -1) and (1, 1): y = u -+ bulge (1 - u^2), down on the way up."""
    leg = np.linspace(-1, 1, rows)
    u = np.tile(np.concatenate([leg, leg[::-1]]), 4)
    side = np.tile(np.repeat([-1.0, 1.0], rows), 4)
    return u, u + side * bulge * (1 - u**2)


@pytest.mark.parametrize("bulge", [0.05, 0.4])
def test_a_line_removes_nothing(bulge: float):
    """Both widths are the loop's area, 8/3 bulge, over a range."""
    u, y = lens(bulge)
    loop = loop_widths(Record.from_arrays(u, 5 - 3 * y), y)
    assert loop.ratio == pytest.approx(1, abs=1e-3)
    assert loop.before == pytest.approx(4 / 3 * bulge, rel=1e-3)


def test_a_line_removes_nearly_nothing_of_a_loop_that_turns_later():
    phase = np.linspace(0, 8 * np.pi, 8001)
    u, y = np.sin(phase), np.sin(phase - 0.1)
    assert loop_widths(Record.from_arrays(u, y), y).ratio == pytest.approx(1, abs=0.02)


def test_half_of_the_hysteresis_is_half_of_the_width():
    u = stroke()
    line = record().output / np.ptp(record().output) * np.ptp(u)
    whole, half = (loop_widths(record(), line + part * (u - line)) for part in (0.0, 0.5))
    assert half.ratio == pytest.approx(whole.ratio / 2)
    assert half.before == whole.before


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


def test_parts_add_up_to_the_whole():
    found = qualify(Off(invert(model()), 0.5), record())
    for parts in (found.by_branch, found.by_rate, found.by_level):
        assert sum(part.rows for part in parts.values()) == found.errors.rows
        for part in parts.values():
            assert part[1:] == pytest.approx((0.5, 0.5, 0.5, 0.5))
    assert list(found.by_branch) == ["rising", "falling"]
    assert (len(found.by_rate), len(found.by_level)) == (3, 3)
    assert qualify(invert(model()), replace(record(), time=None)).by_rate == {}


@pytest.mark.parametrize(
    ("compensator", "needs", "level", "words"),
    [
        (Off(invert(model()), 0.4), {}, "PASS", "0.4 N rms"),
        (Off(invert(model()), 0.4), {"max_error": 0.3}, "FAIL", "above the 0.3 N asked for"),
        (Off(invert(model()), 0.4), {"max_error": 0.5}, "PASS", "No error is above the 0.5 N"),
        (Off(invert(model()), 3.0), {}, "FAIL", "of the range, above 5 %"),
        (Off(invert(model()), np.nan), {}, "FAIL", "not finite"),
        (Off(invert(model()), 0.0, int(Status.FLAT)), {}, "CAUTION", "% FLAT"),
        (invert(model()), {"rate": 1e9}, "FAIL", "too long for 1e+09 Hz"),
        (invert(model()), {"rate": 0.5}, "PASS", "0.5 Hz can be kept up"),
        (invert(model()), {"model": model(2.0)}, "CAUTION", "not the model's inverse"),
    ],
    ids=lambda x: str(x) if isinstance(x, (str, dict)) else "",
)
def test_verdicts_and_their_reasons(compensator, needs, level, words):
    found = qualify(compensator, record(), **needs)
    assert found.level == level
    assert ("not-finite" in found.verdict.codes) == (words == "not finite")
    assert any(words in reason for reason in found.reasons)


def test_a_slow_step_of_the_target_is_a_caution_and_one_of_this_computer_is_none(monkeypatch):
    slow = Latency(1e-5, 1e-2, 2000)
    monkeypatch.setattr("compensate.qualification._qualify.latency", lambda *_: slow)
    assert qualify(invert(model()), record(), rate=1000.0).level == "PASS"
    found = qualify(invert(model()), record(), rate=1000.0, step=Step("c", 1e-5, 1e-2))
    assert found.level == "CAUTION"
    assert numbers(found, "sometimes-slow") == [1e4, 1000]
    found = qualify(invert(model()), record(), rate=1000.0, step=Step("c", 1e-2, 1e-2))
    assert found.level == "FAIL"
    found = qualify(
        invert(model()),
        record(),
        rate=1000.0,
        step=Step("c", operations=500.0, most_operations=2000),
    )
    assert found.level == "PASS"
    assert numbers(found, "needs-processor")[-1] == 2.0  # 1000 steps of 2000 operations a second


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def numbers(found: Qualification, code: str) -> list[float]:
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
    assert numbers(found, "round-trip")[0] == pytest.approx(
        np.abs(again - whole.output)[fine].max(), rel=0.006
    )
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
    assert found.doubt is not None
    assert found.doubt.worst == pytest.approx(worst)
    assert found.doubt.coverage == 1
    assert found.level == "CAUTION"
    assert numbers(found, "posterior-error") == [pytest.approx(worst, rel=0.006)]
    assert numbers(found, "coverage") == [90, 100]


def test_samples_that_cannot_be_read_are_counted_by_their_status():
    whole = record()
    u, y = whole.input.copy(), whole.output.copy()
    y[100:110] = np.nan
    masked = Record.from_arrays(u, y, whole.time, nan="omit")
    found = qualify(invert(model()), masked)
    assert (found.errors.rows, found.statuses) == (len(u) - 10, {"OK": 1.0})
    assert found.errors.max_abs < 1e-9


def test_sequences_begin_anew():
    u = stroke(2, 100)
    y = np.asarray(model().simulate(None, u))
    two = Record.from_arrays(
        np.tile(u, 2), np.tile(y, 2), np.arange(400), np.repeat(["a", "b"], 200)
    )
    assert qualify(invert(model()), two).errors.max_abs < 1e-9


def test_json_and_text_say_the_same():
    found = qualify(Off(invert(model()), 0.5), record(), model(), max_error=0.4)
    document = json.loads(json.dumps(found.document, allow_nan=False))
    assert document["verdict"]["level"] == "FAIL"
    assert document["loop"]["ratio"] == pytest.approx(0, abs=1e-9)
    assert document["by_branch"]["rising"]["rmse"] == pytest.approx(0.5)
    assert document["max_error"] == 0.4
    lines = found.text.splitlines()
    assert lines[0] == "FAIL: force estimated from path"
    for word in (
        "loop width: ",
        "100 % OK",
        "round trip: ",
        "one step of JAX",
        "rising",
        "|du/dt|",
    ):
        assert word in found.text


def test_nan_is_null_in_json():
    rising = Record.from_arrays(np.linspace(0, 1, 50), np.linspace(0, 2, 50))
    found = qualify(invert(Scaled(model(), 1.0, 0.0)), rising)
    assert found.document["loop"]["ratio"] is None
    assert "loop width" not in found.text
    assert found.level == "FAIL"  # the line is exact here
    json.dumps(found.document, allow_nan=False)


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_few_rows_are_enough(rows: int):
    found = qualify(invert(model()), record(stroke()[:rows]))
    assert found.errors.rows == rows
    assert found.level == "CAUTION"


def test_latency_stops_in_time():
    found = latency(invert(model()), record(), steps=10**6, seconds=0.05)
    assert 1 < found.steps < 10**6


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
    with pytest.raises(InputError, match="2 inputs"):
        qualify(invert(model()), two)
