"""The verdict on a fit: whether it can be used for a purpose, with all reasons."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hysteresis import InputError, Note, Record
from hysteresis._format import quantity
from hysteresis._verdict import Level, Verdict
from hysteresis.records._change import ALIKE, change
from hysteresis.records._cycles import (
    counted_cycles,
    default_dead_band,
    first_of_cycles,
    turning_points,
)

from .._levels import MUCH, PART
from ..diagnostics._profile_likelihood import another_minimum
from ..diagnostics._residual_breakdown import loops_left, unseen_time_constants
from ..diagnostics._sensitivity import without_effect
from ..records._folds import KIND, LEAST_GAIN, root_difference
from ..records._sequence_terms import RELATIVE
from ..results._detail import Composition, DiscreteSpectrum
from ..results._fit_result import PURPOSES, FitResult
from ..results._goodness_of_fit import best_baseline
from ..results._trained_condition import RowsBeyond

# Reasons of a verdict that show from cycle to cycle: rows left out, change, growing errors, sizes.

GOOD = 5.0
"""Error in per cent, of the range of the rows, of their own loops or for holds of the reading, up to
which a fit passes."""


class Reasons(NamedTuple):
    """Notes that make a verdict FAIL, that make it CAUTION, and that are good to know."""

    fails: list[Note]
    cautions: list[Note]
    facts: list[Note]


class _Loop(NamedTuple):
    """A cycle: range of its input, rms error, and range of its output, over the rows that count; and how
    long it lasts, in rows where there is no time."""

    span: float
    rmse: float
    output: float
    lasts: float


def over_cycles(fit: FitResult, found: Reasons) -> None:
    """All of them."""
    if isinstance(fit.detail, DiscreteSpectrum):
        return
    _left_out(fit, found)
    _changes(fit, found)
    if fit.test is None:
        return
    error = fit.test.weights * (fit.predict(fit.test) - fit.test.output)
    each = _loops_of_cycles(fit.test, fit.test.mask, error)
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
    """An error that grows from held-out cycle to held-out cycle, of the sequence with most of them; where
    they are alike, because otherwise it grows with their sizes or rates."""
    loops = max(each, key=len, default=[])
    errors = np.array([loop.rmse for loop in loops])
    kinds = np.array([(loop.span, loop.lasts) for loop in loops])
    if len(errors) < 3 or (np.ptp(kinds, 0) > ALIKE * np.median(kinds, 0)).any():
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
    own = _loops_of_cycles(train, fit.used, np.zeros(len(train)))
    trained = [*(loop.span for loops in own for loop in loops), *_outer(train, fit.used)]
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


def _outer(record: Record, used: np.ndarray) -> list[float]:
    """Ranges of the cycles of the used rows that hold smaller ones."""
    found: list[float] = []
    for _, rows in record.sequences():
        u = record.input[rows][used[rows]]
        band = default_dead_band(u)
        turns = u[turning_points(u, band)]
        while 0 < band < np.ptp(u):
            ends = pairwise(first_of_cycles(turns, band).tolist())
            found += [float(np.ptp(turns[max(a - 1, 0) : b])) for a, b in ends]
            band *= 1 + KIND
    return found


def _loops_of_cycles(record: Record, used: np.ndarray, error: np.ndarray) -> list[list[_Loop]]:
    """Of each sequence the cycles of which at least half of the rows are used."""
    counted = used & np.isfinite(record.output)
    clock = np.arange(len(record)) if record.time is None else record.time

    def told(rows: slice) -> _Loop:
        u, y, e = (x[rows][counted[rows]] for x in (record.input, record.output, error))
        lasts = np.ptp(clock[rows])
        return _Loop(*map(float, (np.ptp(u), np.sqrt(np.mean(e**2)), np.ptp(y), lasts)))

    return [[told(one.rows) for one in cycles] for cycles in counted_cycles(record, counted)]


USABLE = 15.0
"""Error in per cent, as `GOOD`, up to which a fit may be used with care."""

TIMES = 2.0
"""Held-out rows whose rms error is above this times that of the training rows differ from them."""

FIRST = ("missing-mark", "turned-over", "zero-jump", "zero-moves")
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
    rows; an error that grows by half from the first of like held-out cycles to the last; held-out loops of
    another size than every trained one with more than 5 % of their own range; a tenth of the held-out rows
    beyond the trained inputs, or beyond the trained rates or times with twice the error; a time constant
    that the record cannot show; a warning about the data, but for an uneven clock. For constants also:
    parameters without a standard error, a second minimum, no noise model that explains the residuals. To
    compensate: a specimen that still changes; a compensator that was not tried.

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
    if fit.train.sigma is not None and fit.train.sigma_name != RELATIVE:
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
