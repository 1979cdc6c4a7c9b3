"""Whether a compensator can be used: its errors on a record, the loop it leaves, its time, in words."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from hysteresis import AbstractModel, InputError, Note, Record
from hysteresis._format import ends, plain, quantity
from hysteresis._verdict import Level, Verdict
from hysteresis.models._conditioned import with_condition
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.records._abstract_record import over
from hysteresis.records._cycles import counted_cycles

from ._contract import AbstractCompensator, Status
from ._readings import Simulates, check_units, estimate, readings_of
from .guards._guarded import limited
from .uncertainty._ensemble import UncertainEstimate
from .uncertainty._guaranteed import flat_intervals

# How wide the loops of a record are, and how much of that a compensator leaves.

LEVELS = 32
"""Equal parts of what both branches of a cycle pass, in each of which their gap is taken."""


class Loop(NamedTuple):
    """How wide the loops are, in the input's unit, as means over `cycles`; NaN where there are none.

    - `before`: between the inputs of both branches at one output.
    - `after`: between the errors of both branches at one input.
    """

    before: float
    after: float
    cycles: int

    @property
    def ratio(self) -> float:
        """Part of the width that is left: 0 after a perfect compensator; NaN where no loop was."""
        return self.after / self.before if self.before > 0 else float("nan")


def loop_widths(record: Record, estimate: Float[np.ndarray, " samples"]) -> Loop:
    """How wide the loops are before and after a compensator, e = input - estimate:

        before = mean over cycles and y of |u_rising(y) - u_falling(y)|
        after  = mean over cycles and u of |e_rising(u) - e_falling(u)|

    over `LEVELS` equal parts of the y, or u, that both branches of a cycle pass; each branch's value is
    the mean over the part of its rows joined by straight lines. Where y turns with u both widths are the
    loop's area over a range, so a straight line through the ends of a closed loop leaves all: a ratio of
    1. Noise of the output widens what is left. Only counted rows of complete cycles are taken.
    """
    u, y, error = record.input, record.output, record.input - estimate
    found = []
    for cycles in counted_cycles(record, record.mask, share=0.0):
        for _, rows, _ in cycles:
            inside = rows.start + np.flatnonzero(record.mask[rows])
            legs = [inside[record.branch[inside] == sign] for sign in (1, -1)]
            if min(map(len, legs)) < 3:
                continue
            widths = _width(y, u, legs), _width(u, error, legs)
            if np.isfinite(widths).all():
                found.append(widths)
    before, after = np.mean(found, axis=0).tolist() if found else [float("nan")] * 2
    return Loop(before, after, len(found))


def _width(level: np.ndarray, value: np.ndarray, legs: list[np.ndarray]) -> float:
    """Mean distance between the values of two legs at one level; NaN where they share none."""
    low, high = max(level[x].min() for x in legs), min(level[x].max() for x in legs)
    if not high > low:
        return float("nan")
    edges = np.linspace(low, high, LEVELS + 1)
    rising, falling = (_means(level[x], value[x], edges) for x in legs)
    return float(np.abs(rising - falling).mean())


def _means(level: np.ndarray, value: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Between each two edges the mean of the values joined by straight lines; ties are averaged."""
    at, which, count = np.unique(level, return_inverse=True, return_counts=True)
    grid = np.union1d(at, edges)
    joined = np.interp(grid, at, np.bincount(which, value) / count)
    steps = np.diff(grid) * (joined[1:] + joined[:-1]) / 2
    area = np.append(0.0, np.cumsum(steps))[np.searchsorted(grid, edges)]
    return np.diff(area) / np.diff(edges)


# The time of a step, here and on the target, and whether it keeps up with a rate.


class Latency(NamedTuple):
    """Seconds of one compiled step, called from Python on this machine; `tail` is the 99.9 % quantile."""

    median: float
    tail: float
    steps: int


class Step(NamedTuple):
    """What one step takes on the target: its name, seconds in the mean and at most, NaN where they are not
    known, and operations in the mean and at most, as they were counted on readings."""

    target: str
    mean: float = float("nan")
    most: float = float("nan")
    operations: float | None = None
    most_operations: int | None = None


