"""Files of a soft sensor as sessions: streams of readings, and what was pressed meanwhile."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from compensate import Quantity
from hysteresis import InputError, Record, read_csv
from hysteresis.records._table import Table

from ..intake._selection import Selection

NOWHERE = ("", "-", "none", "rest", "nan", "na", "n/a", "null")
"""Words for no place: nothing is pressed."""


@dataclass(frozen=True)
class Targets:
    """The columns that say what was pressed: force, place, coordinates; None or () for none."""

    force: str | None = None
    place: str | None = None
    position: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.force is None and self.place is None and not self.position:
            raise InputError(
                "nothing-to-learn", "There is nothing to learn.",
                fix="Name the columns of the true values: --force COL, --place COL, --position COL.",
            )  # fmt: skip


@dataclass(frozen=True)
class Streams:
    """Rows of one file that are learnt from, or tested on: those that `counts`; the others are history.

    `place` "" where nothing is pressed; `force` and `position` NaN where they are not known.
    """

    record: Record
    readings: Float[np.ndarray, "samples channels"]
    counts: Bool[np.ndarray, " samples"]
    force: Float[np.ndarray, " samples"]
    place: np.ndarray
    position: Float[np.ndarray, "samples coordinates"]

    def sequences(self) -> Iterator[slice]:
        """Rows of each stream, which begins with the sensor at rest."""
        for _, rows in self.record.sequences():
            yield rows


class Session(NamedTuple):
    """One file: what is learnt from, what is held out, and its columns' units."""

    file: Path
    rows: int
    sha256: str
    train: Streams | None
    test: Streams | None
    channels: tuple[Quantity, ...]
    force: Quantity | None
    position: tuple[Quantity, ...]


def read_sessions(
    files: Sequence[Path], selection: Selection, targets: Targets, tests: Sequence[Path] = ()
) -> list[Session]:
    """Files and, wholly held out, `tests`. Where several are given, a condition for rows to hold out may
    miss in some of them.

    Raises `InputError` as `read_csv` and `Record` do, for files of other units, and where a file is given
    twice.
    """
    named = [Path(file).resolve() for file in (*files, *tests)]
    selection.check_columns(targets.force, targets.place, *targets.position)
    if not targets.force:  # a record's output is its first channel
        selection = replace(selection, output=_first(selection), output_unit=None)
    if twice := [file.name for k, file in enumerate(named) if file in named[:k]]:
        fix = "Name the file of each session once."
        raise InputError("given-twice", f"{twice[0]} is given twice.", fix=fix)
    found, missed = [], []
    for file in files:
        try:
            found.append(_session(file, selection, targets))
        except InputError as error:
            if error.code != "no-match" or not selection.test_where or len(files) == 1:
                raise
            found.append(_session(file, selection.without_hold_out(), targets))
            missed.append(error)
    if missed and len(missed) == len(files):
        raise missed[0]
    for file in tests:
        one = _session(file, selection.without_hold_out(), targets)
        found.append(one._replace(train=None, test=one.train))
    first = found[0]
    for other in found[1:]:
        _check_alike(first, other)
    return found


def _session(file: Path, selection: Selection, targets: Targets) -> Session:
    table = selection.read(file)
    if targets.place is not None and targets.place not in table.columns:  # says what there are
        read_csv(table, input=_first(selection), output=targets.place)
    pairs, _ = selection.records(table)
    train, test = pairs[""]
    names = tuple(train.channels) or (train.input_name,)
    units = [*train.channels.values()] or [train.input_unit]
    force = None if targets.force is None else Quantity(train.output_name, train.output_unit)
    # `read_csv` says what is wrong with a column of coordinates, and knows its unit.
    alone = [
        read_csv(table, input=_first(selection), output=name, nan="omit")
        for name in targets.position
    ]
    units_of = zip(targets.position, alone, strict=True)
    position = tuple(Quantity(name, record.output_unit) for name, record in units_of)
    coordinates = np.array([table.number(name) for name in targets.position])
    coordinates = coordinates.reshape(len(position), len(table.line)).T
    return Session(
        Path(file), len(table.line), table.sha256,
        _streams(train, table, targets, coordinates),
        None if test is None else _streams(test, table, targets, coordinates),
        tuple(Quantity(*of) for of in zip(names, units, strict=True)), force, position,
    )  # fmt: skip


def _first(selection: Selection) -> str:
    return selection.input[0] if isinstance(selection.input, tuple) else str(selection.input)


def _streams(record: Record, table: Table, targets: Targets, coordinates: np.ndarray) -> Streams:
    rows = np.searchsorted(table.line, record.line)
    channels = [record.columns[name] for name in record.channels] or [record.input]
    force = record.output if targets.force is not None else np.full(len(record), np.nan)
    columns = np.column_stack(channels), np.array(record.mask), force
    return Streams(record, *columns, places_of(table, targets.place, rows), coordinates[rows])


def places_of(table: Table, name: str | None, rows: np.ndarray) -> np.ndarray:
    """The places that rows name, "" where nothing is pressed, or nothing names them."""
    if name not in table.columns:
        return np.full(len(rows), "")
    place = table.text[str(name)][rows]
    return np.where(np.isin(np.char.lower(place), NOWHERE), "", place)


def _check_alike(first: Session, other: Session) -> None:
    for one, two in zip(
        (*first.channels, *first.position, *filter(None, [first.force])),
        (*other.channels, *other.position, *filter(None, [other.force])),
        strict=True,
    ):
        if one.unit != two.unit:
            raise InputError(
                "wrong-unit",
                f"Column {one.name!r} is in {two.unit} here, but in {one.unit} in {first.file.name}.",
                place=str(other.file), fix="Convert both to one unit.",
            )  # fmt: skip
