"""The verdict on a fit: whether it can be used, with all reasons."""

import numpy as np

from hysteresis._verdict import Verdict

from ..diagnostics._profile_likelihood import another_minimum
from ..diagnostics._sloppiness import without_effect
from ..diagnostics._time_constants import unseen_time_constants
from ..results._fit_result import FitResult

GOOD, USABLE = 5.0, 15.0
"""Held-out NRMSE in per cent up to which a fit passes, and up to which it may be used with care."""


def judge(fit: FitResult, warnings: tuple[str, ...] = ()) -> Verdict:
    """PASS, CAUTION or FAIL of a fit with all its reasons: the error first, then the gravest.

    FAIL: not converged; held-out error above 15 % of the range; no better than the mean.
    CAUTION: held-out error above 5 %, or more than twice that on the training part; nothing held out;
    parameters without an honest error; another minimum as good; a time constant that the record cannot
    show; a tenth of the test rows beyond the trained inputs; a warning about the data.
    """
    train, test = fit.metrics["train"], fit.metrics["test"]
    assert train is not None
    fails, cautions, facts = [], [], []
    if not fit.success:
        fails.append("The solver did not converge. Use more starts (--starts), or a simpler model.")
    judged, where = (train, "the training rows") if test is None else (test, "the held-out rows")
    said = f"It predicts {where} to {judged.nrmse_percent:.2g} % of their range"
    unit = "" if fit.train.output_unit == "1" else f" {fit.train.output_unit}"
    said += f" ({judged.rmse:.3g}{unit} rms, {judged.max_abs:.3g}{unit} at most)"
    if judged.nrmse_percent > USABLE or not judged.r2 > 0:
        verdict = Verdict("FAIL", (f"{said}, which is too far off to use.",))
    elif judged.nrmse_percent > GOOD:
        verdict = Verdict("CAUTION", (f"{said}, which is above {GOOD:g} %.",))
    else:
        verdict = Verdict("PASS", (f"{said}.",))
    if test is None:
        cautions.append("Nothing was held out, so the error on unseen data is unknown.")
    elif test.nrmse_percent > 2 * train.nrmse_percent and test.nrmse_percent > 1:
        cautions.append(
            f"That is {test.nrmse_percent / train.nrmse_percent:.1f} times the error on the"
            " training rows, because the held-out rows differ or the model has too much freedom."
        )
    if test is not None:
        outside = _share_outside(fit)
        if outside > 0.1:
            cautions.append(
                f"{100 * outside:.0f} % of the held-out rows lie beyond the trained inputs."
            )
    for status in ("at bound", "unidentified"):
        names = [p.name for p in fit.parameters if p.status == status]
        if names:
            cautions.append(f"No standard error for {', '.join(names)} ({status}).")
            if status == "unidentified":
                cautions += without_effect(fit, names)
    if (found := another_minimum(fit)) is not None:
        sentence, exchanged = found
        (facts if exchanged else cautions).append(sentence)
    cautions += [*unseen_time_constants(fit.model, fit.train), *warnings]
    if fit.noise_model is not None and not fit.noise_model.is_white:
        facts.append(f"Noise model of the residuals: {fit.noise_model.words}.")
    elif fit.noise_model is None and fit.noise_evidence:
        facts.append("No noise model explains the residuals; treat them as model error.")
    if fit.noise.correlation_time > 3:
        facts.append(
            f"The residuals are correlated over {fit.noise.correlation_time:.0f} samples, so"
            f" {fit.noise.samples} rows count as {fit.noise.effective:.0f} and errors are widened."
        )
    verdict = verdict.at_most("FAIL" if fails else "PASS", *fails)
    return verdict.at_most("CAUTION" if cautions else "PASS", *cautions, *facts)


def _share_outside(fit: FitResult) -> float:
    assert fit.test is not None
    seen = fit.train.input[fit.train.mask]
    u = fit.test.input[fit.test.mask]
    # Within a hundredth of the range the seam does not matter.
    margin = 0.01 * np.ptp(seen)
    return float(np.mean((u < seen.min() - margin) | (u > seen.max() + margin)))
