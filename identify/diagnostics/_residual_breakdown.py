"""Where a fit is wrong: its residuals by branch, cycle, rate and input."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float

from hysteresis import AbstractModel, Note, Record
from hysteresis._format import ends
from hysteresis._verdict import warning
from hysteresis.models._viscoelastic import AbstractViscoelastic
from hysteresis.records._cycles import loop_sums
from hysteresis.records._excitation import WIDER, noise_over_input

from .._levels import CHANCE, HELD, LITTLE, MUCH, SEAM
from ..noise._residual_statistics import estimate_noise
from ..results._fit_result import FitResult
from ..results._repeatability import cycles_or_sequences
from ..results._trained_condition import Extrapolation, RowsBeyond
from ._whiteness import has_one_speed, speed

Kind = Literal["branch", "cycle", "rate", "input"]
KINDS: tuple[Kind, ...] = ("branch", "cycle", "rate", "input")
RANGES = 5
"""Bins of the input; of the rate one fewer."""


class Part(NamedTuple):
    """Some of the rows: their number, the root and mean of their residuals, and what they add to the whole.

    - `share`: of the sum of squares; those of one kind add up to 1.
    - `excess`: mean square over that of all rows, less 1, in deviations of what chance would make it.
    """

    kind: Kind
    name: str
    rows: int
    rmse: float
    bias: float
    share: float
    excess: float


class Breakdown(NamedTuple):
    """Residuals of a record in parts; `said`: where it is worst, in words."""

    parts: tuple[Part, ...]
    said: str

    def of(self, kind: Kind) -> tuple[Part, ...]:
        """The parts of one kind."""
        return tuple(part for part in self.parts if part.kind == kind)


def breakdown(fit: FitResult, record: Record | None = None) -> Breakdown:
    """Residuals, predicted - measured, times the rows' weights, by branch, cycle, rate and input.

    Branches rise, fall, or rest: less than a thousandth of the fastest change. Cycles are sequences where
    there are several. Rates are quantiles of the speed of the rows that move, where there is more than one
    speed; inputs are equal parts of the range.

    **Arguments:** `record`, as the model sees it, `fit.test` for instance; the fitted rows unless given.

    **Example:**

        >>> parts = identify.breakdown(fit)
        >>> [part.name for part in parts.of("branch")]
        ['rising', 'falling']
    """
    if record is None:
        record, used = fit.train, fit.used
        residuals = fit.residuals
    else:
        used = record.mask
        residuals = fit.predict(record) - record.output
    residuals = record.weights * residuals
    r = residuals[used]
    sequences = [residuals[rows][used[rows]] for _, rows in record.sequences() if used[rows].any()]
    time = estimate_noise(sequences).correlation_time
    total = float(np.sum(r**2)) or 1.0
    parts = tuple(
        _part(kind, names[k], inside, total / len(r), total, time)
        for kind, names, which in _cuts(record, used)
        for k, inside in _grouped(r, which)
    )
    return Breakdown(parts, _in_words(parts, record))


def _cuts(record: Record, used: np.ndarray) -> Iterator[tuple[Kind, list[str], np.ndarray]]:
    """Of each kind the names of its parts, and the number of the part of each used row."""
    v, u = speed(record)[used], record.input[used]
    fastest = float(np.abs(v).max(initial=0.0))
    moves = np.abs(v) > 1e-3 * fastest
    yield "branch", ["rising", "falling", "rest"], np.where(moves, np.where(v > 0, 0, 1), 2)
    names, which = cycles_or_sequences(record)
    yield "cycle", names, which[used]
    if not has_one_speed(v):
        time = (
            "row"
            if record.time is None
            else "time"
            if record.time_unit == "1"
            else record.time_unit
        )
        edges = [float(x) for x in np.quantile(np.abs(v[moves]), np.linspace(0, 1, RANGES))]
        # Rates that hardly differ are one: 1 to 1.01 says nothing.
        apart = [edges[0]]
        apart += [edge for edge in edges[1:-1] if edge > 1.3 * apart[-1]]
        edges = np.array([*apart, edges[-1]])
        names, which = _bins(np.abs(v), edges, f"{record.input_unit}/{time}")
        yield "rate", [*names, "rest"], np.where(moves, which, len(names))
    yield "input", *_bins(u, np.linspace(u.min(), u.max(), RANGES + 1), record.input_unit)


def _bins(x: np.ndarray, edges: np.ndarray, unit: str) -> tuple[list[str], np.ndarray]:
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    return [ends(*two, unit, 3) for two in pairwise(edges)], which


def _grouped(r: np.ndarray, which: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """The residuals of each part that has any, in order, with its number."""
    order = np.argsort(which, kind="stable")
    numbers, first = np.unique(which[order], return_index=True)
    yield from zip(numbers.tolist(), np.split(r[order], first[1:]), strict=True)


def _part(
    kind: Kind, name: str, inside: Float[np.ndarray, " _"], whole: float, total: float, time: float
) -> Part:
    square = float(np.mean(inside**2))
    # The mean of m squares of Gaussian residuals has the relative deviation sqrt(2 / m).
    chance = np.sqrt(2 * max(time, 1.0) / len(inside))
    share = float(np.sum(inside**2)) / total
    return Part(kind, name, len(inside), float(np.sqrt(square)), float(inside.mean()), share,
                float((square / whole - 1) / chance))  # fmt: skip


def _in_words(parts: tuple[Part, ...], record: Record) -> str:
    worst = max(parts, key=lambda part: part.excess)
    rows = sum(part.rows for part in parts if part.kind == worst.kind)
    whole = sum(part.rmse**2 * part.rows for part in parts if part.kind == worst.kind) / rows
    # One family of parts in a hundred has one so far off by chance.
    clear = worst.excess > scipy.special.ndtri((1 - CHANCE) ** (1 / len(parts)))
    if not clear and worst.rmse < MUCH * np.sqrt(whole):
        return "The error is spread evenly over branches, cycles, rates and inputs."
    name = {"rate": f"rates of {worst.name}", "input": f"inputs of {worst.name}"}.get(
        worst.kind, f"sequence {worst.name}" if len(record.labels) > 1 and worst.kind == "cycle"
        else worst.name,
    )  # fmt: skip
    unit = "" if record.output_unit == "1" else f" {record.output_unit}"
    leans = ""
    if abs(worst.bias) > 0.5 * worst.rmse:
        leans = f", the model {'above' if worst.bias > 0 else 'below'} the reading there"
    return (
        f"Worst at {name}: rms {worst.rmse:.3g}{unit}, {worst.rmse / np.sqrt(whole):.1f} times that of all"
        f" rows; {100 * worst.share:.0f} % of the squared error in {100 * worst.rows / rows:.0f} % of the"
        f" rows{leans}{'' if clear else '; that may be chance'}."
    )


# Which held-out rows lie beyond the inputs, rates and hold times of the fitted ones.

# How wide the loops of a record are, and how much of that the residuals of a fit keep.


class LoopsLeft(NamedTuple):
    """Mean distance between rising and falling branches of the fitted rows, in the output's unit.

    - `width`: of the measured loops. `left`: of the residuals over the same input. NaN without a loop.
    - `noise`: standard deviation of the reading at an input from row to row; two branches with nothing but
      noise are 1.1 times that apart. `span`: range of the output.
    """

    width: float
    left: float
    noise: float
    span: float

    @property
    def are_there(self) -> bool:
        """Whether there are loops that the noise cannot make."""
        return self.width > max(WIDER * self.noise, LITTLE * self.span)

    @property
    def share(self) -> float:
        """Part of the width that the fit does not describe."""
        return self.left / self.width


def loops_left(fit: FitResult) -> LoopsLeft:
    """Loops in the measured output and in the residuals, over the rows that were fitted."""
    record, used, y = fit.train, fit.used, fit.train.output
    return LoopsLeft(
        loop_sums(record, y, used).width,
        loop_sums(record, fit.residuals, used).width,
        noise_over_input(record, used),
        float(np.ptp(y[used])) if used.any() else 0.0,
    )


# Time constants that a record cannot show: longer than it lasts, shorter than its sampling steps.


def unseen_time_constants(model: AbstractModel, record: Record) -> list[Note]:
    """A note for every branch whose time constant lies outside the times that the record shows.

    The shortest is the step of the clock that follows a change of the input, the median over all changes: a
    hold whose rows come ever more seldom shows what is over in its first second.

    An element that creeps flows like a dashpot for much less than its time constant, and gives way
    like a spring after much more; one that relaxes the other way round. Of the two parameters of such
    a branch the record knows one.
    """
    if not isinstance(model, AbstractViscoelastic) or record.time is None:
        return []
    sequences = [(record.time[rows], record.input[rows]) for _, rows in record.sequences()]
    span = max(float(np.ptp(t)) for t, _ in sequences)
    # Before its first row a model is at rest.
    changes = np.concatenate([np.abs(np.diff(u, prepend=0.0))[:-1] for _, u in sequences])
    steps = np.concatenate([np.diff(t) for t, _ in sequences])
    order = np.argsort(steps)
    passed = np.cumsum(changes[order])
    step = float(steps[order][np.searchsorted(passed, passed[-1] / 2)])
    found, unit = [], record.time_unit
    with np.errstate(divide="ignore"):
        constants = 1 / np.asarray(model.chain().rates)
    for number, constant in enumerate(constants, start=1):
        if step <= constant <= span:
            continue
        slow = constant > span
        than = f"longer than the record ({span:.3g} {unit})"
        mend = "measure longer holds"
        if not slow:
            than = f"shorter than the sampling steps ({step:.3g} {unit})"
            mend = "sample faster"
        seen = "dashpot" if slow == model.creeps else "spring"
        said = f"Branch {number} has a time constant of {constant:.3g} {unit}, {than}: it is"
        said += f" identifiable only as a {seen}; {mend}, or fit a model without it."
        found.append(warning("unseen-time-constant", said))
    return found


def extrapolation(fit: FitResult, predicted: Float[np.ndarray, " samples"]) -> Extrapolation | None:
    """Count and score the held-out rows beyond what was fitted; None where nothing was held out.

    `predicted`: the fit's prediction of its test record.
    """
    if (test := fit.test) is None:
        return None
    beyond = rows_beyond(fit, test)
    error = test.weights * (predicted - test.output)

    def scored(rows: np.ndarray) -> RowsBeyond:
        rows = rows & test.mask
        rmse = float(np.sqrt(np.mean(error[rows] ** 2))) if rows.any() else None
        return RowsBeyond(int(rows.sum()), rmse)

    inside = ~np.logical_or.reduce([*beyond.values()])
    return Extrapolation(*(scored(rows) for rows in (*beyond.values(), inside)))


def rows_beyond(fit: FitResult, test: Record) -> dict[str, Bool[np.ndarray, " samples"]]:
    """Of each row of `test`: is its input, a channel or a condition, its rate or the time it is held beyond
    that of the fitted rows?"""
    train, used = fit.train, fit.used
    span = float(np.ptp(train.input[used]))
    found = {"input": fit.beyond(test)}
    if train.time is None or test.time is None:
        nothing = np.zeros(len(test), bool)
        return found | {"rate": nothing, "time": nothing}
    for name, of in (
        ("rate", lambda record: np.abs(speed(record))),
        ("time", lambda record: held_for(record, HELD * span)),
    ):
        found[name] = of(test) > (1 + SEAM) * of(train)[used].max(initial=0.0)
    return found


def held_for(record: Record, band: float) -> Float[np.ndarray, " samples"]:
    """For how long the input of each row has stayed within `band` of where it then came to rest."""
    assert record.time is not None
    found = np.zeros(len(record))
    for _, rows in record.sequences():
        t, since, level = record.time[rows], 0, record.input[rows.start]
        for k, x in enumerate(record.input[rows].tolist()):
            if abs(x - level) > band:
                since, level = k, x
            found[rows.start + k] = t[k] - t[since]
    return found
