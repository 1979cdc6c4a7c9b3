"""The verdict on a fit: whether it can be used for a purpose, with all reasons."""

import numpy as np

from hysteresis import InputError, Note
from hysteresis._format import quantity
from hysteresis._verdict import Level, Verdict

from .._levels import PART
from ..diagnostics._profile_likelihood import another_minimum
from ..diagnostics._rows_beyond import loops_left, unseen_time_constants
from ..diagnostics._sloppiness import without_effect
from ..records._folds import LEAST_GAIN, root_difference
from ..results._detail import Composition, DiscreteSpectrum
from ..results._fit_result import PURPOSES, FitResult
from ..results._goodness_of_fit import best_baseline
from ..results._trained_condition import RowsBeyond
from ._verdict_over_cycles import GOOD, Reasons, over_cycles

USABLE = 15.0
"""Error in per cent, as `GOOD`, up to which a fit may be used with care."""

TIMES = 2.0
"""Held-out rows whose rms error is above this times that of the training rows differ from them."""

FIRST = ("turned-over", "zero-jump", "zero-moves")
"""Codes of warnings that come before the error: no model of new runs is right under them."""

LEFT = 0.5
"""Part of the width of the loops that a fit may leave and still pass."""


def check_purpose(purpose: str) -> None:
    """Raise `InputError` `bad-option` for a purpose that there is not."""
    if purpose not in PURPOSES:
        raise InputError("bad-option", f"purpose={purpose!r}; have {', '.join(PURPOSES)}.")


def judge(fit: FitResult, warnings: tuple[Note, ...] = ()) -> Verdict:
    """PASS, CAUTION or FAIL of a fit for its purpose with all reasons: the error first, then the gravest.

    FAIL: not converged; an error above 15 %; no better than the mean of the rows.

    CAUTION: an error above 5 %; a baseline that is better on the judged rows by more than the standard
    error of the difference, or by a twentieth of the squared error; more than half of the loops' width left
    in the residuals; nothing held out; held-out rows with more than twice the rms error of the training
    rows; an error that grows by half from the first held-out cycles to the last; held-out loops of another
    size than every trained one with more than 5 % of their own range; a tenth of the held-out rows beyond
    the trained inputs, or beyond the trained rates or times with twice the error; a time constant that the
    record cannot show; a warning about the data, but for an uneven clock. For constants also: parameters
    without a standard error, a second minimum, no noise model that explains the residuals. To compensate: a
    specimen that still changes; a compensator that was not tried.

    Rows that the fit leaves out are told, and a condition that it ignores. A zero that moves is told first
    of all. Ratios are of like with like: rms with rms in the output's unit, for holds in per cent of the
    reading.
    """
    found = Reasons([], [], [])
    if not fit.success:
        text = "The solver did not converge. Use more starts (--starts), or a simpler model."
        found.fails.append(Note("not-converged", text))
    level, said = _error(fit)
    best = best_baseline(fit.baselines)
    _compare(fit, found)
    if not isinstance(fit.detail, DiscreteSpectrum):  # whose input is held, or a frequency
        _loops(fit, found)
        _ignored_condition(fit, found)
    _held_out(fit, found)
    over_cycles(fit, found)
    _parameters(fit, found)
    if not isinstance(fit.detail, DiscreteSpectrum):  # whose notes say so
        found.cautions.extend(unseen_time_constants(fit.model, fit.train))
    notes = [*map(Note.of, warnings)]
    found.cautions.extend(note for note in notes if note.code not in FIRST)
    _noise(fit, found)
    if fit.purpose == "compensate":
        text = "The compensator was not tried. hysid.fit, hysid fit and hysid qualify try it."
        found.cautions.append(Note("compensator-not-tried", text))
    first = [note for note in notes if note.code in FIRST]
    verdict = Verdict(level, (*first, said), "" if best is None else best.name)
    verdict = verdict.at_most("CAUTION" if first else "PASS")
    verdict = verdict.at_most("FAIL" if found.fails else "PASS", *found.fails)
    return verdict.at_most("CAUTION" if found.cautions else "PASS", *found.cautions, *found.facts)


