"""`hysid qualify`: a verdict on the compensator of a fit, from a file it has not seen."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

import identify
from compensate import estimate, guaranteed, invert
from compensate import qualify as qualified
from compensate._qualification import Qualification, Step, Tell
from compensate.export._export import Program
from compensate.guards._guarded import GuardedCompensator
from compensate.uncertainty._calibrated import band_holds
from compensate.uncertainty._ensemble import EnsembleCompensator
from compensate.uncertainty._guaranteed import run_scores, runs_needed
from hysteresis import InputError, Note, Record
from hysteresis._format import quantity
from hysteresis._verdict import Level, Verdict, worst_of
from identify import load_posterior

from .._compensator import error_of, exported
from ..intake._folders import folders_of
from ..intake._selection import for_new_file, known_records, selection_of_fit
from ._asked import Qualify
from ._console import USER, Done, Progress, warnings
from ._export import guarding, readings_of_training, seconds_a_step

STEPS = 2000
"""Steps that are timed, at most."""


def step_of(fitted: identify.FitResult, target: str, mhz: float | None) -> Step | None:
    """Over the training's readings: "c" by counted operations, a cycle of `mhz` each; "python" timed here.

    None where the compensator cannot be exported.
    """
    readings, times = readings_of_training(fitted)
    try:
        program = Program(fitted.model, readings, times=times, start="unknown", **guarding(fitted))
    except InputError:
        return None
    if target == "python":
        clock = np.zeros(len(readings)) if times is None else times
        samples = np.column_stack([np.diff(clock, prepend=clock[0]), readings])[:STEPS].tolist()
        with tempfile.TemporaryDirectory() as place:
            file = program.write_runtime(Path(place) / "it.json").path
            return Step("plain Python here", seconds_a_step(file, samples))
    mean, most, _ = program.operations
    cycle = float("nan") if mhz is None else 1e-6 / mhz
    return Step("C", cycle * mean, cycle * most, mean, most)


DRAWS, ROWS = 50, 200_000
"""Of a posterior, side by side: so many draws, or fewer where rows times draws are more than this. A row of
a draw of a composition, which is found by bisection, takes 0.2 ms."""


def run(asked: Qualify) -> Done:
    """Qualify the compensator of a fit, or of each of several, and write DIR/qualify.json.

    In the file of the fit itself only the rows held out from it count; where none were, the verdict
    is CAUTION at best.
    """
    with Progress("qualify", later=True) as progress:
        return _qualified(asked, progress)


def _qualified(asked: Qualify, tell: Tell) -> Done:
    folder, file = asked.folder, asked.file
    document = identify.internal.read_document(folder)
    fitted_on = selection_of_fit(document)
    if fitted_on.is_step or isinstance(fitted_on.input, tuple):
        what = "a constant input" if fitted_on.is_step else f"{len(fitted_on.input or ())} inputs"
        raise InputError(
            "not-invertible",
            f"This fit has {what}, which cannot be recovered from the output.",
            place=str(folder),
            fix="Qualify a fit of one input that changes over time.",
        )
    selection = replace(fitted_on, **asked.selection)
    source = selection.read(file)
    narrowed, compared, said = for_new_file(selection, source, inverse=True)
    if not compared:  # both readings are needed: reading them says which is not there
        narrowed = replace(narrowed, input=fitted_on.input, output=fitted_on.output)
    folders = folders_of(folder, document)
    fits = {value: identify.load(folder / name) for value, name in folders.items()}
    fitted_here = any(fit.train.sha256 == source.sha256 for fit in fits.values())
    narrowed = narrowed if fitted_here else narrowed.without_hold_out()
    records = known_records(narrowed, source, folders)
    found: dict[str, Qualification] = {}
    held: dict[str, float | None] = {}
    for value, (record, held_out) in records.items():
        place, seen = folder / folders[value], held_out or record
        step = None if asked.rate is None else step_of(fits[value], asked.target, asked.mhz)
        before, of = len(found), len(records)

        def told(done: int, total: int, text: str, before: int = before, of: int = of) -> None:
            tell(before * total + done, of * total, text)

        one = _of_one(fits[value], place, seen, asked, step, told)
        share, scores = band_holds(error_of(fits[value]), fits[value].clocks.applied(seen))
        held[value] = share if len(scores) else None
        if len(scores):
            said_of = (
                f"The 90 % band of the fit's own deviation holds {100 * share:.3g} % of the rows."
            )
            one = _with("PASS", one, Note("band", said_of))
        if fitted_here and held_out is None:
            why = "The model was fitted to these rows, so the error on new data is not known."
            one = _with("CAUTION", one, Note("rows-seen", why))
        found[value] = one
    bands = {}
    if asked.guarantee is not None:
        for value in found:
            record = records[value][1] or records[value][0]
            bands[value] = guarantee_of(fits[value], record, asked.guarantee)
            said += [] if bands[value]["given"] else [bands[value]["text"]]
    one_band = {"guarantee": bands.get("", bands or None), "band": held.get("", held)}
    result = _together(found) | one_band | {"notes": said, "file": str(folder / "qualify.json")}
    identify.internal.write_json(folder / "qualify.json", result | {"source": file.name})
    head = {value: f"{fitted_on.each} = {value}\n" if value else "" for value in found}
    more = {value: f"\n{band['text']}" for value, band in bands.items() if band["given"]}
    texts = (head[value] + one.text + more.get(value, "") for value, one in found.items())
    lines = [*warnings(said, "Note"), *texts, result["file"]]
    return Done(result, lines, USER if result["verdict"]["level"] == "FAIL" else 0)


def _of_one(
    fitted: identify.FitResult,
    place: Path,
    record: Record,
    asked: Qualify,
    step: Step | None,
    tell: Tell,
) -> Qualification:
    identify.internal.check_units(fitted, record, "input", "output")
    # Estimates are of the input on the model's clock.
    record = fitted.clocks.applied(record)
    compensator = exported(fitted)
    ensemble, facts = None, []
    if lag := fitted.clocks.lag:
        when = f"{abs(lag):.3g} {record.time_unit} {'earlier' if lag > 0 else 'later'}"
        said = f"Estimates are of the input {when}, because the fit removed that lag."
        facts.append(Note("lag", said))
    if (posterior := load_posterior(place)) is not None:
        try:
            ensemble = EnsembleCompensator(_some_of(posterior, len(record)))
        except InputError as error:
            said = f"The posterior of this fit cannot be inverted: {error}"
            facts.append(Note("no-posterior", said))
    found = qualified(
        compensator, record, fitted.model, ensemble, asked.max_error, asked.rate, step, tell
    )
    return _with("PASS", found, *facts)


def _with(most: Level, found: Qualification, *notes: Note) -> Qualification:
    return replace(found, verdict=found.verdict.at_most(most, *notes))


def guarantee_of(fitted: identify.FitResult, record: Record, guarantee: float) -> dict[str, Any]:
    """What a band around the compensator's estimates can guarantee from the runs of a record.

    Its shape is the deviation that the compensator is exported with.
    """
    inner = error_of(fitted).around(invert(fitted.model))
    compensator = GuardedCompensator(inner, *fitted.trained)
    needed = runs_needed(guarantee)
    known = {"asked": guarantee, "needed": needed}
    applied = fitted.clocks.applied(record)
    scores = run_scores(compensator, applied)
    if len(scores) < needed:
        most = len(scores) / (len(scores) + 1)
        text = (
            f"Cannot guarantee {100 * guarantee:g} %: that needs {needed} runs or cycles, and the file has"
            f" {len(scores)}, which can guarantee {100 * most:.3g} % at most."
        )
        none = dict.fromkeys(("factor", "half_width"))
        return known | {"given": False, "runs": len(scores), **none, "text": text}
    band = guaranteed(compensator, applied, guarantee)
    low, high = band.around(estimate(compensator, applied))
    half = (high - low)[applied.mask] / 2
    wide = quantity(float(half.mean()), fitted.train.input_unit, 3)
    text = f"guaranteed band: +- {wide} in the mean. {band.statement}"
    return known | {
        "given": True, "runs": band.runs, "factor": band.factor, "half_width": float(half.mean()),
        "text": text, "sha256": fitted.train.sha256,
    }  # fmt: skip


def _some_of(posterior: identify.internal.Posterior, rows: int) -> Any:
    """One model with some of the posterior's draws, evenly from all, on its leading axis."""
    count = int(np.prod(posterior.draws.shape[:2]))
    wanted = min(DRAWS, max(5, ROWS // rows))
    chosen = np.unique(np.linspace(0, count - 1, wanted).astype(int))
    return jax.tree.map(lambda a: a[chosen], posterior.model)


def _together(found: dict[str, Qualification]) -> dict[str, Any]:
    """The one document, or of several the gravest verdict, the mean error, and `each`."""
    if "" in found:
        return found[""].document
    reasons = tuple(
        Note(one.verdict.codes[0], f"{value}: {one.level}. {one.reasons[0]}")
        for value, one in found.items()
    )
    level = worst_of(one.level for one in found.values())
    return {
        "verdict": Verdict(level, reasons).document,
        "nrmse_percent": float(np.mean([one.nrmse_percent for one in found.values()])),
        "each": {value: one.document for value, one in found.items()},
    }
