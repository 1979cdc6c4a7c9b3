"""`hysid.invert`: the compensator of a fit, guarded by what the fit has seen, with its error; and
the verdict on it: its figures beside those of simple inverses."""

import hashlib
import json
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import identify
from compensate import AbstractCompensator, Status, calibrated, estimate
from compensate import invert as invert_model
from compensate.export._export import wider
from compensate.guards._guarded import longest_step
from compensate.guards._run_in import Past
from compensate.uncertainty._calibrated import (
    LEAST_COVERAGE,
    CalibratedCompensator,
    LeftOut,
    checked,
    in_words,
    of_words,
)
from hysteresis import AbstractModel, InputError, Note, Record
from hysteresis._format import quantity
from hysteresis._precision import in_own_precision
from hysteresis._serialisation import described
from hysteresis._verdict import Level
from identify import FitResult
from identify.results._detail import Composition, DiscreteSpectrum, Motion


@in_own_precision
def invert(
    fit_or_model: FitResult | AbstractModel, *arguments: Any, **options: Any
) -> AbstractCompensator:
    """`compensate.invert` of a model; or of a fit, limited to the trained inputs and with a deviation.

    ```math
    \\hat u = \\mathrm{clip}(\\hat u_\\text{inverse}, low, high)
    ```

    where low and high are the least and the greatest input of the training rows. A step in time longer than
    a thousand times the record is taken for that long and EXTRAPOLATED, as in exports.

    The deviation of an estimate is the error by level and branch of models that were fitted without one
    cycle, or sequence, each, on the cycle that they have not seen, see `calibrated`. Of a record without
    two cycles it is the error of the model, times that on held-out parts of the training rows over that on
    fitted ones. It grows where the last reversals or the speed are unlike those of the training rows. Where
    it holds fewer than 0.8 of the test rows, it is scaled so that it holds nine tenths of them;
    `coverage_before` is what it held. Value +- 1.645 deviations should hold nine of ten inputs; `coverage`
    is the part of the test rows that they do hold, NaN without test rows. Draws of a posterior,
    `invert(posterior.model)`, tell what the parameters alone leave open, which is less.

    The band is learnt once, and saved with the fit: whatever uses it shows the same one.

    With `start="unknown"`, as `hysid export` writes it, the status is RUN_IN until estimates that begin
    where the training may have left a specimen agree to the usual deviation, see `GuardedCompensator`.

    **Arguments:** a fit of one input, or a model; the others are those of `compensate.invert`. `beyond` and
    `start` choose another guard, `trained` and `longest` other limits.

    **Raises:** `InputError` where the model has no inverse, see `compensate.invert`.

    **Example:**

        >>> found = hysid.invert(fit).simulate(None, [30.0, 1e9])
        >>> [compensate.Status(int(s)).name for s in found.status]
        ['OK', 'EXTRAPOLATED']
    """
    if not isinstance(fit_or_model, FitResult):
        return invert_model(fit_or_model, *arguments, **options)
    fit = fit_or_model
    learnt = error_of(fit)
    guarded = invert_model(fit.model, *arguments, **(guard_of(fit, learnt) | options))
    learnt = replace(learnt, has_draws=False, units=guarded.units)
    return learnt.around(guarded)


def exported(fit: FitResult) -> AbstractCompensator:
    """The compensator as `hysid export` writes it: switched on at any time, with limited readings."""
    band: Any = invert(fit, start="unknown")
    return replace(band, inner=replace(band.inner, readings=limits_of(fit)))


def limits_of(fit: FitResult) -> tuple[float, float]:
    """Beyond these a reading is taken for the nearer one."""
    return wider(fit.train.output[fit.train.mask])


def guard_of(fit: FitResult, error: CalibratedCompensator) -> dict[str, Any]:
    """What a fit's compensator is guarded by: options of `compensate.invert`."""
    used = fit.train.mask & np.isfinite(fit.train.output)
    rows, time = longest_sequence(fit.train, used), fit.train.time
    return {
        "trained": fit.trained,
        "longest": None if time is None else longest_step(time[rows][used[rows]]),
        "past": past_of(fit),
        "deviation": float(np.median(np.asarray(error.error))),
        "seen": (float(fit.train.output[used].min()), float(fit.train.output[used].max())),
    }


