"""`hysid export`: the compensator of a fit as a file that runs without JAX."""

import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

import identify
from compensate import (
    CalibratedCompensator,
    GuaranteedCompensator,
    Origin,
    Quantity,
    estimate,
    invert,
)
from compensate.export._export import Program, wider
from compensate.export.targets._export_to import check, write_to
from compensate.uncertainty._guaranteed import GAIN
from hysteresis import InputError, with_condition

from .._compensator import judged_compensator
from .._invert import error_of, guard_of, longest_sequence
from .._run_in import RunIn, run_in_of
from ._asked import Export
from ._console import Done, log, warnings

HALF = 0.5
"""Share of OK estimates below which an export says so: `if (status == OK)` then seldom runs in a robot."""


def run(asked: Export) -> Done:
    """Write what the targets name; readings beyond the limits are taken for the limit.

    Estimates are guarded by the trained inputs. A robot is switched on at any time, so the first state is
    unknown unless `start` says otherwise.
    """
    real = "fixed" if asked.fixed else "float" if asked.single else None
    folder, targets, start = asked.folder, asked.targets, asked.start
    for target in targets:
        check(target, None if target == "runtime" else real)
    fitted = identify.load(folder)
    data = identify.internal.read_document(folder)["data"]
    date, checksum = asked.date or data.get("date") or "", data.get("sha256") or ""
    if isinstance(fitted.detail, identify.Motion):
        return _oscillator(fitted, targets, real, (date, checksum))
    verdict = fitted.verdict
    if fitted.channels is not None or isinstance(fitted.detail, identify.DiscreteSpectrum):
        raise InputError(
            "not-invertible",
            "A fit of several inputs, or of creep, has no inverse.",
            place=str(folder),
            fix="Export a fit of one input that changes over time.",
        )
    record, judged = fitted.train, judged_compensator(fitted)
    # The verdict is on what is exported: on the compensator, too.
    if fitted.purpose != "compensate":
        better = [note for note in judged.reasons if note.code != "compensator-error"]
        verdict = verdict.at_most(judged.level, *better)
    learnt = error_of(fitted)
    error, guard = learnt.around(invert(fitted.model)), guard_of(fitted, learnt)
    limits = asked.limits or wider(record.output[record.mask])
    readings, times = readings_of_training(fitted)
    program = Program(
        fitted.model,
        readings,
        times=times,
        reading=Quantity(record.output_name, record.output_unit),
        estimate=Quantity(record.input_name, record.input_unit),
        title=fitted.name,
        limits=limits,
        depth=asked.depth,
        error=error,
        band=_band(folder, error, checksum),
        trained=fitted.trained,
        past=guard["past"],
        deviation=guard["deviation"],
        seen=guard["seen"],
        beyond=asked.beyond,
        start=start,
        origin=Origin(verdict.level, verdict.codes, date, checksum),
        time_unit=record.time_unit,
    )
    files, notes = _written(program, targets, real)
    assert program.guard is not None
    kept = fitted.compensator or {}
    run_in = (
        RunIn.of(kept)
        if start == "unknown" and "ok_share" in kept
        else run_in_of(np.asarray(estimate(program.guard, record).status), record, start)
    )
    if run_in.share < HALF:
        notes.append("Most estimates are not OK: a program that waits for OK seldom runs.")
    notes += [str(note) for note in judged.reasons if note.code != "compensator-error"]
    if not fitted.trusted:
        notes.append(f"This fit is not trusted: {' '.join(fitted.verdict.reasons)}")
    text = [run_in.sentence(record.time_unit), _spent(program)]
    document = {
        "files": files, "notes": notes, "limits": [float(x) for x in limits],
        "trained": list(fitted.trained), "beyond": asked.beyond, "date": date or None, **run_in.document,
        "text": "\n".join(text),
        "operations": program.operations._asdict(),
    }  # fmt: skip
    return _done(document, text)


def _done(document: dict[str, Any], lines: list[str]) -> Done:
    for line in warnings(document["notes"]):
        log(line)
    return Done(document, [*lines, *document["files"].values()])


def _spent(program: Program) -> str:
    mean, most, rows = program.operations
    return (
        f"A step took {mean:,.0f} operations in the mean, {most:,} at most, on {rows:,} readings."
    )


def readings_of_training(fitted: identify.FitResult) -> tuple[np.ndarray, np.ndarray | None]:
    """The outputs of the longest sequence that was fitted, with the condition if any, and their times."""
    record = fitted.train
    rows = longest_sequence(record, record.mask & np.isfinite(record.output))
    given = with_condition(fitted.model, record, np.where(record.mask, record.output, np.nan))
    return given[rows], None if record.time is None else record.time[rows]


def _written(
    program: Program, targets: dict[str, Path], real: str | None
) -> tuple[dict[str, str], list[str]]:
    """The files by target, and the notes on all of them."""
    files, notes = {}, [*program.notes]
    for target, path in targets.items():
        done = write_to(target, program, path, None if target == "runtime" else real)
        files[target] = str(done.path)
        notes += [note for note in done.notes if note not in notes]
    return files, notes


def _oscillator(
    fitted: identify.FitResult, targets: dict[str, Path], real: str | None, data: tuple[str, str]
) -> Done:
    """The step of an oscillator, force to displacement: it has no compensator."""
    assert isinstance(fitted.detail, identify.Motion)
    record, motion = fitted.train, fitted.detail.recorded
    program = Program(
        motion.model,
        record.input,
        times=motion.dt * np.arange(len(record)),
        reading=Quantity(record.input_name, record.input_unit),
        estimate=Quantity(record.output_name, record.output_unit),
        title=fitted.name,
        origin=Origin(fitted.verdict.level, fitted.verdict.codes, *data),
        time_unit=record.time_unit,
    )
    files, notes = _written(program, targets, real)
    low, high = fitted.trained
    notes.append(
        "The file steps from force to displacement. The force is straight between its samples."
    )
    document = {
        "files": files, "notes": notes, "limits": None, "trained": [low, high], "beyond": None,
        "start": "known", "date": None, "text": "",
    }  # fmt: skip
    return _done(document, [])


def _band(folder: Path, error: CalibratedCompensator, sha256: str) -> GuaranteedCompensator | None:
    """The band that `hysid qualify --guarantee` has found for this fit; None where there is none."""
    file = folder / "qualify.json"
    known = json.loads(file.read_text("utf-8")).get("guarantee") if file.exists() else None
    # A fit that was made anew is another one, and so is its band.
    if not known or not known.get("given") or not sha256 or known.get("sha256") != sha256:
        return None
    factor = jnp.asarray(known["factor"], float)
    return GuaranteedCompensator(error, factor, GAIN * factor, known["asked"], known["runs"])
