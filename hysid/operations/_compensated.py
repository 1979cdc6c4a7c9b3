"""The verdict on a fit that is to compensate: its compensator against simple inverses."""

from dataclasses import replace
from typing import Any

import identify
from hysteresis import Record

from .._compensator import judged_compensator


def fitted_to_compensate(record: Record, *models: Any, **options: Any) -> identify.FitResult:
    """`identify.fit`, and for the purpose "compensate" a compensator that is tried and judged too."""
    if options.get("purpose") != "compensate":
        return identify.fit(record, *models, **options)
    return judged_to_compensate(identify.fit(record, *models, **options | {"purpose": "predict"}))


def judged_to_compensate(fit: identify.FitResult) -> identify.FitResult:
    """A fit with the verdict of a compensator made of it, on the held-out rows, or else on the fitted ones.

    FAIL: the model has no inverse, an estimate is not finite, or the straight line from output to input
    that was fitted to the training rows has a smaller rms error, by more than the standard error of the
    difference. CAUTION: only a cubic of the output, one for either way it goes, has. The error of the
    compensator is the first reason.
    """
    found = judged_compensator(fit)
    verdict = fit.verdict.at_most(found.level)
    verdict = verdict._replace(reasons=(*found.reasons, *verdict.reasons))
    kept = (fit.compensator or {}) | found.document
    fit = replace(fit, purpose="compensate", verdict=verdict, compensator=kept)
    own = replace(fit, candidates=())
    return replace(fit, candidates=(own, *fit.candidates[1:]))