def past_of(fit: FitResult) -> Past:
    """What the fitted specimen has been through: the longest sequence of the training rows."""
    rows = longest_sequence(fit.train, fit.train.mask & np.isfinite(fit.train.output))
    return Past(None if fit.train.time is None else fit.train.time[rows], fit.train.input[rows])


def error_of(fit: FitResult) -> CalibratedCompensator:
    """The compensator of a fit, limited to the trained inputs, with the error that `invert` shows.

    It is learnt at its first use, and then kept with the fit.
    """
    digest, kept = _digest(fit), fit.compensator or {}
    is_kept = kept.get("band_of") == digest
    is_judged = is_kept or kept.get("refused", "") is None  # so it rises, which takes long to find
    known = invert_model(fit.model, trained=fit.trained, past=None if is_judged else past_of(fit))
    if not is_kept:
        left_out = [
            LeftOut(rows, invert_model(model, trained=fit.trained))
            for rows, model in identify.internal.models_without_groups(fit)
        ]
        ahead, own = 1.0, fit.metrics["train"]
        if not left_out and own is not None and own.nrmse_percent > 0 and np.isfinite(fit.score):
            ahead = max(1.0, fit.score / own.nrmse_percent) ** 2  # held-out parts over fitted ones
        learnt = calibrated(known, fit.train, ahead=ahead, left_out=left_out)
        if fit.test is not None:
            learnt = checked(learnt, fit.test)
        kept = kept | {"band": in_words(learnt), "band_of": digest}
        # What is kept is not part of the fit, it only saves computing it again.
        object.__setattr__(fit, "compensator", kept)
    return of_words(kept["band"], known)


def _digest(fit: FitResult) -> str:
    """Of what a band is learnt from: the model, and the rows of both records."""
    structure, arrays = described(fit.model, for_file=False)
    code = hashlib.sha256(json.dumps(structure, sort_keys=True, default=str).encode())
    for name in sorted(arrays):
        code.update(np.ascontiguousarray(arrays[name]).tobytes())
    for record in (fit.train, fit.test):
        code.update(b"-" if record is None else record.digest().encode())
    return code.hexdigest()


def longest_sequence(record: Record, used: np.ndarray) -> slice:
    """The rows of the sequence of which most are used: others may be held out as a whole."""
    return max((rows for _, rows in record.sequences()), key=lambda rows: int(used[rows].sum()))


REACHED = 0.9
"""Part of all later rows that are OK from where OK is reached."""


class RunIn(NamedTuple):
    """The part of a record's counted rows that are OK, and where OK is reached: after so many cycles, and
    so much time; None where it is not, or there is no clock. `start`: what was known of the first state."""

    share: float
    cycles: float | None
    time: float | None
    start: str

    @property
    def document(self) -> dict[str, Any]:
        """For `fit.json`."""
        after = {"cycles": self.cycles, "time": self.time}
        return {"ok_share": self.share, "ok_after": after, "start": self.start}

    @classmethod
    def of(cls, document: dict[str, Any]) -> "RunIn":
        """From `fit.json`."""
        after = document["ok_after"]
        return cls(document["ok_share"], after["cycles"], after["time"], document["start"])

    def sentence(self, time_unit: str, since: str = "Switched on at the first row") -> str:
        """When the compensator is OK, and for how much of the record."""
        of_rows = f"{since}, {100 * self.share:.3g} % of the estimates are OK"
        if self.cycles is None:
            return f"{of_rows}; nine tenths of what follows never are."
        time = ""
        if self.time is not None and time_unit != "1":
            time = f", {quantity(self.time, time_unit, 3)}"
        return f"{of_rows}: OK is reached after {self.cycles:.2g} cycles{time}."


