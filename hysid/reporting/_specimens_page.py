"""`hysid report` on many specimens: one page that compares their fits, beside a report of each."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import identify
from hysteresis import InputError
from hysteresis._atomic_file import telling
from hysteresis._note import ProgressNote
from hysteresis._verdict import LEVELS, worst_of

from ..figures._format import name_of, quantity
from ._case import TARGET
from ._fit_page import Tell, render, write_report
from ._specimens import FEW, Specimen, common, kinds, mark_outliers, opened, places
from ._specimens_sections import fits, loops, parameters, pooled

NAMED = 8
"""Specimens that are named in the verdict, at most."""

Say = Callable[[str], None]


def report(
    folders: Sequence[Path],
    out: Path | None = None,
    say: Say = lambda _: None,
    tell: Tell = lambda done, total, text: None,
) -> dict[str, Any]:
    """Write the report of one fit; of several, one each where it is missing or old, and the page on all.

    The page is report.html in the folder of folders, or specimens.html in the folder that holds several
    `folders`, or in `out`. Raises `InputError` where a folder holds no fit, or none can be read.
    """
    found = places(folders)
    single = len(folders) == 1 and (folders[0] / "fit.json").is_file()
    if single and out is None and list(found.values()) == [folders[0]]:
        return {"file": str(write_report(folders[0], tell=tell))}
    for k, (name, place) in enumerate(found.items(), 1):
        if _fresh(place):
            continue
        said = f"report {k} of {len(found)}: {name}"
        say(ProgressNote("report", said, k - 1, len(found)))
        try:
            write_report(place)
        except InputError as error:
            say(str(error))  # the page names it too, if it cannot be read at all
    if out is None and len(folders) == 1:
        return write_many(found, folders[0] / TARGET, _not_fitted(folders[0]))
    above = common(list(found.values())) if out is None else out
    with telling(above, "Name another folder."):
        above.mkdir(parents=True, exist_ok=True)
    return write_many(found, above / "specimens.html", {})


def write_many(
    found: dict[str, Path], file: Path, not_fitted: dict[str, str] | None = None
) -> dict[str, Any]:
    """Write one page on the fits in the folders `found` {name: folder}; what `--json` prints.

    A fit that cannot be read is named on the page. Raises `InputError` where none can be.
    """
    if not found:
        raise InputError(
            "file-not-found",
            "There are no fits to compare.",
            place=str(file.parent),
            fix="Name a folder that holds folders of hysid fit --out DIR.",
        )
    specimens, failed = opened(found)
    failed = (not_fitted or {}) | failed
    groups = kinds(specimens)
    for group in groups:
        mark_outliers(group)
    levels = Counter(one.fit.verdict.level for one in specimens)
    worst = worst_of([*levels, *["CAUTION"] * bool(failed)])
    counts = [f"{levels[level]} {level}" for level in LEVELS if levels[level]]
    found_in = [pooled(group) for group in groups]
    sections = [fits(specimens, file.parent, failed)]
    for group, (population, said) in zip(groups, found_in, strict=True):
        name = f" of {group[0].fit.name}" if len(groups) > 1 else ""
        sections.append(loops(group, name))
        sections.append(parameters(group, name, population, said))
    seen: Counter[str] = Counter()
    for section in sections:  # headings lead to one place each
        seen[section.title] += 1
        section.title += f" {seen[section.title]}" * (seen[section.title] > 1)
    train = [one.fit.train for one in specimens]
    names = {(name_of(record, "output"), name_of(record, "input")) for record in train}
    of_what = " of {} from {}".format(*names.pop()) if len(names) == 1 else ""
    render(
        file,
        title=f"{len(specimens)} fits{of_what}",
        subtitle=_subtitle(specimens, failed),
        level=worst,
        headline=f"Of {len(specimens)} fits: {', '.join(counts)}.",
        reasons=_reasons(specimens),
        facts=_facts(specimens),
        model="Each specimen has its own model; its name links to its report.",
        command=None,
        sections=sections,
    )
    return {
        "file": str(file),
        "specimens": [_entry(one) for one in specimens],
        "population": [
            {"model": group[0].fit.name, "name": p.name, "unit": p.unit}
            | {k: getattr(p, k)._asdict() for k in ("mean", "spread", "new")}
            for group, (population, _) in zip(groups, found_in, strict=True)
            for p in (population.parameters if population else ())
        ],
        "outliers": {one.name: one.sentence for one in specimens if one.why},
        "failed": failed,
    }


def _reasons(specimens: Sequence[Specimen]) -> list[str]:
    said = [one.sentence for one in specimens if one.why]
    if len(said) > NAMED:
        return [
            *said[:NAMED],
            f"{len(said) - NAMED} more are outliers; the tables mark them with *.",
        ]
    if not said and len(specimens) >= FEW:
        return ["No specimen is an outlier."]
    return said


def _facts(specimens: Sequence[Specimen]) -> list[tuple[str, str]]:
    wrong = [one.judged[1]["nrmse_percent"] for one in specimens]
    word = "held-out" if all(one.judged[0] == "held-out" for one in specimens) else "judged"
    worst = specimens[int(np.argmax(wrong))]
    return [
        ("specimens", str(len(specimens))),
        (f"{word} error of the range, median", quantity(float(np.median(wrong)), "%")),
        (f"{word} error of the range, largest", f"{quantity(max(wrong), '%')}, {worst.name}"),
        ("outliers", str(sum(bool(one.why) for one in specimens))),
    ]


def _subtitle(specimens: Sequence[Specimen], failed: dict[str, str]) -> str:
    models = Counter(one.fit.name for one in specimens).most_common()
    said = ", ".join(f"{count} {name}" for name, count in models)
    sources = {one.document["data"]["source"] for one in specimens}
    said = f"{sources.pop() or 'arrays'}: {said}" if len(sources) == 1 else said
    return said + (f"; {len(failed)} without a fit" if failed else "")


def _fresh(folder: Path) -> bool:
    """Its report is there, and no older than anything else there."""
    file = folder / TARGET
    if not file.is_file():
        return False
    written = file.stat().st_mtime_ns
    return all(f.stat().st_mtime_ns <= written for f in folder.iterdir() if f.is_file())


def _not_fitted(folder: Path) -> dict[str, str]:
    """Records that a batch, or --each, could not fit."""
    found: dict[str, str] = {}
    for name in ("batch.json", "fit.json"):
        if (folder / name).is_file():
            try:
                failed = identify.internal.read_json(folder / name).get("failed")
            except InputError:
                failed = None
            found |= failed if isinstance(failed, dict) else {}
    return found


def _entry(one: Specimen) -> dict[str, Any]:
    file = one.folder / TARGET
    return {
        "name": one.name,
        "folder": str(one.folder),
        "report": str(file) if file.is_file() else None,
        "model": one.fit.name,
        "verdict": one.fit.verdict.level,
        "metrics": one.document["metrics"],
        "parameters": [
            {"name": name, **{k: getattr(f, k) for k in ("value", "status", "low", "high")}}
            for name, f in one.figures.items()
        ],
        "outlier": one.sentence if one.why else None,
    }  # fmt: skip
