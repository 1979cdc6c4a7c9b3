"""What the commands do, without the command line: each returns the object that --json prints."""

import csv
import os
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

import identify
from compensate import Status, invert
from hysteresis import InputError, Record, Table, check_identifiable
from hysteresis._verdict import worst_of
from hysteresis.rigs import SpongeRig

from ..intake._constant_input import (
    CONSTANT,
    RANGE,
    check_step,
    later,
    on_the_clock_of,
    open_range,
    step_options,
)
from ..intake._selection import Selection, all_of, folders_of

Say = Callable[[str], None]
DATASETS = Path(__file__).resolve().parents[2] / "datasets"
FLAGGED_BEYOND = "beyond the trained inputs"


def check(file: Path, selection: Selection) -> dict[str, Any]:
    """What is in a record, whether a model can be identified from it, and what to mind."""
    selection.check_columns()
    records, faults = selection.without_hold_out().records(selection.table(file))
    found: dict[str, Any] = {}
    for value, (record, _) in records.items():
        try:
            found[value] = check_step(record) if selection.is_step else _looked_at(record)
        except InputError as error:
            faults[value] = error
    if not found:
        raise all_of(faults)
    if "" in found:
        return found[""]
    return {"each": found, "failed": {value: str(error) for value, error in faults.items()}}


def _looked_at(record: Record) -> dict[str, Any]:
    warnings = check_identifiable(record)
    return {"text": record.describe(), "warnings": warnings, **record.summary()}


def fit(
    file: Path,
    selection: Selection,
    out: Path,
    *,
    overwrite: bool = False,
    say: Say = lambda _: None,
    **options: Any,
) -> dict[str, Any]:
    """Fit, and write the folder. With `each` every value gets a folder of its own below."""
    selection.check_columns()
    records, faults = selection.records(selection.table(file))
    folders = _folder_names(records)
    for name in (".", *folders.values()):
        identify.internal.check_free(out / name, overwrite)
    _check_writable(out)
    found: dict[str, identify.FitResult] = {}
    extra = {"selection": selection.as_json()}
    run = partial(identify.fit, **options)
    if selection.is_step:
        run = partial(identify.fit_step, **step_options(options))
    for value, (train, test) in records.items():
        if value:
            say(f"{selection.each} = {value}")
        try:
            result = run(train, test=test, progress=say)
        except InputError as error:
            faults[value] = error
            continue
        identify.save(result, out / folders[value], overwrite=overwrite, extra=extra)
        found[value] = result
        if value:
            say(_in_short(result))
    if not found:
        raise all_of(faults)
    if "" in found:
        return identify.internal.read_document(out)
    failed = {value: str(error) for value, error in faults.items()}
    document = _together(found, failed) | extra | {"folders": {v: folders[v] for v in found}}
    identify.internal.write_json(out / "fit.json", document)
    return identify.internal.read_document(out)