def run_in_of(status: np.ndarray, record: Record, start: str = "unknown") -> RunIn:
    """Of the statuses of a record's rows, each sequence of which is a start of its own.

    OK is reached at the first row from which nine tenths of all later ones are OK, after the first reading,
    or the first behind known rows; of several sequences the latest counts.
    """
    used = record.mask & np.isfinite(record.output)
    ok, latest, cycles = status == Status.OK, 0.0, 0.0
    read = np.isfinite(record.output) & (True if record.known is None else ~record.known)
    for _, rows in record.sequences():
        known = ok[rows][used[rows]]
        if not len(known):
            continue
        later = np.cumsum(known[::-1])[::-1] / np.arange(len(known), 0, -1)
        reached = np.flatnonzero(known & (later >= REACHED))
        if not len(reached):
            return RunIn(float(ok[used].mean()), None, None, start)
        row = rows.start + int(np.flatnonzero(used[rows])[reached[0]])
        turns = record.cycle[rows]
        turns = np.where(turns > 0, turns, turns.max() + 1)  # what follows the last cycle has none
        begin = rows.start + int(np.argmax(read[rows]))
        ends = []
        for at in (begin, row):
            turn = turns[at - rows.start]
            own = np.flatnonzero(turns == turn) + rows.start
            ends.append(turn + (at - own[0]) / len(own))
        cycles = max(cycles, ends[1] - (turns.min() if begin == rows.start else ends[0]))
        if record.time is not None:
            latest = max(latest, float(record.time[row] - record.time[begin]))
    time = None if record.time is None else latest
    return RunIn(float(ok[used].mean()), float(cycles), time, start)


AT_ONCE = 20_000
"""Rows up to which the band is learnt with the fit; a longer record's at its first use."""

BETTER: tuple[tuple[Level, str, str], ...] = (
    ("FAIL", "worse-than-line", "A straight line from {line} is better"),
    ("CAUTION", "worse-than-cubic", "On motions like the trained ones a cubic of"
     " {output} for either way it goes is better"),
)  # fmt: skip
"""Of each simple inverse, what a compensator is at best that errs more."""


class Judged(NamedTuple):
    """The verdict on a compensator, and its figures, for fit.json."""

    level: Level
    reasons: tuple[Note, ...]
    document: dict[str, Any]


def with_compensator(fit: FitResult) -> FitResult:
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


def judged_compensator(fit: FitResult) -> Judged:
    """The compensator of a fit on the held-out rows, or else on the fitted ones, beside simple inverses."""
    record, rows, where, part = fit.train, fit.used, "the training rows", "train"
    if fit.test is not None:
        record, rows, where, part = fit.test, fit.test.mask, "the held-out rows", "test"
    none = dict.fromkeys(("rmse", "max_abs", "nrmse_percent"))
    refused = {"rows": part, **none, "baselines": [], "better": [], "refused": ""}
    try:
        if fit.channels is not None:
            said = f"{len(fit.channels.names)} inputs cannot be recovered from one output."
            raise InputError("not-invertible", said)
        if isinstance(fit.detail, Motion | DiscreteSpectrum):
            raise InputError("not-invertible", "a motion or a hold is not recovered.")
        found = estimate(invert_model(fit.model, trained=fit.trained, past=past_of(fit)), record)
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
        rmse, most = float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())
        return {"rmse": rmse, "max_abs": most, "nrmse_percent": 100 * rmse / span}

    own, simple = figures(error), []
    level: Level = "PASS"
    reasons: list[Note] = []
    better: list[str] = []
    line = " and ".join((record.output_name, *fit.train.conditions))
    simplest = identify.internal.backwards(fit.train, fit.used, record)
    for (name, estimates), (limit, code, text) in zip(simplest, BETTER, strict=True):
        off = (estimates - record.input)[rows]
        simple.append({"name": name, **figures(off)})
        blocks = (np.array(identify.internal.block_errors(x)) for x in (off, error))
        worse = identify.internal.root_difference(*blocks)
        if worse is None or worse.value <= max(worse.error, 1e-9 * span):
            continue
        level = limit if level == "PASS" else level
        better.append(name)
        apart = f"{quantity(worse.value, unit, 2)} +- {quantity(worse.error, unit, 2)}"
        rms = quantity(simple[-1]["rmse"], unit, 3)
        said = f"{text.format(output=record.output_name, line=line)}: {rms} rms, less by {apart}."
        reasons.append(Note(code, said))
    rms = [quantity(one["rmse"], unit, 3) for one in (own, *simple)]
    said = f"The compensator estimates {record.input_name} on {where} to {rms[0]} rms"
    said += f" ({quantity(own['max_abs'], unit, 3)} at most); a straight line from {line} fitted to"
    said += f" the training rows to {rms[1]}, a cubic for either way of {record.output_name} to"
    said += f" {rms[2]}."
    document = {"rows": part, **own, "baselines": simple, "better": better, "refused": None}
    return Judged(level, (Note("compensator-error", said), *reasons), document)


