"""`hysid export`: the compensator of a fit as a file that runs without JAX."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import identify
from compensate import Quantity, estimate, invert, material_card
from compensate.export._cards import OPENSEES
from compensate.export._export import Origin, Program
from compensate.export.targets._export_to import check, write_to
from compensate.runtime import load
from compensate.uncertainty._calibrated import CalibratedCompensator
from compensate.uncertainty._guaranteed import Guaranteed
from hysteresis import InputError
from hysteresis._files import write_whole
from hysteresis._format import quantity
from hysteresis._quantities import conversion
from hysteresis.models._conditioned import with_condition
from hysteresis.models._viscoelastic import AbstractViscoelastic
from hysteresis.records._abstract_record import kind_of_units
from identify.results._detail import DiscreteSpectrum, Motion

from .._compensator import (
    RunIn,
    error_of,
    guard_of,
    judged_compensator,
    limits_of,
    longest_sequence,
    run_in_of,
)
from ..intake._options import option_words
from ._asked import Export
from ._console import Done, log, warnings

HALF = 0.5
"""Share of OK estimates below which an export says so: `if (status == OK)` then seldom runs in a robot."""


def run(asked: Export) -> Done:
    """Write what the targets name; readings beyond the limits are taken for the limit.

    Estimates are guarded by the trained inputs. A robot is switched on at any time, so the first state is
    unknown unless `start` says otherwise.
    """
    if asked.card:
        assert asked.to is not None
        if len(asked.targets) > 1:
            said = "A material card is not a compensator."
            raise InputError("bad-option", said, fix="Export them one by one.")
        return _card(asked, *asked.to)
    real = "fixed" if asked.fixed else "float" if asked.single else None
    folder, targets, start = asked.folder, asked.targets, asked.start
    for target in targets:
        check(target, None if target == "runtime" else real)
    fitted = identify.load(folder)
    data = identify.internal.read_document(folder)["data"]
    date, checksum = asked.date or data.get("date") or "", data.get("sha256") or ""
    if isinstance(fitted.detail, Motion):
        _check_idle(asked, "an oscillator", "depth", "limits", "beyond", "start")
        return _oscillator(fitted, targets, real, (date, checksum))
    verdict = fitted.verdict
    if fitted.channels is not None or isinstance(fitted.detail, DiscreteSpectrum):
        said = "A fit of several inputs, or of creep, has no inverse."
        fix = "Export a fit of one input that changes over time."
        raise InputError("not-invertible", said, place=str(folder), fix=fix)
    record, judged = fitted.train, judged_compensator(fitted)
    # The verdict is on what is exported: on the compensator, too.
    if fitted.purpose != "compensate":
        better = [note for note in judged.reasons if note.code != "compensator-error"]
        verdict = verdict.at_most(judged.level, *better)
    guard = guarding(fitted)
    limits = asked.limits or limits_of(fitted)
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
        band=_band(folder, guard["error"], checksum),
        **guard,
        beyond=asked.beyond,
        start=start,
        origin=Origin(verdict.level, verdict.codes, date, checksum),
        time_unit=record.time_unit,
    )
    if not program.stacks:
        _check_idle(asked, "a model without reversals to store", "depth")
    files, notes = _written(program, targets, real)
    assert program.guard is not None
    kept = fitted.compensator or {}
    if start == "unknown" and asked.limits is None and "ok_share" in kept:
        run_in = RunIn.of(kept)
    else:
        status = np.asarray(estimate(replace(program.guard, readings=limits), record).status)
        run_in = run_in_of(status, record, start)
    if run_in.share < HALF:
        notes.append("Most estimates are not OK: a program that waits for OK seldom runs.")
    notes += [str(note) for note in judged.reasons if note.code != "compensator-error"]
    notes += _doubts(fitted)
    notes += _too_coarse(guard, record.input_unit) if asked.single else []
    mean, most, rows = program.operations
    spent = (
        f"A step took {mean:,.0f} operations in the mean, {most:,} at most, on {rows:,} readings."
    )
    text = [run_in.sentence(record.time_unit), spent]
    document = {
        "files": files, "notes": notes, "limits": [float(x) for x in limits],
        "trained": list(fitted.trained), "beyond": asked.beyond, "date": date or None, **run_in.document,
        "text": "\n".join(text),
        "operations": program.operations._asdict(),
    }  # fmt: skip
    return _done(document, text)


def _check_idle(asked: Export, model: str, *names: str) -> None:
    """Raise `InputError` where one of these options is given for a model on which it has no effect."""
    for name in names:
        if words := option_words([Export.__dataclass_fields__[name]], vars(asked)):
            raise InputError(
                "bad-option", f"{words[0]} has no effect on {model}.", fix="Leave it out."
            )


def guarding(fitted: identify.FitResult) -> dict[str, Any]:
    """Options of a program: the error of a fit, and what guards its estimates."""
    learnt = error_of(fitted)
    guard = guard_of(fitted, learnt)
    kept = {name: guard[name] for name in ("trained", "past", "deviation", "seen")}
    return {"error": learnt.around(invert(fitted.model)), **kept}


def _card(asked: Export, program: str, path: Path) -> Done:
    """A material card for a finite-element program."""
    fitted = identify.load(asked.folder)
    stress, strain, time = _units(fitted)
    scale = 1.0 if strain == "1" else conversion("1", strain)
    if program == OPENSEES:
        relaxes = isinstance(fitted.model, AbstractViscoelastic)  # and creeps as well
        scale, stress = 1.0, f"{stress} / {strain}"
        if not relaxes and kind_of_units(fitted.train) == "creep":
            raise InputError(
                "not-exportable",
                "A load was fitted as the input, and a uniaxialMaterial takes the deformation.",
                place=str(asked.folder),
                fix="Fit with --input and --output exchanged.",
            )
    elif scale is None or (stress != "1" and conversion(stress, "Pa") is None):
        raise InputError(
            "wrong-unit",
            f"The stiffness is in {stress} / {strain}, and a card needs a modulus.",
            place=str(asked.folder),
            fix="Fit stress and strain (--input-unit mm/mm), not force and displacement.",
        )
    shifts = fitted.detail.shifts if isinstance(fitted.detail, DiscreteSpectrum) else None
    wlf = None
    if shifts is not None and shifts.law == "WLF":
        wlf = shifts.reference, shifts.constants[0], shifts.constants[1]
    card = material_card(
        program, fitted.model, poisson=asked.poisson, shear=asked.shear, unit=stress, time_unit=time,
        scale=scale, wlf=wlf,
    )  # fmt: skip
    write_whole(path, card.text)
    notes = list(card.notes)
    if shifts is not None and wlf is None:
        notes.append("The card has no shift factors: their law is Arrhenius, not WLF.")
    notes += _doubts(fitted)
    document = {"files": {program: str(path)}, "notes": notes, "unit": stress, "time_unit": time}
    return _done(document, [])


def _units(fitted: identify.FitResult) -> tuple[str, str, str]:
    """Of stress, strain and time of a fit."""
    record = fitted.train
    if identify.internal.is_moduli(record):
        return record.output_unit, "1", "s"
    relaxes = isinstance(fitted.model, AbstractViscoelastic)
    if getattr(fitted.model, "leading", False) if relaxes else kind_of_units(record) != "creep":
        return record.output_unit, record.input_unit, record.time_unit
    return record.input_unit, record.output_unit, record.time_unit


def _done(document: dict[str, Any], lines: list[str]) -> Done:
    for line in warnings(document["notes"]):
        log(line)
    return Done(document, [*lines, *document["files"].values()])


def _doubts(fitted: identify.FitResult) -> list[str]:
    said = f"This fit is not trusted: {' '.join(fitted.verdict.reasons)}"
    return [] if fitted.trusted else [said]


def _too_coarse(guard: dict[str, Any], unit: str) -> list[str]:
    """What is said where float does not tell neighbouring estimates apart: an offset takes its digits. Some
    ten operations, each rounded, lie between a reading and its estimate."""
    trained, deviation = guard["trained"], guard["deviation"]
    steps = [np.spacing(np.float32(np.abs(x).max())) / np.ptp(x) for x in (trained, guard["seen"])]
    step = float(max(steps) * np.ptp(trained))
    if 10 * step < deviation:
        return []
    apart, usual = (quantity(x, unit, 2) for x in (step, deviation))
    return [
        f"In float estimates are {apart} apart, and their usual error is {usual}: use double, or take the"
        " offset off the readings before the fit."
    ]


def readings_of_training(fitted: identify.FitResult) -> tuple[np.ndarray, np.ndarray | None]:
    """The outputs of the longest sequence that was fitted, with the condition if any, and their times."""
    record = fitted.train
    rows = longest_sequence(record, record.mask & np.isfinite(record.output))
    given = with_condition(fitted.model, record, np.where(record.mask, record.output, np.nan))
    return given[rows], None if record.time is None else record.time[rows]


def seconds_a_step(file: Path, samples: list[Any]) -> float:
    """The median time of a step of what a runtime file holds, over samples (dt, reading)."""
    runtime, stamps = load(file), [time.perf_counter()]
    for sample in samples:
        runtime.step(*sample)
        stamps.append(time.perf_counter())
    return float(np.median(np.diff(stamps)))


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
    assert isinstance(fitted.detail, Motion)
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
    said = "The file steps from force to displacement. The force is straight between its samples."
    document = {
        "files": files, "notes": [*notes, said], "limits": None, "trained": [low, high], "beyond": None,
        "start": "known", "date": None, "text": "",
    }  # fmt: skip
    return _done(document, [])


def _band(folder: Path, error: CalibratedCompensator, sha256: str) -> Guaranteed | None:
    """The band that `hysid qualify --guarantee` has found for this fit; None where there is none."""
    file = folder / "qualify.json"
    known = json.loads(file.read_text("utf-8")).get("guarantee") if file.exists() else None
    # A fit that was made anew is another one, and so is its band.
    if not known or not known.get("given") or not sha256 or known.get("sha256") != sha256:
        return None
    return Guaranteed(error, known["factor"], known["asked"], known["runs"])
