"""`hysid microchannel train-pairs`, and `estimate` of its folder: forces on several places at once."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

import compensate
import identify
from compensate import Status
from compensate.microchannel import export_contacts
from compensate.microchannel._multi import MultiContactEstimator
from hysteresis import InputError, Record
from hysteresis._files import write_table
from hysteresis._format import rms_error
from hysteresis._limits import damage_told, load_arrays
from hysteresis._quantities import conversion
from hysteresis._serialisation import described, rebuilt
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.records._table import Table, rows_read
from identify.internal import metrics, versions

from ..figures._format import plain_name
from ..intake._folders import check_writable
from ..intake._selection import Selection, in_unit
from ..soft_sensor._contacts import UPDATES, train_contacts
from ..soft_sensor._force_records import ForceRecord
from ..soft_sensor._force_training import updates_of
from ..soft_sensor._learn import AT_REST
from ..soft_sensor._sensor import lengthened
from ._asked_more import TrainPairs
from ._console import Done, Progress, log, warnings

DOCUMENT, ARRAYS, RUNTIME = "contacts.json", "contacts.npz", "runtime.json"
SCHEMA = 1


class Stretch(NamedTuple):
    """One sequence from rest: readings (samples, channels), forces (samples, places) in N or NaN."""

    line: np.ndarray
    time: Float[np.ndarray, " samples"]
    reading: Float[np.ndarray, "samples channels"]
    force: Float[np.ndarray, "samples places"]


def train_pairs(asked: TrainPairs) -> Done:
    """An estimator of the forces on several places."""
    with Progress("training") as progress:
        document = _trained(asked, asked.out, progress)
    lines = [*warnings(document["notes"]), *contact_lines(document["metrics"])]
    return Done(document, [*lines, f"Estimator: {asked.out}"])


def _trained(asked: TrainPairs, out: Path, progress: Progress) -> dict[str, Any]:
    """Learn each place from the sequences that press it alone; judge on those that press several.

    Returns contacts.json's object.

    Raises `InputError` for files and columns that cannot be used, a place that no sequence presses alone,
    results that are there already, and as `hysid.train_contacts` does.
    """
    forces, selection = asked.force, Selection(**asked.selection, output=asked.force[0])
    selection.check_columns(*forces)
    identify.internal.check_free(out, asked.overwrite, DOCUMENT)
    check_writable(out)
    taught, held_out, table, record = [], [], None, None
    for file in asked.files:
        table = selection.read(file)
        train, test = selection.records(table)[0][""]
        record = train
        if not all(
            train.mask[rows].all() or not train.mask[rows].any() for _, rows in train.sequences()
        ):
            raise InputError(
                "bad-option", "Rows within a sequence are held out.", place=str(file),
                fix="Hold out whole sequences: --group session --test-where session=13,14.",
            )  # fmt: skip
        taught += stretches(train, table, forces)
        held_out += [] if test is None else stretches(test, table, forces)
    assert record is not None
    most = np.nanmax([one.force.max(axis=0) for one in taught], axis=0)
    names = [plain_name(name, "N") for name in forces]
    places: dict[str, list[ForceRecord]] = {name: [] for name in names}
    for one in taught:
        pressed = np.flatnonzero((one.force > AT_REST * most).any(axis=0))
        if len(pressed) == 1:
            k = pressed[0]
            places[names[k]].append(ForceRecord(one.time, one.reading, one.force[:, k]))
        elif len(pressed) > 1:
            held_out.append(one)
    if alone := [name for name, found in places.items() if not found]:
        raise InputError(
            "too-few-presses", f"No sequence presses {alone[0]} alone.", place=str(asked.files[0]),
            cause="Sequences are not told apart, or all places are always pressed together.",
            fix="Name the column that numbers them (--group COL), and press each place by itself.",
        )  # fmt: skip
    log(f"learning {' and '.join(names)}")
    rows = min(sum(len(one.time) for one in found) for found in places.values())
    updates = UPDATES if asked.epochs is None else updates_of(asked.epochs, rows)
    learnt = train_contacts(
        places, noise=asked.noise, seed=asked.seed, tell=progress, updates=updates
    )
    units = list(record.channels.values()) or [record.input_unit]
    channels = list(record.channels) or [record.input_name]
    quantities = [compensate.Quantity(*of) for of in zip(channels, units, strict=True)]
    document: dict[str, Any] = {
        "schema": SCHEMA, "kind": "hysid contact forces", "inputs": [q._asdict() for q in quantities],
        "forces": list(forces), "names": names, "selection": selection.as_json(),
        "taught": {name: len(found) for name, found in places.items()},
        "off": learnt.off.tolist(), "judged": len(held_out),
        "metrics": judged(learnt.estimator, held_out, names), "seed": asked.seed,
        "motion": {k: getattr(learnt.estimator.motion, k) for k in ("high", "turn", "turns")},
        "versions": versions(("hysid", "jax", "equinox", "optax", "numpy")),
    }  # fmt: skip
    document["structure"], arrays = described(learnt.estimator)
    done = identify.internal.write_set(
        out, DOCUMENT, document, {ARRAYS: arrays}, remove=(RUNTIME,),
        check=partial(identify.internal.check_free, out, asked.overwrite, DOCUMENT),
    )  # fmt: skip
    example = max(held_out or taught, key=lambda one: len(one.time))
    runtime = export_contacts(
        learnt.estimator, out / RUNTIME, example.reading, example.time, channels=quantities,
        contacts=[compensate.Quantity(name, "N") for name in names],
    )  # fmt: skip
    notes = [f"No sequence presses {' and '.join(learnt.names)} at once, so nothing was judged."]
    told = {"runtime": str(runtime), "notes": [] if held_out else notes}
    return identify.internal.plain(done | told)


def contact_lines(found: dict[str, Any] | None) -> list[str]:
    """Errors of each place's force."""
    return [
        f"{name}: {rms_error(of, 'N')}; 90 % bands hold"
        f" {100 * of['coverage_of_90_percent_bands']:.0f} % of the rows"
        for name, of in (found or {}).items()
    ]


