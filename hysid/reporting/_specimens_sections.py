"""Report sections on many specimens: fits, loops, parameters and their population."""

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

import identify
from hysteresis import InputError
from identify.comparison._pooling import Interval, Pooled
from identify.results._detail import DiscreteSpectrum

from ..figures import _base as f
from ..figures._format import label_of, number, pretty, quantity
from ..figures._survey import Spread, spreads
from ..figures._survey import loops as small_loops
from ._case import TARGET, Link, Section, Table
from ._specimens import FAR, FEW, Figure90, Specimen

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