def _error(fit: FitResult) -> tuple[Level, Note]:
    """The error on the judged rows, and what level it allows at best."""
    train, test = fit.metrics["train"], fit.metrics["test"]
    assert train is not None
    judged, where = (train, "the training rows") if test is None else (test, "the held-out rows")
    holds = isinstance(fit.detail, DiscreteSpectrum)
    percent = judged.relative_percent if holds else judged.nrmse_percent
    of = "the reading" if holds else "their range"
    unit = fit.train.output_unit
    said = (
        f"It predicts {where} to {percent:.2g} % of {of} ({quantity(judged.rmse, unit, 3)} rms,"
        f" {quantity(judged.max_abs, unit, 3)} at most)"
    )
    values = {
        "held_out": test is not None, "percent": percent, "rmse": judged.rmse, "largest": judged.max_abs,
    }  # fmt: skip
    if percent > USABLE or not (holds or judged.r2 > 0):
        return "FAIL", Note("error", f"{said}, which is too far off to use.", values)
    if percent > GOOD:
        return "CAUTION", Note("error", f"{said}, which is above {GOOD:g} %.", values)
    return "PASS", Note("error", f"{said}.", values)


def _compare(fit: FitResult, found: Reasons) -> None:
    """With every baseline, on the test rows or else on the held-out parts of the training rows.

    Of those that are better beyond a standard error the best is named, or else the best of all.
    """
    test = fit.metrics["test"]
    tested = test is not None
    ours = fit.test_blocks if tested else fit.blocks
    if ours is None:
        return
    own = test.rmse if test is not None else float(np.sqrt(ours.mean()))
    where = "the held-out rows" if tested else "held-out parts of the training rows"
    least = 1e-9 * float(np.ptp(fit.train.output[fit.used]))  # both exact: what is left is rounding
    paired = [
        (one, worse)
        for one in sorted(fit.baselines, key=lambda one: one.judged[0])
        if (theirs := one.test_blocks if tested else one.blocks) is not None
        and (worse := root_difference(theirs, ours)) is not None
    ]
    if not paired:
        return
    better = [(one, worse) for one, worse in paired if worse.value > max(worse.error, least)]
    best, worse = (better or paired)[0]
    unit, other = fit.train.output_unit, best.judged[0]
    more = other - own  # of all rows: blocks of few rows weigh them differently
    apart = f"{quantity(abs(more), unit, 2)} +- {quantity(worse.error, unit, 2)}"
    values = {
        "held_out": tested, "baseline": best.name, "rmse": other, "of_fit": own, "more": more,
        "error": worse.error,
    }  # fmt: skip
    # What it gains would be worth a further part of the model, even where it may be chance.
    if better or (more < -least and other**2 <= (1 - LEAST_GAIN) * own**2):
        of_both = f"{quantity(other, unit, 3)} rms instead of {quantity(own, unit, 3)}"
        text = f"A baseline predicts {where} better: {best.name}, {of_both}, a difference of"
        text += f" {apart}{'' if better else ', which may be chance'}."
        found.cautions.insert(0, Note("baseline-better", text, values))
        return
    text = f"The best baseline on {where}, {best.name}, has {quantity(other, unit, 3)} rms,"
    text += (
        f" {'more' if more > 0 else 'less'} by {apart}."
        if abs(more) > least
        else " as the fit has."
    )
    found.facts.append(Note("best-baseline", text, values))


def _loops(fit: FitResult, found: Reasons) -> None:
    """Whether the hysteresis that the fitted rows show is in the model."""
    loops = loops_left(fit)
    if not loops.are_there or not loops.share > LEFT:
        return
    unit = fit.train.output_unit
    text = (
        f"The residuals keep {100 * loops.share:.0f} % of the width of the measured loops"
        f" ({quantity(loops.left, unit, 3)} of {quantity(loops.width, unit, 3)}): the model does not"
        " describe the hysteresis."
    )
    values = {"share": loops.share, "left": loops.left, "width": loops.width}
    found.cautions.append(Note("loops-left", text, values))


def _ignored_condition(fit: FitResult, found: Reasons) -> None:
    """That the output of the model is the same at every value of the condition that was named."""
    found.facts.extend(note for note in fit.train.history if note.code == "constant-condition")
    if fit.condition is None and fit.train.conditions:
        text = (
            f"The model does not depend on {', '.join(fit.train.conditions)}, so no row is flagged for"
            " its value there."
        )
        if not isinstance(fit.detail, Composition):
            text += " A composition may depend on it (--model Composition)."
        found.facts.append(Note("condition-ignored", text))