def fitted_to_compensate(record: Record, *models: Any, **options: Any) -> FitResult:
    """`identify.fit`, and for the purpose "compensate" a compensator that is tried and judged too; after
    Ctrl-C the fit alone, whose verdict says so."""
    if options.get("purpose") != "compensate":
        return identify.fit(record, *models, **options)
    fit = identify.fit(record, *models, **options | {"purpose": "predict"})
    try:
        return judged_to_compensate(fit)
    except KeyboardInterrupt:
        note = Note(
            "interrupted", "Whether it compensates is not known: its judging was interrupted."
        )
        fit = replace(fit, verdict=fit.verdict.at_most("CAUTION", note))
        return replace(fit, candidates=(replace(fit, candidates=()), *fit.candidates[1:]))


def judged_to_compensate(fit: FitResult) -> FitResult:
    """The best candidate that has an inverse, or else the best one, with the verdict of a compensator made
    of it, on the held-out rows, or else on the fitted ones.

    FAIL: the model has no inverse, an estimate is not finite, or the straight line from output to input
    that was fitted to the training rows has a smaller rms error, by more than the standard error of the
    difference. CAUTION: only a cubic of the output, one for either way it goes, has; the specimen still
    changes, because a compensator runs for longer than its record; the band of the estimates had to be
    widened to hold the held-out inputs. The error of the compensator is the first reason.
    """
    first, others = fit, fit.candidates[1:]
    found, why = None, "Its output need not rise with its input."
    if may_be_inverted(first):
        found = judged_compensator(first)
        why = found.reasons[0].text
    if found is None or found.document["refused"] == "not-invertible":
        fits = (one for one in others if isinstance(one, FitResult) and may_be_inverted(one))
        tried = ((one, judged_compensator(one)) for one in fits)
        if made := next((pair for pair in tried if pair[1].document["refused"] is None), None):
            other, found = made
            others = (first, *(one for one in others if one is not other))
            fit = replace(other, skipped=fit.skipped, seconds=fit.seconds)
            note = Note("passed-over", f"{first.name} predicts better and is passed over. {why}")
            found = found._replace(reasons=(*found.reasons, note))
    found = found or judged_compensator(first)
    reasons = found.reasons
    changes = "drift" in fit.verdict.codes
    verdict = fit.verdict.at_most(found.level).at_most("CAUTION" if changes else "PASS")
    if found.level != "FAIL" and (held := error_of(fit).coverage_before) < LEAST_COVERAGE:
        said = f"The 90 % band of the estimates held {100 * held:.0f} % of the held-out inputs."
        said += " It was widened to hold nine tenths."
        reasons = (*reasons, Note("band", said, {"says": 0.9, "coverage": held}))
        verdict = verdict.at_most("CAUTION")
    verdict = verdict._replace(reasons=(*reasons, *verdict.reasons))
    kept = (fit.compensator or {}) | found.document
    fit = replace(fit, purpose="compensate", verdict=verdict, compensator=kept)
    own = replace(fit, candidates=())
    return replace(fit, candidates=(own, *others))


def may_be_inverted(fit: FitResult) -> bool:
    """Whether nothing but a trial speaks against an inverse: weights of either sign do."""
    return not isinstance(fit.detail, Composition) or fit.detail.rises
