"""`hysid report` on many specimens: one page that compares their fits, beside a report of each."""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

import identify
from hysteresis import InputError
from hysteresis._files import telling
from hysteresis._verdict import LEVELS, ProgressNote, worst_of
from identify.comparison._pooling import Interval, Pooled
from identify.results._detail import DiscreteSpectrum

from ..figures import _base as f
from ..figures._format import label_of, name_of, number, pretty, quantity
from ..figures._survey import Spread, spreads
from ..figures._survey import loops as small_loops
from ._case import TARGET, Link, Section, Table
from ._report import Tell, render, write_report
from ._specimens import FAR, FEW, Figure90, Specimen, common, kinds, mark_outliers, opened, places

NAMED = 8
"""Specimens that are named in the verdict, at most."""

COLUMNS = 4
"""Parameters beside each other in a table."""

CHARTS = 12
"""Parameters that are drawn, at most."""

POINTS = 160
"""Points of a small curve, at most."""

POPULATION = (
    "Parameter",
    "Unit",
    "Mean",
    "Standard deviation between specimens",
    "New specimen, 90 %",
)

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


def fits(specimens: Sequence[Specimen], home: Path, failed: dict[str, str]) -> Section:
    rows = []
    for one in specimens:
        word, figures = one.judged
        unit = one.fit.train.output_unit
        rows.append((
            _link(one, home), one.fit.verdict.level, one.fit.name, word,
            quantity(figures["nrmse_percent"], "%") + " *" * ("error" in one.why),
            quantity(figures["rmse"], unit), quantity(figures["max_abs"], unit),
            f"{one.document['data']['rows_train']:,}",
        ))  # fmt: skip
    columns = ("Specimen", "Verdict", "Model", "Judged on", "Error of the range", "rms error",
               "Largest error", "Training rows")  # fmt: skip
    caption = "Errors refer to the held-out rows, or to the training rows if nothing was held out."
    section = Section("Fits", tables=[Table(caption, columns, rows)])
    if any("error" in one.why for one in specimens):
        section.notes.append("* Outlier among the specimens.")
    section.notes += [f"{name} is not in the table: {why}" for name, why in failed.items()]
    return section


def loops(group: Sequence[Specimen], name: str) -> Section:
    """Small charts of one kind of fit on one scale: the judged rows and the model."""
    drawn = []
    for one in group:
        record = one.fit.train if one.fit.test is None else one.fit.test
        x = record.time if _over_time(one) and record.time is not None else record.input
        keep, starts = record.mask, record.starts
        both = [
            f.trace(x, y, keep, starts, POINTS) for y in (record.output, one.fit.predict(record))
        ]
        drawn.append((one.name, *both))
    x_role = "time" if _over_time(group[0]) else "input"
    across, up = (label_of(group[0].fit.train, role) for role in (x_role, "output"))
    section = Section(f"Loops{name}")
    word = group[0].judged[0]
    caption = f"{up} over {across}, all on one scale. Broad: measured {word} rows. Thin: model."
    section.draw(
        small_loops(drawn, across, up), "Loops of the specimens, and their models", caption
    )
    return section


def parameters(
    group: Sequence[Specimen], name: str, population: Pooled | None, said: list[str]
) -> Section:
    names = list(dict.fromkeys(n for one in group for n in one.figures))
    units = {p.name: p.unit for one in group for p in one.fit.parameters}
    known = {p.name: p for p in (population.parameters if population else ())}
    section = Section(f"Parameters{name}", [
        "Values with their 90 % intervals, from the posterior if the fit was sampled, otherwise from the"
        " likelihood."
    ])  # fmt: skip
    if known:
        caption = f"Population of the {len(group)} specimens, outliers included."
        rows = [
            (p.name, pretty(p.unit) or "1", _interval(p.mean), _interval(p.spread),
             f"{number(p.new.low)} to {number(p.new.high)}")
            for p in known.values()
        ]  # fmt: skip
        section.tables.append(Table(caption, POPULATION, rows))
    for k in range(0, len(names), COLUMNS):
        part = names[k : k + COLUMNS]
        rows = [(one.name, *(_cell(one, n) for n in part)) for one in group]
        columns = ("Specimen", *(f"{n} ({pretty(units[n]) or '1'})" for n in part))
        section.tables.append(Table("" if k == 0 else "Further parameters.", columns, rows))
    free = [n for n in names if any(np.isfinite(f.low) for f in _of(group, n))][:CHARTS]
    if free and len(group) > 1:
        spread = []
        for n in free:
            value, low, high = np.array([f[:3] for f in _of(group, n)]).T
            new = (known[n].new.low, known[n].new.high) if n in known else None
            out = [n in one.why for one in group]
            spread.append(Spread(n, units[n], value, low, high, out, new))
        caption = "Each parameter over the specimens, in the order of the table."
        if known:
            caption += " The pale band contains 90 % of new specimens."
        section.draw(spreads(spread), "Parameters with intervals over the specimens", caption)
    if any(set(one.why) - {"error"} for one in group):
        section.notes.append(
            f"* Outlier: more than {FAR:g} robust deviations from the median of the specimens."
        )
    if len(group) < FEW:
        section.notes.append(f"Fewer than {FEW} specimens are too few to find outliers.")
    section.notes += said
    return section


def pooled(group: Sequence[Specimen]) -> tuple[Pooled | None, list[str]]:
    """What the specimens have in common, and what is to be said about what they have not."""
    if len(group) < 2:
        return None, ["The scatter between specimens needs at least two specimens."]
    try:
        found = identify.pool(
            [one.fit for one in group], posteriors=[one.posterior for one in group], draws=1600
        )
    except (InputError, np.linalg.LinAlgError) as error:
        why = error.problem if isinstance(error, InputError) else str(error)
        return None, [f"The population has no mean: {why}"]
    left = ", ".join(f"{name} ({why})" for name, why in found.left_out.items())
    return found, [f"Parameters without a population mean: {left}."] if left else []


def _of(group: Sequence[Specimen], name: str) -> list[Figure90]:
    nothing = Figure90(np.nan, np.nan, np.nan, np.nan, "none")
    return [one.figures.get(name, nothing) for one in group]


def _cell(one: Specimen, name: str) -> str:
    if (found := one.figures.get(name)) is None:
        return "none"
    text = number(found.value, found.error)
    if np.isfinite(found.low):
        text += f" ({_ends(found.low, found.high)})"
    elif found.status != "free":
        text += f", {found.status}"
    return text + " *" * (name in one.why)


def _interval(found: Interval) -> str:
    error = (found.high - found.low) / 4
    return f"{number(found.value, error)} ({_ends(found.low, found.high)})"


def _ends(low: float, high: float) -> str:
    error = (high - low) / 4
    return f"{number(low, error)} to {number(high, error)}"


def _over_time(one: Specimen) -> bool:
    """A step's input is constant."""
    return isinstance(one.fit.detail, DiscreteSpectrum)


def _link(one: Specimen, home: Path) -> str | Link:
    file = one.folder / TARGET
    if not file.is_file():
        return one.name
    href = Path(os.path.relpath(file.resolve(), home.resolve())).as_posix()
    return Link(one.name, quote(href))
