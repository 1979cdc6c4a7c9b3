"""`hysid fit`: records from a file, a fit of each, and its folder."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import identify
from hysteresis import InputError, Record
from hysteresis._escape import shell_word
from hysteresis._verdict import worst_of

from .._compensator import fitted_to_compensate, with_compensator
from ..intake._creep_fits import motion_options, shared_options, step_options
from ..intake._folders import check_writable, folder_names
from ..intake._own_config import check_there, folder_of
from ..intake._selection import Pair, Selection, all_of
from ._asked import Fit
from ._console import Done, candidate_lines, compensator_lines, log, verdict_lines


def together(documents: dict[str, dict[str, Any]], failed: dict[str, str]) -> dict[str, Any]:
    """One document for several fits: mean errors, the commonest model, the worst verdict."""
    each = list(documents.values())
    first = each[0]
    reasons = [
        said | {"text": f"{value}: {said['text']}"}
        for value, d in documents.items()
        for said in d["verdict"]["reasons"][:1]
    ]
    reasons += [
        {"code": "not-fitted", "text": f"{v}: not fitted. {why}"} for v, why in failed.items()
    ]
    levels = [*(d["verdict"]["level"] for d in each), *["CAUTION"] * bool(failed)]
    counts = ("rows", "rows_train", "rows_test", "sequences")
    return {
        "schema": first["schema"],
        "model": Counter(d["model"] for d in each).most_common(1)[0][0],
        **{name: _mean([d[name] for d in each]) for name in ("metrics", "score_percent")},
        **{k: not failed and all(d[k] for d in each) for k in ("success", "trusted")},
        "verdict": {"level": worst_of(levels), "reasons": reasons},
        "purpose": first["purpose"],
        "data": first["data"] | {k: sum(d["data"][k] for d in each) for k in counts},
        "seed": first["seed"],
        "seconds": sum(d["seconds"] for d in each),
        "versions": first["versions"],
        "failed": failed,
        "each": documents,
    }


def _mean(values: list[Any]) -> Any:
    """Of the numbers that are known, of objects entry by entry; None where there are none."""
    known = [v for v in values if v is not None]
    if known and isinstance(known[0], dict):
        return {key: _mean([one[key] for one in known]) for key in known[0]}
    return float(np.mean(known)) if known else None


def run(asked: Fit) -> Done:
    """Fit, write the folder, and say what the fit is worth."""
    out = asked.out or folder_of(asked.file)
    document = _written(asked, out)
    lines = verdict_lines(document)
    if "each" not in document:
        lines += candidate_lines(document) + compensator_lines(document)
    elif document["verdict"]["level"] != "PASS":
        lines.append(f"All reasons of each: hysid report {shell_word(str(out))}")
    return Done(document, [*lines, f"Results: {out}"])


def _written(asked: Fit, out: Path) -> dict[str, Any]:
    """Fit, and write the folder. With `each` every value gets a folder of its own below.

    New fits of several values replace the old ones at the end; where there are none, each is there as soon
    as it is made.
    """
    selection, options = Selection(**asked.selection), asked.of_identify
    check_there(asked.file)
    selection.check_columns()
    records, faults = selection.records(selection.read(asked.file))
    if asked.others:
        records = _of_files(asked, selection)
    folders = folder_names(records)
    for name in (".", *folders.values()):
        identify.internal.check_free(out / name, asked.overwrite)
    check_writable(out)
    found: dict[str, dict[str, Any]] = {}
    waiting: list[Callable[[], dict[str, Any]]] = []
    extra = {
        "selection": _as_read(selection, [train for train, _ in records.values()]).as_json(),
        "options": {k: v for k, v in options.items() if isinstance(v, str | int)},
    }
    if asked.share and not selection.is_step:
        pairs = records.values()
        known = shared_options(options) | {"tests": [test for _, test in pairs], "progress": log}
        shared = iter(identify.fit_shared([train for train, _ in pairs], **known))
        run = lambda *_, **__: next(shared)  # noqa: E731
    elif not selection.is_step:
        run = partial(fitted_to_compensate, **motion_options(options))
    else:
        if asked.purpose == "compensate":
            fix = "Leave out --purpose compensate, or fit a record whose input changes."
            said = "A constant input cannot be recovered from the output."
            raise InputError("not-invertible", said, fix=fix)
        run = partial(identify.fit_step, **step_options(options))
    at_the_end = "" not in records and asked.overwrite and (out / "fit.json").exists()
    for value, (train, test) in records.items():
        if value:
            log(f"{selection.each} = {value}" if selection.each else value)
        try:
            result = _judged(run(train, test=test, progress=log))
        except InputError as error:
            faults[value] = error
            continue
        found[value] = identify.internal.to_json(result)
        write = partial(
            identify.internal.write_fit, result, out / folders[value], found[value],
            overwrite=asked.overwrite, extra=extra,
        )  # fmt: skip
        if "" in records:
            return write()
        if at_the_end:
            waiting.append(write)
        else:
            write()
        if value:
            log(f"{result.verdict.level}: {result.name}. {result.verdict.reasons[0]}")
    if not found:
        raise all_of(faults)
    failed = {value: str(error) for value, error in faults.items()}
    document = together(found, failed) | extra | {"folders": {v: folders[v] for v in found}}
    for write in waiting:
        write()
    document = identify.internal.sealed(document)
    identify.internal.write_json(out / "fit.json", document)
    return document


def _of_files(asked: Fit, selection: Selection) -> dict[str, Pair]:
    """The records of several specimens' files, by the names of these."""
    files = [asked.file, *(asked.others or [])]
    names = [file.stem for file in files]
    if selection.each or not asked.share or len(set(names)) < len(names):
        raise InputError(
            "conflicting-options",
            f"{len(files)} files are specimens that share parameters (--share), each of its own name.",
            fix="Give --share NAME and no --each, or fit one file at a time.",
        )
    return {
        name: selection.records(selection.read(file))[0][""]
        for name, file in zip(names, files, strict=True)
    }


def _judged(fit: identify.FitResult) -> identify.FitResult:
    """With its compensator, or after Ctrl-C without: what was fitted is worth more than a clean end."""
    try:
        return fit if "interrupted" in fit.verdict.codes else with_compensator(fit)
    except KeyboardInterrupt:
        log("Interrupted: the compensator was not judged.")
        return fit


def _as_read(selection: Selection, records: list[Record]) -> Selection:
    """The selection with a condition that was given as an input: a new file may hold one value of it."""
    found = {(record.input_name, *record.conditions) for record in records}
    if len(found) > 1 or not isinstance(selection.input, tuple):
        return selection
    ((name, *conditions),) = found
    if not conditions or name not in selection.input:
        return selection
    return replace(selection, input=name, condition=tuple(conditions))