def latency(
    compensator: AbstractCompensator, record: Record, steps: int = 2000, seconds: float = 1.0
) -> Latency:
    """Time one compiled step after the other on a record's first rows, for so many steps or seconds."""
    step = jax.jit(lambda state, t, y: compensator.step(state, t, y))
    clock = np.zeros(len(record)) if record.time is None else record.time
    readings = readings_of(compensator, record)
    rows = np.arange(min(steps, int(np.append(record.starts[1:], len(record))[0])))
    state = compensator.init()
    for k in rows[[0, 0, 0]]:  # compiled twice: a first state may be weakly typed
        state, _ = jax.block_until_ready(step(state, clock[k], readings[k]))
    state, taken = compensator.init(), []
    end = time.perf_counter() + seconds
    for k in np.resize(rows, steps):
        begin = time.perf_counter()
        state, _ = jax.block_until_ready(step(state, clock[k], readings[k]))
        taken.append(time.perf_counter() - begin)
        if begin > end:
            break
    return Latency(float(np.median(taken)), float(np.quantile(taken, 0.999)), len(taken))


def speed(found: dict[str, Any]) -> tuple[str, Note] | None:
    """The level and the note of what is said of the rate that is needed."""
    if (rate := found["rate"]) is None:
        return None
    step = found["step"] or Step("JAX, called from Python here,", found["latency"].median)
    if step.operations is not None and not np.isfinite(step.mean):
        text = (
            f"A step in {step.target} takes {step.operations:,.0f} operations in the mean and"
            f" {step.most_operations:,} at most on the training's readings: {rate:g} Hz needs a processor"
            f" of {1e-6 * rate * step.most_operations:.3g} million operations a second."
        )
        return "PASS", Note("needs-processor", text)
    mean, most = (f"{1e6 * x:.3g} µs" for x in (step.mean, step.most))
    one = f"A step in {step.target} takes {mean}:"
    if step.mean > 1 / rate:
        return "FAIL", Note("too-slow", f"{one} too long for {rate:g} Hz.")
    if step.most > 1 / rate:
        text = f"Some steps in {step.target} take {most}: too long for {rate:g} Hz."
        return "CAUTION", Note("sometimes-slow", text)
    return "PASS", Note("fast-enough", f"{one} {rate:g} Hz can be kept up.")


NOT_OK, LEFT, ERROR, ROUND_TRIP = 0.01, 0.5, 5.0, 1e-6
"""What makes for CAUTION: share of samples not OK, part of the loop's width left, NRMSE in per cent, and
part of the output's range by which the model's answer to an estimate misses the output."""

RUN_IN = 0.5
"""Share of samples before the first state is known that makes for CAUTION: most of a record tells it."""

Tell = Callable[[int, int, str], None]

WORSE = 1.05
"""A compensator whose rms error is above this times that of a straight line fails. An exact inverse of a
noisy straight line errs by 1 + noise^2 / (2 signal^2) times the regression's error, below 1.05 up to noise
of 30 %."""


class Errors(NamedTuple):
    """Errors estimate - input over some rows, in the input's unit.

    - `rmse`, `max_abs`, `bias`: root mean square, largest, mean. `q95`: what 95 % of them stay within.
    """

    rows: int
    rmse: float
    q95: float
    max_abs: float
    bias: float


class Doubt(NamedTuple):
    """What a posterior leaves open, in the input's unit.

    - `worst`: the largest error of any draw, or of the 90 % band's ends where draws are not told apart.
    - `coverage`: share of the true inputs within the 90 % band, value +- 1.64 deviations.
    """

    worst: float
    coverage: float


