"""`hysid predict`: a fitted model, or its compensator, over a file."""

from dataclasses import replace
from itertools import compress

import numpy as np

import identify
from compensate import Status, estimate
from compensate.uncertainty._calibrated import CalibratedCompensator, band_holds
from hysteresis import InputError, Record
from hysteresis._files import write_table
from hysteresis._format import number_of, quantity, rms_error
from identify.dynamics._output_error import RecordedMotion
from identify.internal import metrics
from identify.results._detail import Motion

from .._compensator import exported, run_in_of
from ..intake._creep_fits import RANGE, later, on_the_clock_of, open_range
from ..intake._folders import folders_of
from ..intake._selection import for_new_file, known_records, selection_of_fit
from ._asked import Predict
from ._console import Done, warnings

FLAGGED_BEYOND = "beyond the trained inputs"
CONDITION_BEYOND = "beyond the trained conditions"


def run(asked: Predict) -> Done:
    """Run a fitted model, or its compensator, over a file; write the result beside the fit.

    Error figures are over every row of the file that has both readings. `flagged` counts rows beyond
    the trained inputs (of a step: times), or, for the compensator, estimates whose status is not OK, known
    rows aside. Of the compensator's band, `held_out` is the part of the fit's held-out rows that value +-
    1.645 deviations hold, and `here` that of this file's; None where it is not known.
    Beside a step's prediction stands the range that the fitted record leaves open. `steady`: an oscillator
    has run through the force so often that its motion repeats itself.
    """
    folder, file, inverse, steady = asked.folder, asked.file, asked.inverse, asked.steady
    document = identify.internal.read_document(folder)
    fitted_on = selection_of_fit(document)
    if inverse and isinstance(fitted_on.input, tuple):
        raise InputError(
            "not-invertible",
            f"This fit has {len(fitted_on.input)} inputs; they cannot be recovered from one output.",
            place=str(folder),
            fix="Predict without --inverse, or fit one input.",
        )
    selection = replace(fitted_on, **asked.selection).without_hold_out()
    source = selection.read(file)
    selection, compared, said = for_new_file(selection, source, inverse)
    folders = folders_of(folder, document)
    table, measured_all, found_all, flagged, run_in, bands = [], [], [], 0, None, {}
    with_range = fitted_on.is_step and not inverse
    for value, (record, _) in known_records(selection, source, folders).items():
        fitted = identify.load(folder / folders[value])
        motion, deviation = _motion(fitted, inverse, steady), None
        if motion is not None and record.known is not None:
            raise InputError(
                "bad-option",
                "The state of an oscillator is not told from known rows.",
                fix="Leave out --known; --steady is for a motion that repeats itself.",
            )
        if fitted_on.is_step:
            record = on_the_clock_of(fitted, record)
        wanted = record.input if inverse else record.output
        read = "output" if inverse else "input"
        sides = ("output", "input") if compared else (read,)
        identify.internal.check_units(fitted, record, *sides)
        if inverse:
            values, deviation, status, bands[value] = _run_backwards(fitted, record, compared)
            words = [Status(int(s)).name for s in status]
            run_in = run_in_of(status, record)
            since = () if record.known is None else ("From the known rows on",)
            said.append(f"{value}: " * bool(value) + run_in.sentence(record.time_unit, *since))
        elif motion is not None:
            values = motion.steady(record) if steady else motion.from_rest(record)
            words = _outside(fitted, record)
            said += _of_motion(fitted, steady)
        else:
            words = (later if fitted_on.is_step else _outside)(fitted, record)
            said += _between(fitted, record)
            if record.known is None:
                values = fitted.predict(record)
            else:
                seen = fitted.clocks.applied(fitted.combined(record))
                values, deviation = identify.internal.told(fitted, seen)
                left = quantity(
                    float(np.sqrt(np.mean(deviation[record.mask] ** 2))), record.output_unit, 3
                )
                said.append(
                    f"{number_of(int(record.known.sum()), 'known row')} told the states before the"
                    f" others, which leaves open {left} rms of the prediction."
                )
        counted = np.ones(len(record), bool) if record.known is None else ~record.known
        flagged += sum(w != "OK" for w in compress(words, counted))
        driving = fitted.combined(record).input
        more = open_range(fitted, record) if with_range else np.empty((len(record), 0))
        more = more if deviation is None else deviation[:, None]
        rows = zip(
            [value] * len(record), record.line, driving, record.output, values, words, *more.T,
            strict=True,
        )  # fmt: skip
        table += [row for row in rows if row[1]]  # a step's own row has no line in the file
        measured_all.append(wanted[record.mask])
        found_all.append(np.asarray(values)[record.mask])
    figures = metrics(np.concatenate(measured_all), np.concatenate(found_all))._asdict()
    if not compared:
        figures = dict.fromkeys(figures)
    target = folder / f"{'inverse' if inverse else 'predicted'}-{file.stem}.csv"
    result = f"estimated {fitted_on.input_words}" if inverse else f"predicted {fitted_on.output}"
    names = [selection.input_words, selection.output]
    header = [selection.each or "", "line", *names, result, "status", *RANGE[: 3 * with_range]]
    header += ["standard deviation"] * (deviation is not None)
    keep = [selection.each is not None, True, True, compared, *(True,) * 5]
    header, *shown = (list(compress(row, keep)) for row in [header, *table])
    write_table(target, header, shown)
    known = {} if run_in is None else {"band": bands.get("", bands), "compensator": run_in.document}
    counts = {"flagged": flagged, "rows": len(table)}
    found = {**figures, **counts, **known, "notes": said, "file": str(target)}
    compared_with = "The file has no measured values to compare with"
    if compared:
        unit = fitted.train.input_unit if inverse else fitted.train.output_unit
        compared_with = rms_error(figures, unit)
    lines = [*warnings(said, "Note"), f"{compared_with}; {flagged} of {len(table)} rows flagged"]
    if inverse:
        lines += [_band_line(name, band) for name, band in bands.items()]
    return Done(found, [*lines, str(target)])


