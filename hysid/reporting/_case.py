"""What the sections of a report are made of, and the fit they are about."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

import identify
from compensate import Status, estimate
from compensate.guards._guarded import limited
from hysteresis import InputError, Record
from identify.internal import predict

from .._compensator import exported
from ..figures._base import live, png
from ..figures._format import label_of, name_of

TRIP = 4_000
"""Rows sent through a compensator, at most, twice. The slowest inverses take 0.35 ms a row."""


class Rows(NamedTuple):
    """Residuals of the rows of one or two records, in order.

    `word`: "training", "excluded" (from the fit), "held-out", or "" for rows that do not count.
    """

    input: Float[np.ndarray, " rows"]
    residual: Float[np.ndarray, " rows"]
    word: np.ndarray
    branch: np.ndarray
    starts: Int[np.ndarray, " sequences"]


class RoundTrip(NamedTuple):
    """Measured outputs sent backwards through the compensator.

    - `record`: the rows that were sent, the first of which is `first` of a long record.
    - `estimate`, `status` (rows,): of these rows, each sequence from the virgin state.
    - `counted` (rows,): those that count in an error: masked, with a finite estimate.
    - `rms`, `largest`: of estimate - input, in the input's unit.
    - `exactness`: max |model(compensator(y)) - y| / range over y from the model itself.
    """

    record: Record
    first: int
    estimate: Float[np.ndarray, " rows"]
    status: Int[np.ndarray, " rows"]
    counted: Bool[np.ndarray, " rows"]
    rms: float
    largest: float
    exactness: float


ROLES = ("input", "output", "time")
TARGET = "report.html"
"""The report of a fit, in its folder."""


class Picture(NamedTuple):
    """A figure on the page: base64 PNG, its size, words in its place, what to look for, and its curves, by
    which it is drawn again where scripts run."""

    data: str
    width: int
    height: int
    alt: str
    caption: str
    curves: dict[str, Any] | None


class Link(NamedTuple):
    """A cell that leads to another page."""

    text: str
    href: str


class Table(NamedTuple):
    """Rows of text under headers; `strong` is the row to stand out."""

    caption: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str | Link]]
    strong: int | None = None


@dataclass
class Section:
    """A heading and what is under it: text, tables, pictures, notes, then parts with headings
    of their own. Below a `folded` one nothing is seen until it is clicked."""

    title: str
    text: list[str] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    parts: list["Section"] = field(default_factory=list)
    folded: bool = False

    def draw(self, figure: Any, alt: str, caption: str) -> None:
        """Add a figure, the words in its place, and what to look for."""
        self.pictures.append(Picture(*png(figure), alt, caption, live(figure)))

    @property
    def id(self) -> str:
        return self.title.lower().replace(" ", "-").rstrip("?")


@dataclass
class Case:
    """A loaded fit with what several sections need, computed once: the names of its columns, the labels of
    their axes."""

    folder: Path
    document: dict[str, Any]
    fit: identify.FitResult
    posterior: identify.internal.Posterior | None

    def __post_init__(self) -> None:
        train = self.fit.train
        self.input, self.output, self.time = (name_of(train, role) for role in ROLES)
        self.input_label, self.output_label, self.time_label = (label_of(train, r) for r in ROLES)

    @property
    def units(self) -> tuple[str, str]:
        """Of the input and of the output."""
        return self.fit.train.input_unit, self.fit.train.output_unit

    @property
    def judged(self) -> tuple[str, Record]:
        """The held-out record where there is one, else the training one, and its rows in words."""
        fit = self.fit
        return ("training", fit.train) if fit.test is None else ("held-out", fit.test)

    @property
    def one_clock(self) -> bool:
        """A single sequence with a clock, held-out rows included: time can be the axis."""
        fit = self.fit
        several = len(fit.train.labels) > 1 or not (fit.test is None or self.same_rows)
        return fit.train.time is not None and not several

    @cached_property
    def same_rows(self) -> bool:
        """The held-out record is the training one with another mask."""
        train, test = self.fit.train, self.fit.test
        return test is not None and all(
            np.array_equal(getattr(train, k), getattr(test, k), equal_nan=True)
            for k in ("input", "output", "starts")
        )

    @cached_property
    def rows(self) -> Rows:
        """Residuals of the training rows and, where they are others, of the held-out ones."""
        train, test = self.fit.train, self.fit.test
        words = [np.where(train.mask, np.where(self.fit.used, "training", "excluded"), "")]
        records = [train]
        if test is not None and self.same_rows:
            words[0] = np.where(test.mask, "held-out", words[0])
        elif test is not None:
            words.append(np.where(test.mask, "held-out", ""))
            records.append(test)
        pairs = zip(records, self.predicted.values(), strict=False)
        residual = np.concatenate([predicted - one.output for one, predicted in pairs])
        word = np.where(np.isfinite(residual), np.concatenate(words), "")
        driven, branch = (
            np.concatenate([getattr(r, k) for r in records]) for k in ("input", "branch")
        )
        starts = [train.starts, *(one.starts + len(train) for one in records[1:])]
        return Rows(driven, residual, word, branch, np.concatenate(starts))

    @cached_property
    def predicted(self) -> dict[str, np.ndarray]:
        """The model's output on each record, all rows; both are as the model saw them.

        Where every training row counts, the residuals that the fit has saved tell it.
        """
        fit = self.fit
        known = fit.train.output + fit.residuals
        found = {"train": known if np.isfinite(known).all() else fit.predict(fit.train)}
        return found if fit.test is None else found | {"test": fit.predict(fit.test)}

    def outputs(self, record: Record) -> np.ndarray:
        """The model's output on a record as the model saw it, compiled for no length if it can be."""
        if (found := self.fit.detail.outputs(record)) is not None:
            return found
        return predict(self.fit.model, record)

    @cached_property
    def round_trip(self) -> RoundTrip | InputError:
        """The judged record and the model's own output sent backwards, or why there is no compensator."""
        if self.fit.channels is not None:
            said = f"{len(self.fit.channels.names)} inputs cannot be recovered from one output."
            return InputError("not-invertible", said)
        record, first = self.judged[1], 0
        span = float(np.ptp(record.output[record.mask])) or 1.0
        if len(record) > TRIP:
            # Rows before those that count make good an unknown first state.
            first = max(0, int(np.argmax(record.mask)) - TRIP // 2)
            record = record.take_rows(first, first + TRIP)
        try:
            compensator = exported(self.fit)
            found, own = estimate(compensator, record), self.outputs(record)
            within, _ = limited(compensator, np.zeros(0))
            again = estimate(within, replace(record, output=own)).value
        except InputError as error:
            return error
        back = self.outputs(replace(record, input=np.asarray(again)))
        value, status = np.asarray(found.value), np.asarray(found.status)
        counted = record.mask & np.isfinite(value) & (status != Status.INVALID)
        error = (value - record.input)[counted] if counted.any() else np.array([np.nan])
        rms, largest = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
        exactness = float(np.abs(back - own).max()) / span
        return RoundTrip(record, first, value, status, counted, rms, largest, exactness)