def predict(
    folder: Path, file: Path, *, inverse: bool = False, changes: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Run a fitted model, or its compensator, over a file; write the result beside the fit.

    Error figures are over every row of the file that has both readings. `flagged` counts rows beyond
    the trained inputs (of a step: times), or, for the compensator, estimates whose status is not OK.
    Beside a step's prediction stands the range that the fitted record leaves open.
    """
    document = identify.internal.read_document(folder)
    asked = _selection_of(document)
    if inverse and isinstance(asked.input, tuple):
        raise InputError(
            "not-invertible",
            f"this fit has {len(asked.input)} inputs, and one output does not tell them apart.",
            place=str(folder),
            fix="predict without --inverse, or fit to one input.",
        )
    selection = replace(asked, **(changes or {})).without_hold_out()
    source = selection.table(file)
    selection, compared, said = _for_new_file(selection, source, inverse)
    folders = folders_of(folder, document)
    table, measured_all, found_all, flagged = [], [], [], 0
    records, faults = selection.records(source)
    if faults := {value: error for value, error in faults.items() if value in folders}:
        raise all_of(faults)
    with_range = asked.is_step and not inverse
    for value, (record, _) in records.items():
        if value not in folders:
            continue
        fitted = identify.load(folder / folders[value])
        if asked.is_step:
            record = on_the_clock_of(fitted, record)
        wanted = record.input if inverse else record.output
        if inverse:
            values, status = _run_backwards(fitted, record)
            words = [Status(int(s)).name for s in status]
        else:
            values = fitted.predict(record)
            words = (later if asked.is_step else _outside)(fitted, record)
        flagged += sum(w != "OK" for w in words)
        driving = fitted.combined(record).input
        more = open_range(fitted, record) if with_range else np.empty((len(record), 0))
        rows = zip(
            [value] * len(record), record.line, driving, record.output, values, words, *more.T,
            strict=True,
        )  # fmt: skip
        table += [row for row in rows if row[1]]  # a step's own row has no line in the file
        measured_all.append(wanted[record.mask])
        found_all.append(np.asarray(values)[record.mask])
    if not table:
        raise InputError(
            "no-match",
            f"no value of {selection.each} in the file was fitted: {', '.join(folders)}.",
            place=str(file),
        )
    figures = identify.metrics(np.concatenate(measured_all), np.concatenate(found_all))._asdict()
    if not compared:
        figures = dict.fromkeys(figures)
    target = folder / f"{'inverse' if inverse else 'predicted'}-{file.stem}.csv"
    result = f"estimated {asked.input_words}" if inverse else f"predicted {asked.output}"
    names = [selection.input_words, selection.output]
    header = [selection.each or "", "line", *names, result, "status", *RANGE[: 3 * with_range]]
    keep = [selection.each is not None, True, True, compared, *(True,) * 5]
    with target.open("w", newline="", encoding="utf-8") as handle:
        csv.writer(handle).writerows(list(compress(row, keep)) for row in [header, *table])
    return {**figures, "flagged": flagged, "rows": len(table), "notes": said, "file": str(target)}


def sample(
    folder: Path,
    *,
    progress: Callable[[int, int, str], None] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Sample the posterior of a fit, or of each of several, and keep it beside; as `identify.sample`."""
    folders = folders_of(folder, identify.internal.read_document(folder))
    documents = {}
    for value, name in folders.items():
        place = folder / name

        def named(done: int, total: int, text: str, value: str = value) -> None:
            if progress is not None:
                progress(done, total, f"{value}, {text}" if value else text)

        posterior = identify.sample(
            identify.load(place), checkpoint=place / "chains.h5", progress=named, **options
        )
        identify.save_posterior(posterior, place)
        documents[value] = identify.internal.posterior_json(posterior)
    if "" in documents:
        return documents[""]
    parameters = [
        p | {"name": f"{value}: {p['name']}"}
        for value, d in documents.items()
        for p in d["parameters"]
    ]
    return {
        "parameters": parameters,
        "draws": sum(d["draws"] for d in documents.values()),
        "seconds": round(sum(d["seconds"] for d in documents.values()), 3),
        "converged": all(d["converged"] for d in documents.values()),
        "notes": [f"{value}: {note}" for value, d in documents.items() for note in d["notes"]],
        "each": documents,
    }


def demo(
    out: Path, say: Say, progress: Callable[[int, int, str], None] | None = None
) -> dict[str, Any]:
    """The whole road on the shipped sponge record: fit, posterior, compensator, report."""
    file = _demo_data(out)
    selection = Selection(
        input="force (N)", output="displacement (mm)", time="time (s)", test_cycles=1
    )
    if (out / "fit.json").exists():
        before = identify.internal.read_document(out).get("data", {}).get("source", "")
        identify.internal.check_free(out, overwrite=Path(before).name == file.name)
    say(f"fitting {file.name}: a sponge pressed five times from 0 to 20 N, the fifth held out")
    document = fit(file, selection, out, overwrite=True, say=say)
    say("sampling the posterior")
    sample(out, steps=1000, ensembles=4, seed=0, resume=False, progress=progress)
    say("running the compensator: displacement in, force out")
    backwards = predict(out, file, inverse=True)
    say("writing the report")
    from ..reporting._fit_page import write_report

    return document | {"inverse": backwards, "report": str(write_report(out))}


def _demo_data(out: Path, datasets: Path = DATASETS) -> Path:
    """The shipped record; where the package was installed without it, the rig makes it anew."""
    name = "sponge-50mm-cycles.csv"
    shipped = datasets / name
    if shipped.is_file():
        return shipped
    out.mkdir(parents=True, exist_ok=True)
    file = out / name
    rows = zip(*SpongeRig().five_cycles(noise=0.05, seed=50), strict=True)
    lines = [f"{t:.1f},{F:.3f},{round(float(d), 3) + 0.0:.3f},{n}\n" for t, F, d, n in rows]
    file.write_text("time (s),force (N),displacement (mm),cycle\n" + "".join(lines), newline="")
    return file


def _selection_of(document: dict[str, Any]) -> Selection:
    """The columns a fit was made from; a fit saved from Python knows their names alone."""
    try:
        if "selection" in document:
            return Selection.from_json(dict(document["selection"]))
        words = document["records"]["train"]
        time = words["time_name"] if words["time_unit"] != "1" else None
        channels = "channels" in document
        names = tuple(document["channels"]["names"]) if channels else words["input_name"]
        return Selection(names, words["output_name"], time)
    except (KeyError, TypeError) as error:
        raise InputError(
            "damaged-file",
            f"fit.json does not say which columns were fitted: {type(error).__name__} {error}.",
            cause="it was edited.",
            fix="fit again.",
        ) from error


def _for_new_file(
    selection: Selection, table: Table, inverse: bool
) -> tuple[Selection, bool, list[str]]:
    """The fit's selection on a file that may lack columns: (selection, comparable, what was said).

    Without the column that is predicted nothing is compared; conditions and groups of columns that
    are not there are let go. The driving column, the clock and `each` have to be there.
    """
    driving, wanted = selection.input or CONSTANT, selection.output
    if inverse:
        driving, wanted = wanted, driving
    first = driving[0] if isinstance(driving, tuple) else driving
    columns = table.columns
    where = tuple(c for c in selection.where if c.partition("=")[0].strip() in columns)
    group = tuple(column for column in selection.group if column in columns)
    said = [f"no column for {c!r}: every row is used." for c in selection.where if c not in where]
    if lost := [column for column in selection.group if column not in group]:
        said.append(f"no column {', '.join(lost)}: sequences are told apart without it.")
    selection = replace(selection, where=where, group=group)
    if selection.is_step:
        if inverse or wanted in columns or selection.time is None:
            return selection, True, said
        return replace(selection, output=selection.time, output_unit=None), False, said
    if wanted in columns or first not in columns:
        return selection, True, said
    alone = replace(selection, input=driving, output=first, input_unit=None, output_unit=None)
    return alone, False, said


def _outside(fitted: identify.FitResult, record: Record) -> list[str]:
    """What to say about each row of a record: is it beyond the inputs that were fitted?"""
    return [FLAGGED_BEYOND if o else "OK" for o in fitted.beyond(record)]


def _run_backwards(fitted: identify.FitResult, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """The compensator over each sequence, from the virgin state."""
    identify.internal.check_unit(record.output_name, record.output_unit, fitted.train.output_unit)
    compensator = invert(fitted.model)
    value, status = np.empty(len(record)), np.empty(len(record), int)
    for _, rows in record.sequences():
        t = None if record.time is None else record.time[rows]
        estimate = compensator.simulate(t, record.output[rows])
        value[rows], status[rows] = np.asarray(estimate.value), np.asarray(estimate.status)
    return fitted.clocks.undone(record, value), status


def _together(found: dict[str, identify.FitResult], failed: dict[str, str]) -> dict[str, Any]:
    """One document for several fits: mean figures, the commonest model, the gravest verdict."""
    documents = {value: identify.internal.to_json(result) for value, result in found.items()}
    each = list(documents.values())
    first, whole = each[0], _in_common(documents)
    model = Counter(d["model"] for d in each).most_common(1)[0][0]
    candidates = []
    for name in dict.fromkeys(c["model"] for d in each for c in d["candidates"]):
        tried = {value: c for value, d in documents.items() if (c := _candidate(d, name))}
        candidates.append(
            {"model": name, "parameters": _mean_parameters([*tried.values()]), **_in_common(tried)}
        )
    if failed:
        level = worst_of((whole["verdict"]["level"], "CAUTION"))
        reasons = [f"{v}: not fitted. {why}" for v, why in failed.items()]
        verdict = {"level": level, "reasons": whole["verdict"]["reasons"] + reasons}
        whole |= {"success": False, "trusted": False, "verdict": verdict}
    counts = ("rows", "rows_train", "rows_test", "sequences")
    return {
        "schema": first["schema"],
        "model": model,
        "parameters": _mean_parameters([d for d in each if d["model"] == model]),
        **whole,
        "candidates": candidates,
        "data": first["data"] | {k: sum(d["data"][k] for d in each) for k in counts},
        "seed": first["seed"],
        "seconds": sum(d["seconds"] for d in each),
        "versions": first["versions"],
        "failed": failed,
        "each": documents,
    }


def _in_common(documents: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Mean figures and gravest verdict of fits or of candidates."""
    each = list(documents.values())
    return {
        "metrics": _mean_metrics(each),
        "score_percent": _mean([d["score_percent"] for d in each]),
        "success": all(d["success"] for d in each),
        "trusted": all(d["trusted"] for d in each),
        "verdict": {
            "level": worst_of(d["verdict"]["level"] for d in each),
            "reasons": [f"{value}: {d['verdict']['reasons'][0]}" for value, d in documents.items()],
        },
    }


def _mean_parameters(documents: list[dict[str, Any]]) -> list[dict[str, Any]]:
    status = {"stderr": None, "status": f"mean of {len(documents)}"}
    names = {tuple(p["name"] for p in d["parameters"]) for d in documents}
    if len(names) > 1:  # branches with other relaxation times have no mean
        return []
    columns = zip(*(d["parameters"] for d in documents), strict=True)
    return [
        column[0] | {"value": _mean([p["value"] for p in column])} | status for column in columns
    ]


def _candidate(document: dict[str, Any], name: str) -> dict[str, Any] | None:
    return next((c for c in document["candidates"] if c["model"] == name), None)


def _mean(values: list[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None


def _mean_metrics(documents: list[dict[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for part in ("train", "test"):
        figures = [d["metrics"][part] for d in documents if d["metrics"][part] is not None]
        found[part] = {k: _mean([f[k] for f in figures]) for k in figures[0]} if figures else None
    return found


def _in_short(result: identify.FitResult) -> str:
    return f"{result.verdict.level}: {result.name}. {result.verdict.reasons[0]}"


def _folder_names(values: Iterable[str]) -> dict[str, str]:
    """A folder for each value: letters, digits and .-_ stay, so that no value leads out of `out`."""
    names: dict[str, str] = {}
    for value in values:
        name = "".join(c if c.isalnum() or c in "-_." else "_" for c in value)
        if value and not name.strip("."):
            name = f"_{name}"
        while name.casefold() in map(str.casefold, names.values()):
            name += "_"
        names[value] = name or "."
    return names


def _check_writable(out: Path) -> None:
    """Said before the fit rather than after it."""
    there = next(place for place in (out, *out.absolute().parents) if place.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        why = "you may not write there" if there.is_dir() else f"{there} is a file"
        raise InputError(
            "cannot-write", f"{why}.", place=str(out), fix="name another folder (--out)."
        )
