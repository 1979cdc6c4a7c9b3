"""The verdict on a fit that is to compensate: its compensator against a straight line."""

from dataclasses import replace
from typing import Any

import numpy as np

import identify
from compensate import Status, estimate, invert
from hysteresis import InputError, Note, Record
from hysteresis._format import quantity
from hysteresis._verdict import Level

from .._invert import invert as invert_fit

BAND, TWICE = 0.9, 2.0
"""What a band of 1.645 deviations says that it holds, and times that share of misses which is too many."""


def fitted_to_compensate(record: Record, *models: Any, **options: Any) -> identify.FitResult:
    """`identify.fit`, and for the purpose "compensate" a compensator that is tried and judged too."""
    if options.get("purpose") != "compensate":
        return identify.fit(record, *models, **options)
    return judged_to_compensate(identify.fit(record, *models, **options | {"purpose": "predict"}))


def judged_to_compensate(fit: identify.FitResult) -> identify.FitResult:
    """A fit with the verdict of a compensator made of it, on the held-out rows, or else on the fitted ones.

    FAIL: the model has no inverse, an estimate is not finite, or the straight line from output to input
    that was fitted to the training rows has a smaller rms error, by more than the standard error of the
    difference. CAUTION: the specimen still changes, because a compensator runs for longer than its record;
    the band of the estimates misses twice as many held-out inputs as it says. The error of the compensator
    is the first reason.
    """
    level, reasons = _compensator(fit)
    verdict = fit.verdict.at_most(level).at_most(
        "CAUTION" if "drift" in fit.verdict.codes else "PASS"
    )
    if level != "FAIL" and fit.test is not None:
        band = band_reason(getattr(invert_fit(fit), "coverage", float("nan")))
        verdict = verdict.at_most("PASS" if band is None else "CAUTION")
        reasons += [] if band is None else [band]
    verdict = verdict._replace(reasons=(*reasons, *verdict.reasons))
    fit = replace(fit, purpose="compensate", verdict=verdict)
    own = replace(fit, candidates=())
    return replace(fit, candidates=(own, *fit.candidates[1:]))


def band_reason(coverage: float) -> Note | None:
    """What to say of a 90 % band that holds this part of the held-out inputs; None where it is right."""
    if not coverage < 1 - TWICE * (1 - BAND):
        return None
    text = (
        f"The {100 * BAND:.0f} % band of the estimates holds {100 * coverage:.0f} % of the held-out"
    )
    text += " inputs."
    return Note("band", text, {"says": BAND, "coverage": coverage})


def _compensator(fit: identify.FitResult) -> tuple[Level, list[Note]]:
    record, rows, where = fit.train, fit.used, "the training rows"
    if fit.test is not None:
        record, rows, where = fit.test, fit.test.mask, "the held-out rows"
    try:
        if fit.channels is not None:
            count = len(fit.channels.names)
            said = f"{count} inputs cannot be recovered from one output."
            raise InputError("not-invertible", said)
        found = estimate(invert(fit.model, trained=fit.trained), record)
    except InputError as error:
        return "FAIL", [Note("not-invertible", f"There is no compensator: {error.problem}")]
    value, status = np.asarray(found.value), np.asarray(found.status)
    error, line = (value - record.input)[rows], (_line(fit, record) - record.input)[rows]
    if not np.isfinite(error).all() or (status[rows] == Status.INVALID).any():
        count = int((~np.isfinite(error) | (status[rows] == Status.INVALID)).sum())
        said = f"The compensator has no estimate in {count} of {rows.sum()} rows."
        return "FAIL", [Note("not-finite", said)]
    unit = record.input_unit
    of_both = [quantity(float(np.sqrt(np.mean(x**2))), unit, 3) for x in (error, line)]
    said = f"The compensator estimates {record.input_name} on {where} to {of_both[0]} rms"
    said += f" ({quantity(float(np.abs(error).max()), unit, 3)} at most)"
    blocks = (np.array(identify.internal.block_errors(x)) for x in (line, error))
    worse = identify.internal.root_difference(*blocks)
    least = 1e-9 * float(np.ptp(record.input[rows]))
    if worse is not None and worse.value > max(worse.error, least):
        apart = f"{quantity(worse.value, unit, 2)} +- {quantity(worse.error, unit, 2)}"
        text = f"A straight line from {record.output_name} is better: {of_both[1]} rms, less by {apart}."
        return "FAIL", [Note("compensator-error", f"{said}."), Note("worse-than-line", text)]
    text = f"{said}; a straight line fitted to the training rows to {of_both[1]}."
    return "PASS", [Note("compensator-error", text)]


def _line(fit: identify.FitResult, record: Record) -> np.ndarray:
    """The input that the straight line through the fitted rows, from output to input, gives of each row."""
    u, y = fit.train.input[fit.used], fit.train.output[fit.used]
    slope, level = np.polyfit(y - y.mean(), u, 1)
    return level + slope * (record.output - y.mean())