def _held_out(fit: FitResult, found: Reasons) -> None:
    train, test = fit.metrics["train"], fit.metrics["test"]
    unit = fit.train.output_unit
    assert train is not None
    if test is None:
        text = "Nothing was held out, so the error on unseen data is unknown."
        if np.isfinite(fit.score) and fit.blocks is not None:
            text += f" On held-out parts of the training rows it is {fit.score:.2g} % of the range."
        found.cautions.append(Note("nothing-held-out", text))
        return
    if isinstance(fit.detail, DiscreteSpectrum):
        held, fitted, percent = test.relative_percent, train.relative_percent, test.relative_percent
        both = f"{held:.2g} % of the reading, and {fitted:.2g} % on the training rows"
    else:
        held, fitted, percent = test.rmse, train.rmse, test.nrmse_percent
        both = f"{quantity(held, unit, 3)}, and {quantity(fitted, unit, 3)} on the training rows"
    if held > TIMES * fitted and percent > 1:
        times = f"{held / fitted:.1f} times" if fitted else "more than"
        text = f"The rms error on the held-out rows is {times} that on the training rows: {both}."
        values = {"times": held / fitted if fitted else None, "held_out": held, "trained": fitted}
        found.cautions.append(Note("worse-than-trained", text, values))
    if (beyond := fit.extrapolation) is None:
        return
    inside = beyond.inside
    also = ["channels"] * (fit.channels is not None) + ["conditions"] * (fit.condition is not None)
    for name, part, words in (
        ("input", beyond.input, " or ".join(["the trained inputs", *also])),
        ("rate", beyond.rate, "the trained rates of the input"),
        ("time", beyond.time, "the longest time for which a trained input stayed near one value"),
    ):
        if part.rows <= PART * int(fit.test.mask.sum() if fit.test is not None else 0):
            continue
        code = "beyond" if name == "input" else f"beyond-{name}"
        values = {
            "rows": part.rows,
            "rmse": part.rmse,
            "inside": inside.rows,
            "rmse_inside": inside.rmse,
        }
        note = Note(code, _beyond(fit, part, inside, words), values)
        worse = inside.rmse is None or (part.rmse or 0.0) > TIMES * inside.rmse
        (found.cautions if name == "input" or worse else found.facts).append(note)


def _beyond(fit: FitResult, part: RowsBeyond, inside: RowsBeyond, words: str) -> str:
    assert fit.test is not None
    assert part.rmse is not None
    unit = fit.train.output_unit
    share = 100 * part.rows / int(fit.test.mask.sum())
    text = f"{share:.0f} % of the held-out rows lie beyond {words}; the error there is"
    text += f" {quantity(part.rmse, unit, 3)} rms"
    if inside.rmse is None:
        return f"{text}, and no row lies inside all trained ranges."
    return f"{text}, and {quantity(inside.rmse, unit, 3)} inside all trained ranges."


def _parameters(fit: FitResult, found: Reasons) -> None:
    """Parameters that the data do not determine: grave for constants, good to know for the rest."""
    where = found.cautions if fit.purpose == "constants" else found.facts
    for status in ("at bound", "unidentified"):
        names = [p.name for p in fit.parameters if p.status == status]
        if not names:
            continue
        text = f"No standard error for {', '.join(names)} ({status})."
        count = f" That is {len(names)} of {len(fit.parameters)} parameters."
        where.append(Note(status.replace(" ", "-"), text + count))
        if status == "unidentified" and not isinstance(fit.detail, DiscreteSpectrum):
            where.extend(without_effect(fit, names))
    if (minimum := another_minimum(fit)) is not None:
        sentence, exchanged = minimum
        (found.facts if exchanged else where).append(sentence)


def _noise(fit: FitResult, found: Reasons) -> None:
    if fit.train.sigma is not None:
        ratio = fit.noise.sigma / fit.train.typical_sigma
        text = (
            f"The residuals are {ratio:.3g} times the sigma given: if that is absolute, the reduced"
        )
        text += f" chi-square is {ratio**2:.3g}, and 1 is expected. Errors follow the residuals."
        found.facts.append(Note("sigma", text, {"ratio": ratio, "chi2": ratio**2}))
    if fit.noise_model is not None and not fit.noise_model.is_white:
        text = f"Noise model of the residuals: {fit.noise_model.words}."
        found.facts.append(Note("noise-model", text))
    elif fit.noise_model is None and fit.noise_evidence:
        train = fit.metrics["train"]
        assert train is not None
        left = quantity(train.rmse, fit.train.output_unit, 3)
        text = f"No noise model explains the residuals ({left} rms); treat them as model error."
        where = found.cautions if fit.purpose == "constants" else found.facts
        where.append(Note("model-error", text))
    if fit.noise.correlation_time > 3:
        text = (
            f"The residuals are correlated over {fit.noise.correlation_time:.0f} samples, so"
            f" {fit.noise.samples} rows count as {fit.noise.effective:.0f} and errors are widened."
        )
        noise = fit.noise
        values = {
            "samples": noise.correlation_time,
            "rows": noise.samples,
            "count": noise.effective,
        }
        found.facts.append(Note("correlated-residuals", text, values))
