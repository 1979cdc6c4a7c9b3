"""The verdict on a fit that is to compensate: its compensator against simple inverses."""

from dataclasses import replace
from typing import Any

import identify
from compensate.uncertainty._calibrated import LEAST_COVERAGE
from hysteresis import Note, Record

from .._compensator import judged_compensator
from .._invert import error_of


def fitted_to_compensate(record: Record, *models: Any, **options: Any) -> identify.FitResult:
    """`identify.fit`, and for the purpose "compensate" a compensator that is tried and judged too."""
    if options.get("purpose") != "compensate":
        return identify.fit(record, *models, **options)
    return judged_to_compensate(identify.fit(record, *models, **options | {"purpose": "predict"}))


def judged_to_compensate(fit: identify.FitResult) -> identify.FitResult:
    """The best candidate that has an inverse, or else the best one, with the verdict of a compensator made
    of it, on the held-out rows, or else on the fitted ones.

    FAIL: the model has no inverse, an estimate is not finite, or the straight line from output to input
    that was fitted to the training rows has a smaller rms error, by more than the standard error of the
    difference. CAUTION: only a cubic of the output, one for either way it goes, has; the specimen still
    changes, because a compensator runs for longer than its record; the band of the estimates had to be
    widened to hold the held-out inputs. The error of the compensator is the first reason.
    """
    first, others = fit, fit.candidates[1:]
    found = judged_compensator(first)
    reasons = [*found.reasons]
    if found.document["refused"] == "not-invertible":
        fits = (one for one in others if isinstance(one, identify.FitResult))
        tried = ((one, judged_compensator(one)) for one in fits)
        if made := next((pair for pair in tried if pair[1].document["refused"] is None), None):
            other, found = made
            others = (first, *(one for one in others if one is not other))
            fit = replace(other, skipped=fit.skipped, seconds=fit.seconds)
            said = f"{first.name} predicts better and is passed over. {reasons[0].text}"
            reasons = [*found.reasons, Note("passed-over", said)]
    changes = "drift" in fit.verdict.codes
    verdict = fit.verdict.at_most(found.level).at_most("CAUTION" if changes else "PASS")
    if found.level != "FAIL" and (band := band_reason(error_of(fit).coverage_before)) is not None:
        verdict, reasons = verdict.at_most("CAUTION"), [*reasons, band]
    verdict = verdict._replace(reasons=(*reasons, *verdict.reasons))
    kept = (fit.compensator or {}) | found.document
    fit = replace(fit, purpose="compensate", verdict=verdict, compensator=kept)
    own = replace(fit, candidates=())
    return replace(fit, candidates=(own, *others))


def band_reason(coverage: float) -> Note | None:
    """What to say of a 90 % band that held this part of the held-out inputs; None where it is right."""
    if not coverage < LEAST_COVERAGE:
        return None
    text = f"The 90 % band of the estimates held {100 * coverage:.0f} % of the held-out inputs."
    return Note(
        "band", f"{text} It was widened to hold nine tenths.", {"says": 0.9, "coverage": coverage}
    )