@dataclass(frozen=True)
class Qualification:
    """What `qualify` found.

    - `verdict`: `level` and `reasons`.
    - `errors`: over all counted rows; `nrmse_percent`: 100 rmse / range of the input there.
    - `by_branch`, `by_rate`, `by_level`: of rising and falling inputs, of thirds of the rows by |du/dt|
      (empty without a clock), and by input.
    - `line_rmse`: rms error of the straight line from output to input that fits these very rows best, in
      the input's unit; None where the output is constant.
    - `loop`: `loop_widths`. `statuses`: share of the rows by `Status`.
    - `output_range`: outputs whose estimates were OK, None where none was.
    - `round_trip`: largest |model(estimate) - output| over OK rows, in the output's unit; `flat_width`:
      of the widest interval of inputs that a FLAT row leaves open, within the record's. None without a
      model, or an OK row. `latency`: of one step here; `step`: of one on the target, None where that was
      not given. `doubt`: of an ensemble, None without one.
    """

    verdict: Verdict
    errors: Errors
    nrmse_percent: float
    line_rmse: float | None
    by_branch: dict[str, Errors]
    by_rate: dict[str, Errors]
    by_level: dict[str, Errors]
    loop: Loop
    statuses: dict[str, float]
    output_range: tuple[float, float] | None
    round_trip: float | None
    flat_width: float | None
    latency: Latency
    doubt: Doubt | None
    max_error: float | None
    rate: float | None
    step: Step | None
    names: dict[str, str]

    @property
    def level(self) -> Level:
        """Of the verdict."""
        return self.verdict.level

    @property
    def reasons(self) -> tuple[str, ...]:
        """Of the verdict."""
        return self.verdict.reasons

    @property
    def document(self) -> dict[str, Any]:
        """Plain data for JSON: NaN is None."""
        found = asdict(self)
        for name in ("errors", "loop", "latency", "doubt", "step"):
            if (value := getattr(self, name)) is not None:
                found[name] = value._asdict()
        found["verdict"] = self.verdict.document
        for name in ("by_branch", "by_rate", "by_level"):
            found[name] = {k: errors._asdict() for k, errors in getattr(self, name).items()}
        found["loop"]["ratio"] = self.loop.ratio
        return plain(found)

    @property
    def text(self) -> str:
        """For a terminal: the verdict, then the figures."""
        unit, other = self.names["input_unit"], self.names["output_unit"]
        lines = [f"{self.level}: {self.names['input']} estimated from {self.names['output']}"]
        lines += [f"  {reason}" for reason in self.reasons]
        head = f"error{'' if unit == '1' else f' in {unit}'}"
        lines.append(f"{head:38}{'rows':>8}{'rms':>11}{'95 %':>11}{'worst':>11}{'mean':>11}")
        parts = {"all": self.errors} | self.by_branch | self.by_rate | self.by_level
        lines += [
            f"  {name:36}{e.rows:8d}{e.rmse:11.3g}{e.q95:11.3g}{e.max_abs:11.3g}{e.bias:11.2g}"
            for name, e in parts.items()
        ]
        if np.isfinite(self.loop.ratio):
            before, after = (quantity(x, unit, 3) for x in self.loop[:2])
            lines.append(
                f"loop width: {before} before, {after} after, {self.loop.ratio:.3g} of it is left"
                f" (mean of {self.loop.cycles} cycles)"
            )
        wide = f", within {quantity(self.flat_width, unit, 3)}" if self.flat_width else ""
        lines.append(f"samples: {_shares(self.statuses)}{wide}")
        if self.output_range is not None:
            lines.append(f"OK for {self.names['output']} of {ends(*self.output_range, other, 3)}")
        if self.round_trip is not None:
            lines.append(f"round trip: within {quantity(self.round_trip, other, 3)} where OK")
        median, tail = (f"{1e6 * x:.3g} µs" for x in self.latency[:2])
        lines.append(
            f"one step of JAX, called from Python here: {median}, {tail} once in a thousand"
            f" ({self.latency.steps} timed)"
        )
        if self.doubt is not None:
            lines.append(
                f"posterior: {quantity(self.doubt.worst, unit, 3)} at worst;"
                f" 90 % band holds {100 * self.doubt.coverage:.3g} %"
            )
        return "\n".join(lines)


