"""`hysid microchannel train` and `estimate`: a soft sensor is learnt from sessions, and run over a file."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import identify
from compensate import Quantity
from compensate.microchannel import export_force
from compensate.microchannel._force import ForceEstimator
from hysteresis import InputError
from hysteresis._escape import shell_word
from hysteresis._files import write_figure
from hysteresis._format import quantity, rms_error
from hysteresis.numerics._functions import NORMAL_95
from identify.internal import versions

from ..figures._format import label, plain_name
from ..intake._folders import check_writable
from ..intake._selection import Selection
from ..soft_sensor import _sensor
from ..soft_sensor._force_records import ForceRecord
from ..soft_sensor._force_training import KINDS, ForceTraining, train_force, updates_of
from ..soft_sensor._learn import (
    Session,
    Streams,
    Targets,
    checks_of,
    learn_places,
    learn_positions,
    read_sessions,
)
from ..soft_sensor._sensor import (
    ARRAYS,
    FORCE,
    TRAINING,
    WORDS,
    Estimates,
    SoftSensor,
    confusion_lines,
    estimates_of,
    judged,
    save_sensor,
)
from . import _pairs
from ._asked_more import Estimate, Train
from ._console import Done, Progress, log, warnings
from ._export import seconds_a_step
from ._pairs import contact_lines


def estimate(asked: Estimate) -> Done:
    """A trained sensor, or pairs, over a file."""
    given = asked.folder, asked.file, asked.out
    if (asked.folder / _pairs.DOCUMENT).is_file():
        document = _pairs.estimate_contacts(*given, **asked.selection)
    else:
        document = _sensor.estimate(*given, **asked.selection)
    return Done(document, _estimated_lines(document))


def figure_lines(figures: dict[str, Any]) -> list[str]:
    lines = []
    if (force := figures.get("force")) is not None:
        lines.append(f"force: {rms_error(force, force['unit'])}")
    if (place := figures.get("place")) is not None:
        lines.append(f"place: {place['accuracy']:.1%} of {place['rows']} rows correct")
        lines += [f"  {line}" for line in confusion_lines(place["confusion"])]
        if place["rows_at_rest"]:
            lines.append(
                f"  {place['rest_taken_for_a_place']} of {place['rows_at_rest']} rows without a place"
                " were assigned one"
            )
    if (position := figures.get("position")) is not None:
        lines.append(
            f"position: mean error {quantity(position['mean_error'], position['unit'], 3)},"
            f" 95 % within {quantity(position['q95_error'], position['unit'], 3)}"
        )
    return lines


def _estimated_lines(document: dict[str, Any]) -> list[str]:
    lines = warnings(document["notes"])
    for channel, faults in document["channels_at_fault"].items():
        said = ", ".join(f"{fault} in {n} rows" for fault, n in faults.items())
        lines += warnings([f"{channel}: {said}."])
    figures = {k: document[k] for k in ("place", "position") if k in document}
    lines += contact_lines(document.get("contacts"))
    if document["rmse"] is not None:
        figures["force"] = document
    if not document.get("contacts"):
        lines += figure_lines(figures) or ["The file has no measured values to compare with."]
    return [*lines, f"{document['flagged']} of {document['rows']} rows flagged", document["file"]]


SCHEMA = 1
RUNTIME, CHECKPOINT = "runtime.json", "checkpoint"
PICTURES, MOST_SHOWN = ("learning.png", "force.png"), 600
"""Rows of the picture of the force: more cannot be told apart."""
TIMED, SLOW_S = 200, 5e-4
"""Readings by which the runtime is timed; s a reading that are too many for a loop of 1 kHz."""
REPAIRS = {"masked", "filled", "gathered", "cut", "skipped", "units-row"}
"""Codes of notes on a file that are worth a look."""


def train(asked: Train) -> Done:
    """A soft sensor from tables."""
    try:
        with Progress("training") as progress:
            document = _trained(asked, asked.out, progress)
    except KeyboardInterrupt:
        if (asked.out / CHECKPOINT).is_dir():
            given = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
            log(f"To resume: hysid {' '.join(map(shell_word, [*given, '--resume']))}")
        raise
    return Done(document, _lines(document, asked.out))


def _trained(asked: Train, out: Path, progress: Progress) -> dict[str, Any]:
    """Learn all targets, write the sensor, its figures and pictures, and return training.json's object.

    Raises `InputError` for files and columns that cannot be used, results that are there already, a
    resumed training of other data or settings, and as `train_force`, `Localizer.train` and
    `fit_positions` do.
    """
    selection = Selection(**asked.selection, output=asked.force or "")
    targets = Targets(asked.force, asked.place, asked.position)
    names = tuple(filter(None, map(str.strip, asked.places.split(","))))
    free = asked.overwrite or asked.resume
    identify.internal.check_free(out, free, TRAINING)
    identify.internal.check_free(out, free, CHECKPOINT, "go on from them (--resume)")
    identify.internal.check_free(out, overwrite=False)  # a fit is none of a sensor's results
    check_writable(out)
    sessions = read_sessions(asked.files, selection, targets, asked.test_file or ())
    parts = [one.train for one in sessions if one.train is not None]
    held_out = [one.test for one in sessions if one.test is not None]
    checks = checks_of(parts, sessions[0].channels, targets, noise=asked.noise, ends=asked.range)
    notes, learnt, forced, tried = [*_notes(sessions), *checks.notes], {}, None, {}
    if targets.force is not None:
        out.mkdir(parents=True, exist_ok=True)
        forced, tried = _learn_force(parts, out / CHECKPOINT, asked, progress)
        learnt["force"] = forced.estimator
    if targets.place is not None:
        log("learning places")
        learnt["localizer"], said = learn_places(parts, held_out, checks, names, asked.method)
        notes += said
    if targets.position:
        log("learning positions")
        learnt["position"], said = learn_positions(parts, checks, asked.seed)
        notes += said
    sensor = SoftSensor(
        sessions[0].channels, checks.readout, checks.step,
        force_in=sessions[0].force or FORCE, position_in=sessions[0].position,
        time_unit=parts[0].record.time_unit, **learnt,
    )  # fmt: skip
    log("judging")
    judgements = {"train": _judged(sensor, parts), "test": _judged(sensor, held_out)}
    for old in (WORDS, ARRAYS, TRAINING, RUNTIME, *PICTURES):
        (out / old).unlink(missing_ok=True)
    save_sensor(sensor, out)
    runtime = None
    if sensor.force is not None:
        runtime, said = _write_runtime(sensor, sensor.force, parts, out / RUNTIME)
        notes += said
    shown = judgements["test"] or judgements["train"]
    assert shown is not None
    pictures = _draw(out, sensor.force_in, forced, shown)
    kept = ("kind", "epochs", "members", "seed", "noise", "resume", "method")
    settings = {name: getattr(asked, name) for name in kept}
    settings |= {"ends": asked.range, "places": names}
    document = {
        "schema": SCHEMA, "kind": "hysid soft sensor training",
        "inputs": [channel._asdict() for channel in sensor.channels],
        "targets": {"force": targets.force, "place": targets.place, "position": targets.position},
        "units": {q.name: q.unit for q in filter(None, (sessions[0].force, *sessions[0].position))},
        "rows": sum(one.rows for one in sessions),
        "rows_train": sum(map(_rows, parts)), "rows_test": sum(map(_rows, held_out)),
        "files": [
            {"file": str(one.file), "sha256": one.sha256, "rows": one.rows}
            | {f"rows_{k}": _rows(getattr(one, k)) for k in ("train", "test")} for one in sessions
        ],
        "sha256": {str(one.file): one.sha256 for one in sessions},
        "metrics": {name: found.figures if found else None for name, found in judgements.items()},
        "force": forced and {
            "kind": forced.kind, "held_out_rmse_by_kind": tried, "held_out_rmse": forced.rmse,
            "held_out_nrmse_percent": forced.nrmse_percent,
            "coverage_of_90_percent_bands": forced.coverage, "settings": forced.settings,
            "deviation": float(forced.estimator.deviation),
            "seconds": sum(one.seconds for one in forced.curves),
        },
        "noise": checks.noise, "settings": settings, "seed": asked.seed,
        "selection": selection.as_json(), "notes": notes, "pictures": pictures, "runtime": runtime,
        "versions": versions(("hysid", "jax", "equinox", "optax", "numpy")),
    }  # fmt: skip
    identify.internal.write_json(out / TRAINING, document)
    return identify.internal.plain(document)


class _Judgement(NamedTuple):
    """What was pressed in streams one behind the other, what was found, and how far off it is."""

    truth: dict[str, np.ndarray]
    found: Estimates
    figures: dict[str, Any]


def _judged(sensor: SoftSensor, streams: list[Streams]) -> _Judgement | None:
    if not streams:
        return None
    each = [estimates_of(sensor, one.record.time, one.readings, one.sequences()) for one in streams]
    found = {name: np.concatenate([one[name] for one in each]) for name in each[0]}
    names = ("force", "place", "position", "counts")
    truth = {name: np.concatenate([getattr(one, name) for one in streams]) for name in names}
    return _Judgement(truth, found, judged(sensor, found, *truth.values()))


def _learn_force(
    parts: Sequence[Streams], checkpoint: Path, asked: Train, progress: Progress
) -> tuple[ForceTraining, dict[str, float]]:  # fmt: skip
    """Of the kind asked for, or of all there can be, the least held-out error; and those of all."""
    records = [one for part in parts for one in _records(part)]
    several = parts[0].readings.shape[1] > 1
    kinds = (asked.kind,) if asked.kind != "auto" else ("network",) if several else (*KINDS,)
    options: dict[str, Any] = {"members": asked.members, "seed": asked.seed}
    if asked.epochs is not None:
        rows = sum(int(np.isfinite(record.force).sum()) for record in records)
        options["updates"] = updates_of(asked.epochs, rows)
    found: dict[str, ForceTraining] = {}
    for kind in kinds:
        log(f"learning the force: {kind}")
        try:
            found[kind] = train_force(
                records, kind=kind, nan="omit", checkpoint=checkpoint / kind,
                resume=asked.resume, tell=progress, **options,
            )  # fmt: skip
        except InputError as error:
            if len(kinds) == 1 or error.code not in ("nothing-fits", "diverged"):
                raise
            log(f"{kind}: {error}")
            continue
        log(f"{kind}: held-out RMSE {found[kind].rmse:.4g}")
    if not found:
        raise InputError(
            "nothing-fits", "No kind of estimator could be trained.", fix="Check the data."
        )
    best = min(found.values(), key=lambda one: one.rmse)
    return best, {kind: one.rmse for kind, one in found.items()}


def _records(part: Streams) -> list[ForceRecord]:
    """Sequences up to the last row that counts; forces of others are not known."""
    if part.record.time is None:
        raise InputError(
            "no-time", "A force that depends on the history needs the times of the readings.",
            place=part.record.source, fix="Name their column (--time COL), or their step (--dt SECONDS).",
        )  # fmt: skip
    force, found = np.where(part.counts, part.force, np.nan), []
    for rows in part.sequences():
        counted = np.flatnonzero(part.counts[rows])
        if counted.size:
            rows = slice(rows.start, rows.start + int(counted[-1]) + 1)
            found.append(ForceRecord(part.record.time[rows], part.readings[rows], force[rows]))
    return found


def _write_runtime(
    sensor: SoftSensor, force: ForceEstimator, parts: Sequence[Streams], file: Path
) -> tuple[dict[str, Any] | None, list[str]]:
    """The force estimator for plain Python, with the longest stream as its golden readings."""
    streams = [(part, rows) for part in parts for rows in part.sequences()]
    part, rows = max(streams, key=lambda one: one[1].stop - one[1].start)
    readings = part.readings[rows]
    try:
        export_force(
            force, file, readings[:, 0] if readings.shape[1] == 1 else readings,
            times=None if part.record.time is None else part.record.time[rows],
            channels=sensor.channels, estimate=sensor.force_in,
        )  # fmt: skip
    except InputError as error:
        return None, [f"no {RUNTIME}, which runs without JAX: {error}"]
    spent = seconds_a_step(file, [(sensor.step, one) for one in readings[:TIMED].tolist()])
    said = f"{RUNTIME} takes {1e3 * spent:.2g} ms a reading: for a fast loop take --kind network."
    found = {"file": file.name, "microseconds_a_reading": round(1e6 * spent, 1)}
    return found, [said] if spent >= SLOW_S else []


def _draw(out: Path, force: Quantity, forced: ForceTraining | None, shown: _Judgement) -> list[str]:
    """Pictures of the training, and of the force that was held out, or learnt from where nothing was."""
    from ..figures import _base as f  # late: matplotlib is slow, and `estimate` draws nothing

    drawn = {}
    if forced is not None and forced.curves:
        curves = [
            f.Curve("" if k else word, np.arange(1.0, len(y) + 1), np.sqrt(y), colour)
            for k, one in enumerate(forced.curves)
            for word, colour, y in (
                ("learnt from", f.SKY, one.train), ("held out", f.VERMILLION, one.validation),
            )
        ]  # fmt: skip
        drawn[PICTURES[0]] = f.chart(curves, "epoch", label("RMSE", force.unit), log="y")
    if "force" in shown.figures:
        rows = np.flatnonzero(shown.truth["counts"])[:MOST_SHOWN]
        x, found = rows + 1.0, shown.found["force"][rows]
        half = NORMAL_95 * shown.found["force_sd"][rows]
        curves = [
            f.Curve("measured", x, shown.truth["force"][rows], f.GREY, "under"),
            f.Curve("estimated", x, found, f.BLUE),
        ]
        band = f.Band("90 % band", x, found - half, found + half)
        up = label(plain_name(*force), force.unit)
        drawn[PICTURES[1]] = f.chart(curves, "row", up, band=band)
    for name, figure in drawn.items():
        f.styled(write_figure)(figure, out / name, dpi=144)
    return list(drawn)


def _notes(sessions: Sequence[Session]) -> list[str]:
    """What the files say of themselves, each once; places that only some sessions have."""
    parts = [part for one in sessions for part in (one.train, one.test) if part is not None]
    records = [part.record for part in parts]
    found = [f"{r.source}: {note}" for r in records for note in r.history if note.code in REPAIRS]
    there = {
        one.file.name: {str(name) for name in one.train.place[one.train.counts]} - {""}
        for one in sessions if one.train is not None
    }  # fmt: skip
    everywhere = set().union(*there.values())
    for name, places in there.items():
        if places and (missing := sorted(everywhere - places)):
            found.append(f"{name} has no row to learn from at {', '.join(map(repr, missing))}.")
    return list(dict.fromkeys(found))


def _rows(part: Streams | None) -> int:
    """Rows that count."""
    return 0 if part is None else int(part.counts.sum())


def _lines(document: dict[str, Any], out: Path) -> list[str]:
    lines = warnings(document["notes"])
    if (force := document["force"]) is not None:
        rmse = quantity(force["held_out_rmse"], document["units"][document["targets"]["force"]], 3)
        lines.append(
            f"Force: {force['kind']}; cross-validated on the training rows: {rmse} rms"
            f" ({force['held_out_nrmse_percent']:.3g} % of the range)"
        )
    for part, said in (("train", "Training"), ("test", "Held-out")):
        if (figures := document["metrics"][part]) is not None:
            rows = document[f"rows_{part}"]
            lines += [f"{said} rows ({rows}):", *(f"  {x}" for x in figure_lines(figures))]
    return [*lines, f"Sensor: {out}"]