def stretches(record: Record, table: Table, forces: Sequence[str]) -> list[Stretch]:
    """The sequences of a record, with the forces of all places; NaN for columns that are not there."""
    rows = rows_read(table, record)
    if record.time is None:
        raise InputError(
            "no-time", "Forces that depend on the history need the times of the readings.",
            place=table.path, fix="Name their column (--time COL), or their step (--dt SECONDS).",
        )  # fmt: skip
    seconds = conversion(record.time_unit, "s") or 1.0
    columns = [record.columns[name] for name in record.channels] or [record.input]
    reading = np.column_stack(columns)
    missing = np.full(len(table.line), np.nan)
    columns = [in_unit(table, x, "N") if x in table.columns else missing for x in forces]
    force = np.column_stack(columns)[rows]
    return [
        Stretch(record.line[part], seconds * record.time[part], reading[part], force[part])
        for _, part in record.sequences()
        if record.mask[part].any()
    ]


def found_in(estimator: MultiContactEstimator, one: Stretch) -> tuple[np.ndarray, ...]:
    """Forces, deviations and statuses of a stretch."""
    found = estimator.simulate(lengthened(one.time), lengthened(one.reading))
    parts = found.value, found.deviation, found.status
    return tuple(np.asarray(part)[: len(one.time)] for part in parts)


def judged(
    estimator: MultiContactEstimator, held_out: Sequence[Stretch], names: Sequence[str]
) -> dict[str, Any] | None:
    """Errors of each place's force over stretches with known forces, and how often 90 % bands hold."""
    known = [one for one in held_out if np.isfinite(one.force).all()]
    if not known:
        return None
    pairs = [(one.force, *found_in(estimator, one)[:2]) for one in known]
    force, value, deviation = (np.concatenate(part) for part in zip(*pairs, strict=True))
    held = np.abs(value - force) < NORMAL_95 * deviation
    return {
        name: {
            **metrics(force[:, k], value[:, k])._asdict(),
            "coverage_of_90_percent_bands": float(held[:, k].mean()),
        }
        for k, name in enumerate(names)
    }


def estimate_contacts(
    folder: Path, file: Path, target: Path | None = None, *,
    where: tuple[str, ...] = (), **reading: Any,
) -> dict[str, Any]:  # fmt: skip
    """Forces of all places behind the readings of a file, with deviations and statuses, to a table.

    Raises `InputError` for a damaged folder, and a file without a channel or a clock.
    """
    known = {"make": "", "again": "train again."}
    document = identify.internal.read_checked(folder, DOCUMENT, SCHEMA, **known)
    with damage_told(DOCUMENT, folder, "Train again."):
        arrays = load_arrays(identify.internal.whole_files(folder, document)[ARRAYS])
        estimator = rebuilt(document["structure"], arrays)
    selection = Selection.from_json(document["selection"]).without_hold_out()
    selection = replace(selection, where=where or selection.where, **reading)
    table, names = selection.read(file), document["names"]
    if selection.output not in table.columns:  # a log without forces: any column will do
        selection = replace(selection, output=document["inputs"][0]["name"], output_unit=None)
    record = selection.records(table)[0][""][0]
    parts = stretches(record, table, document["forces"])
    value, deviation, status = zip(*(found_in(estimator, one) for one in parts), strict=True)
    target = target or folder / f"estimated-{Path(file).stem}.csv"
    header = [f"{name} (N)" for name in names] + [f"{name} sd (N)" for name in names]
    words = [Status(int(one)).name for one in np.concatenate(status)]
    line, time = (np.concatenate([getattr(x, k) for x in parts]) for k in ("line", "time"))
    numbers = np.column_stack([time, *(np.concatenate(x) for x in (value, deviation))])
    columns = zip(line.tolist(), numbers, words, strict=True)
    rows = [[at, *(f"{x:.6g}" for x in row), word] for at, row, word in columns]
    write_table(target, ["line", "time (s)", *header, "status"], rows)
    count = Counter(words)
    return {
        "contacts": judged(estimator, parts, names), "rmse": None, "rows": len(words),
        "flagged": len(words) - count["OK"], "statuses": {"status": dict(count)},
        "channels_at_fault": {}, "notes": [], "file": str(target),
    }  # fmt: skip