def qualify(
    compensator: AbstractCompensator,
    record: Record,
    model: AbstractModel | None = None,
    ensemble: Simulates[UncertainEstimate] | None = None,
    max_error: float | None = None,
    rate: float | None = None,
    step: Step | None = None,
    progress: Tell = lambda done, total, text: None,
) -> Qualification:
    """A verdict on a compensator from a record it has not seen, each sequence from the virgin state.

    FAIL: an estimate that is not finite, an error above `max_error`, an rms error more than 5 % above that
    of the straight line that fits these rows best, a mean step on the target longer than 1 / `rate`.
    CAUTION: some step on the target longer than that; more than half of the rows RUN_IN, where the first
    state is not known; more than 1 % neither OK nor RUN_IN; more than half of
    the loop's width left, or no loop to tell by; an NRMSE above 5 %; a round trip that misses by more
    than a millionth; draws of the ensemble with errors above `max_error`.

    **Arguments:**

    - `record`: input and output as measured; the rows of its mask count, all of them drive.
    - `model`: what `compensator` inverts, for the round trip.
    - `ensemble`: `simulate(t, y)` of it gives `value` and `deviation`, (samples,), and may give `draws`,
        (draws, samples): an `EnsembleCompensator`.
    - `max_error`, in the input's unit, and `rate`, in Hz: what is needed. `step`: what a step takes on
        the target that has to keep up; without it the target is the compiled step, called from Python here.
    - `progress(done, total, text)` is called after each of a few parts.

    Raises `InputError` `bad-option`, `no-rows`, `wrong-unit`, or `not-invertible` where the record has
    several inputs.

    **Example:**

        >>> found = compensate.qualify(compensate.invert(fit.model), record, max_error=20.0)
        >>> found.errors.rows
        101
    """
    _check(record, max_error, rate)
    check_units(compensator.units, record)
    u, y, used = record.input, record.output, record.mask
    parts = 4 if ensemble is None else 5
    told = estimate(compensator, record)
    value, status = np.asarray(told.value), np.asarray(told.status)
    progress(1, parts, "estimates")
    error = value - u
    fine = used & (status == Status.OK)
    span = float(np.ptp(u[used]))
    errors = _errors(error[used])
    shares = Counter(status[used].tolist())
    back = flat_width = None
    if model is not None:
        inner, held = limited(compensator, value)
        own = told if inner is compensator else estimate(inner, record)
        # Readings that the training had are OK where the model is saturated by them.
        held |= np.asarray(own.status) == Status.SATURATED
        driven = with_condition(model, record, np.asarray(own.value))
        again = model.simulate(record.time, driven, starts=tuple(record.starts.tolist()))
        if (rows := fine & ~held).any():
            back = float(np.abs(again - y)[rows].max())
        flat_width = _flat_width(model, record, value, used & (status == Status.FLAT))
    progress(2, parts, "round trip")
    unit = over(record.input_unit, record.time_unit)
    found: dict[str, Any] = {
        "errors": errors,
        "nrmse_percent": 100 * errors.rmse / span if span > 0 else float("nan"),
        "line_rmse": line_error(record),
        "by_branch": {
            name: _errors(error[rows])
            for name, sign in (("rising", 1), ("falling", -1))
            if (rows := used & (record.branch == sign)).any()
        },
        "by_rate": _thirds("|du/dt|", _speeds(record), error, used, unit),
        "by_level": _thirds(record.input_name, u, error, used),
        "loop": loop_widths(record, value),
        "statuses": {Status(s).name: n / int(used.sum()) for s, n in sorted(shares.items())},
        "output_range": (float(y[fine].min()), float(y[fine].max())) if fine.any() else None,
        "round_trip": back, "flat_width": flat_width, "latency": None, "doubt": None,
        "max_error": max_error, "rate": rate, "step": step,
        "names": {
            "input": record.input_name, "input_unit": record.input_unit,
            "output": record.output_name, "output_unit": record.output_unit,
        },
    }  # fmt: skip
    progress(3, parts, "errors and loops")
    found["latency"] = latency(compensator, record)
    progress(4, parts, "time of a step")
    if ensemble is not None:
        found["doubt"] = _doubt(ensemble, record)
        progress(5, parts, "draws of the posterior")
    return Qualification(verdict=_judge(found, span, float(np.ptp(y[used]))), **found)


