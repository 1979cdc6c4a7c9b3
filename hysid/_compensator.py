"""The figures of a fit's compensator beside simple inverses."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import identify
from compensate import Status, estimate, invert
from hysteresis import InputError, Note
from hysteresis._format import quantity
from hysteresis._verdict import Level

from ._invert import exported, past_of
from ._run_in import run_in_of

AT_ONCE = 20_000
"""Rows up to which the band is learnt with the fit; a longer record's at its first use."""

BETTER: dict[str, tuple[Level, str, str]] = {
    "straight line": ("FAIL", "worse-than-line", "A straight line from {output} is better"),
    "cubic per branch": (
        "CAUTION",
        "worse-than-cubic",
        "On motions like the trained ones a cubic of {output} for either way it goes is better",
    ),
}
"""Of each simple inverse, what a compensator is at best that errs more."""


class Judged(NamedTuple):
    """The verdict on a compensator, and its figures, for fit.json."""

    level: Level
    reasons: tuple[Note, ...]
    document: dict[str, Any]


def with_compensator(fit: identify.FitResult) -> identify.FitResult:
    """The fit with what fit.json says of its compensator: figures, simple inverses, the band, and when it
    is OK where it is switched on at the first row."""
    if fit.compensator is None or "baselines" not in fit.compensator:
        kept = (fit.compensator or {}) | judged_compensator(fit).document
        fit = replace(fit, compensator=kept)
    assert fit.compensator is not None
    known = fit.compensator["refused"] is not None or "ok_share" in fit.compensator
    if not known and len(fit.train) <= AT_ONCE:
        status = estimate(exported(fit), fit.train).status
        kept = fit.compensator | run_in_of(np.asarray(status), fit.train).document
        fit = replace(fit, compensator=kept)
    return fit


def judged_compensator(fit: identify.FitResult) -> Judged:
    """The compensator of a fit on the held-out rows, or else on the fitted ones, beside simple inverses."""
    record, rows, where, part = fit.train, fit.used, "the training rows", "train"
    if fit.test is not None:
        record, rows, where, part = fit.test, fit.test.mask, "the held-out rows", "test"
    none = dict.fromkeys(("rmse", "max_abs", "nrmse_percent"))
    refused = {"rows": part, **none, "baselines": [], "better": [], "refused": ""}
    try:
        if fit.channels is not None:
            count = len(fit.channels.names)
            said = f"{count} inputs cannot be recovered from one output."
            raise InputError("not-invertible", said)
        if isinstance(fit.detail, identify.Motion | identify.DiscreteSpectrum):
            raise InputError("not-invertible", "a motion or a hold is not recovered.")
        found = estimate(invert(fit.model, trained=fit.trained, past=past_of(fit)), record)
    except InputError as error:
        text = f"There is no compensator: {error.problem}"
        none_made = (Note("not-invertible", text),)
        return Judged("FAIL", none_made, refused | {"refused": "not-invertible"})
    rows = rows & np.isfinite(record.output) & np.isfinite(record.input)
    value, status = np.asarray(found.value), np.asarray(found.status)
    error = (value - record.input)[rows]
    if not np.isfinite(error).all() or (status[rows] == Status.INVALID).any():
        count = int((~np.isfinite(error) | (status[rows] == Status.INVALID)).sum())
        said = f"The compensator has no estimate in {count} of {rows.sum()} rows."
        return Judged("FAIL", (Note("not-finite", said),), refused | {"refused": "not-finite"})
    unit, span = record.input_unit, float(np.ptp(record.input[rows])) or 1.0

    def figures(off: np.ndarray) -> dict[str, float]:
        rmse = float(np.sqrt(np.mean(off**2)))
        return {
            "rmse": rmse,
            "max_abs": float(np.abs(off).max()),
            "nrmse_percent": 100 * rmse / span,
        }

    own, simple = figures(error), []
    level: Level = "PASS"
    reasons: list[Note] = []
    better: list[str] = []
    for name, estimates in identify.internal.backwards(fit.train, fit.used, record):
        off = (estimates - record.input)[rows]
        simple.append({"name": name, **figures(off)})
        blocks = (np.array(identify.internal.block_errors(x)) for x in (off, error))
        worse = identify.internal.root_difference(*blocks)
        if worse is None or worse.value <= max(worse.error, 1e-9 * span):
            continue
        limit, code, text = BETTER[name]
        level = limit if level == "PASS" else level
        better.append(name)
        apart = f"{quantity(worse.value, unit, 2)} +- {quantity(worse.error, unit, 2)}"
        rms = quantity(simple[-1]["rmse"], unit, 3)
        said = f"{text.format(output=record.output_name)}: {rms} rms, less by {apart}."
        reasons.append(Note(code, said))
    rms = [quantity(one["rmse"], unit, 3) for one in (own, *simple)]
    said = f"The compensator estimates {record.input_name} on {where} to {rms[0]} rms"
    said += f" ({quantity(own['max_abs'], unit, 3)} at most); a straight line fitted to the training rows"
    said += f" to {rms[1]}, a cubic for either way of {record.output_name} to {rms[2]}."
    document = {"rows": part, **own, "baselines": simple, "better": better, "refused": None}
    return Judged(level, (Note("compensator-error", said), *reasons), document)
