"""The report of a fit: one self-contained page, made anew from the files in the fit's folder."""

import math
import os
import shlex
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

import identify
from compensate import Status, invert
from hysteresis import Burgers, InputError, LinearSponge, Preisach, Record

from ._evidence import (
    RoundTrip,
    autocorrelation,
    by_part,
    excited_cells,
    predictive_band,
    round_trip,
)

TEMPLATE = "report.html.j2"
MEANINGS = {
    Status.OK: "exact",
    Status.EXTRAPOLATED: "beyond the trained inputs, continued",
    Status.SATURATED: "beyond the outputs the model can have, held at its end",
    Status.FLAT: "where the model is flat, nearest input held",
    Status.BELOW_THRESHOLD: "below the contact threshold",
    Status.INVALID: "not a number",
}
HEADLINES = {
    "PASS": "It can be used inside the range it was trained on.",
    "CAUTION": "It can be used with care: read the reasons.",
    "FAIL": "Do not use this model.",
}


class Picture(NamedTuple):
    """A figure on the page: base64 PNG, its size, words in its place, and what to look for."""

    data: str
    width: int
    height: int
    alt: str
    caption: str


class Link(NamedTuple):
    """A cell that leads to another page."""

    text: str
    href: str


class Table(NamedTuple):
    """Rows of text under headers; `strong` is the row to stand out."""

    caption: str
    columns: tuple[str, ...]
    rows: list[tuple[str | Link, ...]]
    strong: int | None = None


@dataclass
class Section:
    """A heading and what is under it, in this order."""

    title: str
    text: list[str] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def id(self) -> str:
        return self.title.lower().replace(" ", "-")


def write_report(folder: str | Path) -> Path:
    """Write `folder`/report.html about the fit, and the posterior if any, that the folder holds.

    Raises `InputError` where the folder holds no fit, or a damaged one, or cannot be written to.
    """
    folder = Path(folder)
    document = identify.read_document(folder)
    if "each" in document:
        raise InputError(
            "several-fits",
            "this folder holds several fits, one for each value of a column.",
            place=str(folder),
            fix=f"report on one of its folders: {', '.join(map(str, document['each']))}.",
        )
    try:
        case = Case(folder, document, identify.load(folder), identify.load_posterior(folder))
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise InputError(
            "damaged-file",
            f"the fit cannot be read: {type(error).__name__} {error}.",
            place=str(folder),
            cause="fit.json was edited, or written by another version.",
            fix="fit again.",
        ) from error
    sections = [make(case) for make in SECTIONS if make is not _density or case.grid is not None]
    data = document["data"]
    return _render(
        folder,
        title=f"{case.fit.name} model of {case.output} from {case.input}",
        subtitle=f"{data['source'] or 'arrays'}, {data['rows_train']:,} training and"
        f" {data['rows_test']:,} held-out rows",
        level=case.fit.verdict.level,
        headline=HEADLINES[case.fit.verdict.level],
        reasons=case.fit.verdict.reasons,
        facts=_facts(case),
        model=_in_words(case),
        command=_next(case),
        sections=sections,
    )


def write_overview(folder: str | Path, each: dict[str, str | Path]) -> Path:
    """Write `folder`/report.html: the fits in the folders `each` {value: folder}, with links.

    Raises `InputError` as `write_report`.
    """
    folder = Path(folder)
    if not each:
        raise InputError("no-fit", "there are no fits to sum up.", place=str(folder))
    found = {value: identify.read_document(inside) for value, inside in each.items()}
    try:
        table = _overview_table(folder, each, found)
        levels = Counter(d["verdict"]["level"] for d in found.values())
        worst = next(level for level in ("FAIL", "CAUTION", "PASS") if levels[level])
        data = next(iter(found.values()))["data"]
    except (KeyError, TypeError, StopIteration) as error:
        raise InputError(
            "damaged-file",
            f"a fit.json lacks {error}.",
            place=str(folder),
            fix="fit again.",
        ) from error
    counts = [f"{levels[level]} {level}" for level in ("PASS", "CAUTION", "FAIL") if levels[level]]
    return _render(
        folder,
        title=f"{len(found)} fits of {data['output']['name']} from {data['input']['name']}",
        subtitle=data["source"] or "arrays",
        level=worst,
        headline=f"Of {len(found)} fits: {', '.join(counts)}.",
        reasons=(),
        facts=(),
        model="Each value has a model of its own, and a report behind its name in the table.",
        command=None,
        sections=[Section("Fits", tables=[table])],
    )


def _overview_table(
    folder: Path, each: dict[str, str | Path], found: dict[str, dict[str, Any]]
) -> Table:
    rows = []
    for value, document in found.items():
        away = os.path.relpath(Path(each[value]) / "report.html", folder)
        judged = document["metrics"].get("test") or document["metrics"]["train"]
        unit = document["data"]["output"]["unit"]
        rows.append((
            Link(value, quote(Path(away).as_posix())),
            document["verdict"]["level"],
            document["model"],
            "held-out" if document["metrics"].get("test") else "training",
            quantity(judged["nrmse_percent"], "%"),
            quantity(judged["rmse"], unit),
            quantity(judged["max_abs"], unit),
            f"{document['data']['rows_train']:,}",
        ))  # fmt: skip
    columns = ("Value", "Verdict", "Model", "Judged on", "Error of the range", "rms error",
               "Largest error", "Training rows")  # fmt: skip
    return Table("The error is that of the held-out rows where there are any.", columns, rows)


@dataclass(frozen=True)
class Case:
    """A loaded fit with what several sections need, computed once."""

    folder: Path
    document: dict[str, Any]
    fit: identify.FitResult
    posterior: identify.Posterior | None

    @property
    def input(self) -> str:
        return _plain_name(self.fit.train.input_name, self.fit.train.input_unit)

    @property
    def output(self) -> str:
        return _plain_name(self.fit.train.output_name, self.fit.train.output_unit)

    @property
    def input_label(self) -> str:
        return _label(self.input, self.fit.train.input_unit)

    @property
    def output_label(self) -> str:
        return _label(self.output, self.fit.train.output_unit)

    @property
    def units(self) -> tuple[str, str]:
        """Of the input and the output, "" for none."""
        units = (self.fit.train.input_unit, self.fit.train.output_unit)
        return units[0].replace("1", "") if units[0] == "1" else units[0], (
            "" if units[1] == "1" else units[1]
        )

    @property
    def judged(self) -> tuple[str, Record]:
        """The held-out record where there is one, else the training one, and its rows in words."""
        fit = self.fit
        return ("training", fit.train) if fit.test is None else ("held-out", fit.test)

    @property
    def grid(self) -> Any:
        """The grid density of a Preisach model, None for other models."""
        return getattr(self.fit.model, "density", None)

    @cached_property
    def predicted(self) -> dict[str, np.ndarray]:
        """The model's output on each record, all rows."""
        records = {"train": self.fit.train, "test": self.fit.test}
        return {k: self.fit.predict(r) for k, r in records.items() if r is not None}

    @cached_property
    def round_trip(self) -> RoundTrip | InputError:
        """What the compensator makes of the judged record, or why there is none."""
        try:
            return round_trip(self.fit.model, invert(self.fit.model), self.judged[1])
        except InputError as error:
            return error