def line_error(record: Record) -> float | None:
    """Rms error of the straight line from output to input that fits a record's counted rows best.

    No line does better on these rows, so a compensator that is worse than this one is worse than every
    line. None where the output is constant.
    """
    u, y = record.input[record.mask], record.output[record.mask]
    if not np.ptp(y) > 0:
        return None
    rising = y - y.mean()
    slope = float(rising @ (u - u.mean()) / (rising @ rising))
    return float(np.sqrt(np.mean((u - u.mean() - slope * rising) ** 2)))


def _check(record: Record, max_error: float | None, rate: float | None) -> None:
    for name, option, value in (("max_error", "--max-error", max_error), ("rate", "--rate", rate)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(
                "bad-option", f"{name}={value:g} can never be met.", fix=f"a positive {option}."
            )
    if record.channels:
        raise InputError(
            "not-invertible",
            f"the record has {len(record.channels)} inputs, and one output does not tell them apart.",
            place=record.source,
        )
    if not record.mask.any():
        raise InputError("no-rows", "no row counts.", place=record.source)


def _flat_width(
    model: AbstractModel, record: Record, value: np.ndarray, flat: Bool[np.ndarray, " rows"]
) -> float:
    low, high = float(record.input.min()), float(record.input.max())
    widest = 0.0
    for _, rows in record.sequences():
        if flat[rows].any():
            t = None if record.time is None else record.time[rows]
            driven = with_condition(model, record, value)[rows]
            open_ = flat_intervals(model, t, driven, low, high, flat[rows])
            widest = max(widest, float(open_.width.max()))
    return widest


def _errors(error: Float[np.ndarray, " rows"]) -> Errors:
    size, rmse = np.abs(error), np.sqrt(np.mean(error**2))
    figures = rmse, np.quantile(size, 0.95), size.max(), error.mean()
    return Errors(len(error), *map(float, figures))


def _speeds(record: Record) -> Float[np.ndarray, " samples"] | None:
    if record.time is None:
        return None
    speed = np.zeros(len(record))
    for _, rows in record.sequences():
        if rows.stop - rows.start > 1:
            speed[rows] = np.abs(np.gradient(record.input[rows], record.time[rows]))
    return speed


def _thirds(
    name: str,
    value: Float[np.ndarray, " samples"] | None,
    error: Float[np.ndarray, " samples"],
    used: Bool[np.ndarray, " samples"],
    unit: str = "1",
) -> dict[str, Errors]:
    """Errors over thirds of the counted rows by a value; fewer where many share one, none if all do."""
    if value is None:
        return {}
    edges = np.quantile(value[used], [0.0, 1 / 3, 2 / 3, 1.0])
    edges = edges[np.append(True, np.diff(edges) > 0.01 * np.ptp(edges))]
    third = np.digitize(value, edges[1:-1])
    return {
        f"{name} {ends(edges[k], edges[k + 1], unit, 3)}": _errors(error[rows])
        for k in range(len(edges) - 1 if len(edges) > 2 else 0)
        if (rows := used & (third == k)).any()
    }


def _doubt(ensemble: Simulates[UncertainEstimate], record: Record) -> Doubt:
    found = estimate(ensemble, record)
    value, deviation = np.asarray(found.value), np.asarray(found.deviation)
    draws = getattr(found, "draws", None)
    error, used = np.abs(value - record.input), record.mask
    apart = draws is not None
    worst = np.abs(np.asarray(draws) - record.input) if apart else error + NORMAL_95 * deviation
    inside = error <= NORMAL_95 * deviation
    return Doubt(float(worst[..., used].max()), float(inside[used].mean()))


def _judge(found: dict[str, Any], input_span: float, output_span: float) -> Verdict:
    """The level, and sentences: how far off, then what is gravest."""
    notes: dict[str, list[Note]] = {"FAIL": [], "CAUTION": [], "PASS": []}

    names, errors, need = found["names"], found["errors"], found["max_error"]
    unit, share = names["input_unit"], found["nrmse_percent"]
    worst = quantity(errors.max_abs, unit, 3)
    text = (
        f"Estimates are off by {quantity(errors.rmse, unit, 3)} rms ({share:.2g} % of the range),"
    )
    said = Note("error", f"{text} by {worst} at most.")
    if not np.isfinite(errors.max_abs):
        notes["FAIL"].append(Note("not-finite", "Some estimates are not finite."))
    elif need is not None and errors.max_abs > need:
        text = f"The largest error is above the {quantity(need, unit, 3)} asked for;"
        text += f" 95 % of the rows stay within {quantity(errors.q95, unit, 3)}."
        notes["FAIL"].append(Note("above-max-error", text))
    elif need is not None:
        text = f"No error is above the {quantity(need, unit, 3)} asked for."
        notes["PASS"].append(Note("below-max-error", text))
    line = found["line_rmse"]
    if line is not None and errors.rmse > WORSE * line + ROUND_TRIP * input_span:
        text = f"The best straight line through these rows errs by {quantity(line, unit, 3)}"
        notes["FAIL"].append(Note("worse-than-line", f"{text} rms only."))
    if (timed := speed(found)) is not None:
        notes[timed[0]].append(timed[1])
    if share > ERROR:
        text = f"The error is {share:.2g} % of the range, above {ERROR:g} %."
        notes["CAUTION"].append(Note("large-error", text))
    early = found["statuses"].get("RUN_IN", 0.0)
    if early > RUN_IN:
        text = f"{100 * early:.3g} % of the estimates are RUN_IN: the readings seldom tell the first state."
        notes["CAUTION"].append(Note("run-in", text))
    elif early:
        text = f"The first state is taken as unknown: {100 * early:.3g} % of the estimates are"
        notes["PASS"].append(Note("run-in", f"{text} RUN_IN."))
    if 1 - early - found["statuses"].get("OK", 0.0) > NOT_OK:
        notes["CAUTION"].append(
            Note("not-ok", f"Not every estimate is OK: {_shares(found['statuses'])}.")
        )
    if flat := found["flat_width"]:
        text = "Where the model is flat the nearest input is held:"
        notes["PASS"].append(Note("flat", f"{text} up to {quantity(flat, unit, 3)} are open."))
    ratio = found["loop"].ratio
    if not np.isfinite(ratio):
        text = "No whole cycle has a loop, so how much of one is removed is not known."
        notes["CAUTION"].append(Note("no-loop", text))
    elif ratio > LEFT:
        text = f"Of the loop's width {ratio:.2g} is left: little hysteresis is removed."
        notes["CAUTION"].append(Note("loop-left", text))
    else:
        notes["PASS"].append(Note("loop-removed", f"Of the loop's width {ratio:.2g} is left."))
    if (back := found["round_trip"]) is not None and back > ROUND_TRIP * output_span:
        text = "Run forward, the estimates miss the output by up to"
        text += f" {quantity(back, names['output_unit'], 3)}: this is not the model's inverse."
        notes["CAUTION"].append(Note("round-trip", text))
    if (doubt := found["doubt"]) is not None:
        if need is not None and doubt.worst > need and not notes["FAIL"]:
            text = (
                f"Within the posterior errors reach {quantity(doubt.worst, unit, 3)}, above what is"
            )
            notes["CAUTION"].append(Note("posterior-error", f"{text} asked."))
        text = f"The posterior's 90 % band holds {100 * doubt.coverage:.2g} % of the true inputs."
        notes["PASS"].append(Note("coverage", text))
    level: Level = "FAIL" if notes["FAIL"] else "CAUTION" if notes["CAUTION"] else "PASS"
    return Verdict(level, (said, *notes["FAIL"], *notes["CAUTION"], *notes["PASS"]))


def _shares(statuses: dict[str, float]) -> str:
    return ", ".join(f"{100 * share:.3g} % {name}" for name, share in statuses.items())
