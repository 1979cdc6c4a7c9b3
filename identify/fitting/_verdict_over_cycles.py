"""Reasons of a verdict that show from cycle to cycle: rows left out, change, growing errors, sizes."""

from typing import NamedTuple

import numpy as np

from hysteresis import Note, Record
from hysteresis._format import quantity
from hysteresis.records._change import change
from hysteresis.records._cycles import counted_cycles

from .._levels import MUCH
from ..records._folds import KIND
from ..results._detail import DiscreteSpectrum
from ..results._fit_result import FitResult

GOOD = 5.0
"""Error in per cent, of the range of the rows, of their own loops or for holds of the reading, up to
which a fit passes."""


class Reasons(NamedTuple):
    """Notes that make a verdict FAIL, that make it CAUTION, and that are good to know."""

    fails: list[Note]
    cautions: list[Note]
    facts: list[Note]


class _Loop(NamedTuple):
    """A cycle: range of its input, rms error, and range of its output, over the rows that count."""

    span: float
    rmse: float
    output: float


def over_cycles(fit: FitResult, found: Reasons) -> None:
    """All of them."""
    if isinstance(fit.detail, DiscreteSpectrum):
        return
    _left_out(fit, found)
    _changes(fit, found)
    if fit.test is None:
        return
    error = fit.test.weights * (fit.predict(fit.test) - fit.test.output)
    each = _loops(fit.test, fit.test.mask, error)
    _grows(fit, each, found)
    _sizes(fit, [one for loops in each for one in loops], found)


def _left_out(fit: FitResult, found: Reasons) -> None:
    """Rows that count and that the fit did not use, or the map of its channels."""
    rows, left = int(fit.train.mask.sum()), int((fit.train.mask & ~fit.used).sum())
    if left:
        text = (
            f"The fit leaves out {left} of {rows} training rows, those of the first cycles: without them it"
            " predicts held-out cycles better (--conditioning keep uses all rows)."
        )
        found.facts.append(Note("settling", text, {"rows": left, "of": rows}))
    for note in map(Note.of, fit.train.history):
        if note.code == "settled":
            found.facts.append(Note("settling", note.text, note.values))


def _changes(fit: FitResult, found: Reasons) -> None:
    """A specimen that changes, over as many cycles again, by more than the error that is told."""
    one = change(fit.train)
    judged = fit.metrics["test"] or fit.metrics["train"]
    if one is None or judged is None or not one.is_sure:
        return
    if abs(one.rate) * one.cycles <= judged.rmse:
        return
    unit = fit.train.output_unit
    text = (
        f"The specimen still changes: at the same inputs its output moves by {quantity(one.rate, unit, 2)}"
        f" +- {quantity(one.error, unit, 1)} a cycle"
    )
    values = {"rate": one.rate, "error": one.error, "cycles": one.cycles}
    if fit.train.time is not None and fit.train.time_unit == "s" and one.duration > 0:
        hourly = one.rate * 3600 / one.duration
        text += f" ({quantity(hourly, unit, 2)} an hour)"
        values["hourly"] = hourly
    # A compensator runs for longer than its record.
    where = found.facts if fit.purpose == "predict" else found.cautions
    where.append(Note("drift", f"{text}.", values))


def _grows(fit: FitResult, each: list[list[_Loop]], found: Reasons) -> None:
    """An error that grows from held-out cycle to held-out cycle, of the sequence with most of them."""
    errors = np.array([loop.rmse for loop in max(each, key=len, default=[])])
    if len(errors) < 3:
        return
    third = len(errors) // 3
    first, last = (float(np.sqrt(np.mean(part**2))) for part in (errors[:third], errors[-third:]))
    ranks = np.argsort(np.argsort(errors))
    rises = float(np.corrcoef(ranks, np.arange(len(errors)))[0, 1])
    # At that rate it doubles within twice the held-out cycles, as `worse-than-trained` allows.
    if not (last > MUCH * first and rises > 0.8):
        return
    unit = fit.train.output_unit
    text = (
        f"The error grows over the {len(errors)} held-out cycles, from {quantity(first, unit, 3)} rms in"
        f" the first to {quantity(last, unit, 3)} in the last: further cycles will be worse than the error"
        " told."
    )
    values = {"cycles": len(errors), "first": first, "last": last}
    found.cautions.append(Note("growth", text, values))


def _sizes(fit: FitResult, held: list[_Loop], found: Reasons) -> None:
    """Held-out loops of a size that no trained loop has."""
    train = fit.train
    trained = [
        loop.span for loops in _loops(train, fit.used, np.zeros(len(train))) for loop in loops
    ]
    others = [x for x in held if all(abs(x.span - span) > KIND * span for span in trained)]
    if not others or not trained:
        return
    error = float(np.sqrt(np.mean([x.rmse**2 for x in others])))
    percent = 100 * error / float(np.sqrt(np.mean([x.output**2 for x in others])))
    unit, spans = train.input_unit, [x.span for x in others]
    text = (
        f"{len(others)} of {len(held)} held-out loops have a size that no trained one has"
        f" ({min(spans):.3g} to {quantity(max(spans), unit, 3)}; trained {min(trained):.3g} to"
        f" {quantity(max(trained), unit, 3)}): the error there is {quantity(error, train.output_unit, 3)}"
        f" rms, {percent:.2g} % of their own range."
    )
    values = {"loops": len(others), "of": len(held), "rmse": error, "percent": percent}
    where = found.cautions if percent > GOOD else found.facts
    where.append(Note("other-loops", text, values))


def _loops(record: Record, used: np.ndarray, error: np.ndarray) -> list[list[_Loop]]:
    """Of each sequence the cycles of which at least half of the rows are used."""
    counted = used & np.isfinite(record.output)

    def told(rows: slice) -> _Loop:
        u, y, e = (x[rows][counted[rows]] for x in (record.input, record.output, error))
        return _Loop(float(np.ptp(u)), float(np.sqrt(np.mean(e**2))), float(np.ptp(y)))

    return [[told(one.rows) for one in cycles] for cycles in counted_cycles(record, counted)]