def _band_line(name: str, band: dict[str, float | None]) -> str:
    """What the 90 % band of a compensator holds."""
    parts = {"held_out": "the fit's held-out rows", "here": "this file's"}
    said = [f"{100 * x:.3g} % of {w}" for k, w in parts.items() if (x := band[k]) is not None]
    held = " and ".join(said) or "a share that is not known"
    text = f"{name}: " * bool(name) + f"The 90 % band holds {held}."
    before = band["before"]
    if before is None or before == band["held_out"]:
        return text
    return f"{text} It was widened, because as learnt from the training rows it held {100 * before:.3g} %."


def _motion(fitted: identify.FitResult, inverse: bool, steady: bool) -> RecordedMotion | None:
    """What moves the mass of an oscillator; None backwards, and for models without a steady state."""
    if isinstance(fitted.detail, Motion):
        return None if inverse else fitted.detail.recorded  # `invert` says why it has no inverse
    if steady:
        raise InputError(
            "bad-option",
            f"{fitted.name} has no mass, so it has no steady state.",
            fix="Leave out --steady; it is for fits of an oscillator.",
        )
    return None


def _of_motion(fitted: identify.FitResult, steady: bool) -> list[str]:
    """How the motion was run and recorded."""
    assert isinstance(fitted.detail, Motion)
    recorded = fitted.detail.recorded
    begin = f"The motion is predicted {'in steady state' if steady else 'from rest'}"
    if not recorded.stages:
        return [f"{begin}, sampled without a filter as in the fit."]
    kept = " x ".join(map(str, recorded.stages if steady else (recorded.substeps,)))
    return [f"{begin}, low-passed and decimated by {kept} as a recorder does."]


def _outside(fitted: identify.FitResult, record: Record) -> list[str]:
    """What to say about each row of a record: is it beyond the inputs that were fitted?"""
    words = np.where(fitted.beyond(record), FLAGGED_BEYOND, "OK").astype(object)
    if (condition := fitted.condition) is not None:
        words[condition.beyond(fitted.combined(record))] = CONDITION_BEYOND
    return words.tolist()


def _between(fitted: identify.FitResult, record: Record) -> list[str]:
    """What to mind of rows at conditions between the trained ones."""
    condition = fitted.condition
    count = 0 if condition is None else int(condition.between(fitted.combined(record)).sum())
    if condition is None or not count:
        return []
    said = f"{count} rows are at a {condition.name} between the trained values"
    if condition.error is None:
        return [f"{said}, where the error is not known."]
    error = quantity(condition.error, fitted.train.output_unit, 3)
    return [f"{said}. At such values, held out in the fit, the model errs by {error} rms."]


def _run_backwards(
    fitted: identify.FitResult, record: Record, compared: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, float | None]]:
    """Estimates, deviations and statuses of the compensator over each sequence, as it is exported,
    and what its band holds."""
    band = exported(fitted)
    assert isinstance(band, CalibratedCompensator)
    found = estimate(band, record)
    here = band_holds(band, fitted.clocks.applied(record))[0] if compared else np.nan
    held = {"held_out": band.coverage, "before": band.coverage_before, "here": here}
    known = identify.internal.plain(held)
    value = fitted.clocks.undone(record, np.asarray(found.value))
    return value, np.asarray(found.deviation), np.asarray(found.status), known
