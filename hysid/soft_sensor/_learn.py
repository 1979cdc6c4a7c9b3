"""What a soft sensor learns beside the force: what its channels are checked for, places, positions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from compensate import Quantity
from compensate.microchannel import Localizer
from compensate.microchannel._position import PositionEstimator, standardised
from compensate.microchannel._readout import Readout
from hysteresis import InputError, Record, read_csv
from hysteresis.records._table import Table, rows_read
from identify.training._gaussian_process import fit_kernel

from ..intake._selection import Selection

# Files of a soft sensor as sessions: streams of readings, and what was pressed meanwhile.

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
    rows = rows_read(table, record)
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


def fit_positions(
    readings: Any, places: Any, *, least: float = 0.0, seed: int = 0
) -> PositionEstimator:
    """Learn where a sensor of many channels is touched, from touches at known places.

    **Arguments:**

    - `readings`: (rows, channels), in any unit. Several rows per place, at different forces, help.
    - `places`: (rows, coordinates), for example x and y in mm; estimates have the same unit.
    - `least`: the sensor is not touched while every |reading| is below this, in the unit of the readings.
    - `seed`: of the search for the length scales.

    **Returns:** a `PositionEstimator`.

    **Raises:** `InputError` where all touches are at one place, and as `PositionEstimator` does.

    **Example:**

        >>> x = np.repeat(np.arange(6.0), 3)
        >>> noise = np.random.default_rng(0).normal(0.0, 0.05, (18, 3))
        >>> readings = np.column_stack([1 + x, 6 - x, 3 + 0 * x]) + noise
        >>> estimator = hysid.fit_positions(readings, x[:, None])
        >>> round(float(estimator.estimate([3.5, 3.5, 3.0]).point[0]), 1)
        2.5
    """
    places = np.asarray(places, float)
    if places.size and not np.ptp(places, axis=0).any():
        said = "All touches are at one place: there is nothing to tell apart."
        raise InputError("no-excitation", said, fix="Touch two places or more.")
    x = np.asarray(standardised(readings)[0])
    kernel = fit_kernel(x, places - places.mean(0), seed)
    return PositionEstimator(readings, places, kernel, least=least)


AT_REST = 0.02
"""Forces up to this part of the largest are none."""
FEW = 10
"""Rows at rest from which their median and scatter are taken."""
NOISES = 5.0
"""Readings within so many times the noise are no press."""
UNEQUAL = 5.0
"""How many times the rows of another place are too many."""
MOST_AT_A_PLACE, MOST_POSITIONS = 2000, 1500
"""Rows to learn from: of neighbouring ones more say little, and take the square or cube of their number."""
LEAST_EQUAL, TIMES_EQUAL = 5, 3
"""Equal readings in a row that are told stuck: so many, and so many times those seen when all was well."""
LONG = 10.0
"""Steps of the clock that are a gap."""


class Checks(NamedTuple):
    """The readout of a sensor; the noise of each channel; the step of its clock; what to mind."""

    readout: Readout
    noise: Float[np.ndarray, " channels"]
    step: float
    notes: tuple[str, ...]


def checks_of(
    parts: Sequence[Streams],
    channels: Sequence[Quantity],
    targets: Targets,
    *,
    noise: float | None = None,
    ends: tuple[float, float] | None = None,
) -> Checks:
    """What a channel's readings have to be like, from streams in which all was well.

    **Arguments:** `noise`: deviation of a reading; found from the streams unless given. `ends`: of the
    converter's range.

    Raises `InputError` for a channel that never moves, and a noise or range that is none.
    """
    readings = np.concatenate([part.readings for part in parts])
    rest = np.concatenate([_at_rest(part, targets) for part in parts])
    for channel, column in zip(channels, readings.T, strict=True):
        if np.ptp(column) == 0:
            raise InputError(
                "constant-input", f"{channel.name!r} reads {column[0]:g} in every row.",
                cause="A wire is not connected, or the column is the wrong one.",
                fix="Repair it, or leave out the channel (--input).",
            )  # fmt: skip
    if noise is not None and not 0 <= noise < np.inf:
        raise InputError(
            "bad-option", f"The noise cannot be {noise:g}.", fix="Give 0 or more (--noise)."
        )
    notes: list[str] = []
    zero, sign = np.zeros(len(channels)), np.ones(len(channels))
    if targets.place is not None or targets.position:
        if rest.sum() >= FEW:
            zero = np.median(readings[rest], axis=0)
        else:
            notes.append("no rows are at rest: readings are taken to be 0 there.")
        pressed = np.concatenate([part.counts for part in parts]) & ~rest
        if pressed.any():
            sign = np.where(np.median(readings[pressed], axis=0) < zero, -1.0, 1.0)
    known = noise is not None
    found = np.full(len(channels), noise) if known else _noise(parts, readings, rest)
    every = [(part, rows) for part in parts for rows in part.sequences()]
    step, gap, clocks = 0.0, np.inf, [(part.record.time, rows) for part, rows in every]
    steps = np.concatenate([[], *(np.diff(time[at]) for time, at in clocks if time is not None)])
    if steps.size:
        step = float(np.median(steps))
        even = np.mean(steps < LONG / 2 * step) > 0.99
        gap = LONG * step if even else 2.0 * float(steps.max())
        if (gaps := steps[steps > gap]).size:
            notes.append(
                f"{gaps.size} gaps of up to {gaps.max():.3g} in the streams: the memory is in doubt behind"
                " them; make what follows a sequence of its own (--group COL)."
            )
    runs = [_longest_run(part.readings[rows]) for part, rows in every]
    stuck = max(LEAST_EQUAL, TIMES_EQUAL * max(runs)) if step else 0
    for channel, column in zip(channels, readings.T, strict=True):
        notes += _clipped(channel, column, step > 0)
    low, high = ends or (-np.inf, np.inf)
    readout = Readout(
        len(channels), scale=sign, zero=zero, low=low, high=high, longest_gap=gap,
        stuck_after=stuck,
    )  # fmt: skip
    return Checks(readout, found, step, tuple(notes))


def learn_places(
    parts: Sequence[Streams], tests: Sequence[Streams], checks: Checks, names: Sequence[str] = (),
    method: str = "gaussian",
) -> tuple[Localizer, list[str]]:  # fmt: skip
    """A localizer of the rows that name a place, and what to mind.

    `names`: the places there are; those that occur unless given. `method`: of `Localizer.train`.

    Raises `InputError` as `Localizer.train` does.
    """
    rows = [part.counts & (part.place != "") for part in parts]
    x, place = _taught(parts, checks, rows, "place")
    pressed = (x > NOISES * checks.noise[None]).any(1)
    x, place = x[pressed], place[pressed]
    there = sorted(set(place.tolist()))
    held_out = {str(name) for part in tests for name in part.place[part.counts]} - {""}
    notes = [
        f"no row to learn from is at {name!r}: presses there will be taken for another place, or unknown."
        for name in dict.fromkeys([*names, *sorted(held_out)])
        if name not in there
    ]
    if names and (unnamed := [name for name in there if name not in names]):
        raise InputError(
            "unknown-place", f"{unnamed[0]!r} is not one of the places {', '.join(names)}.",
            fix="Name all of them (--places A,B), or select other rows (--where).",
        )  # fmt: skip
    if len(x) == 0:
        raise InputError(
            "no-excitation", "In no row that names a place does a reading exceed its noise.",
            cause="The channels are the wrong ones, or places are given where nothing is pressed.",
            fix="Check the columns, or give the noise (--noise).",
        )  # fmt: skip
    kept = np.concatenate([_some(np.flatnonzero(place == name), MOST_AT_A_PLACE) for name in there])
    names = [name for name in names if name in there] or there
    noise = np.maximum(checks.noise, 1e-9 * x.std(0))
    localizer = Localizer.train(x[kept], place[kept], names=names, noise=noise, method=method)
    counts = {name: int((place == name).sum()) for name in names}
    most = max(counts, key=counts.__getitem__)
    notes += [
        f"place {name!r} has {n} rows to learn from, {most!r} has {counts[most]}: how presses at {name!r}"
        " differ is known less well."
        for name, n in counts.items()
        if UNEQUAL * n < counts[most]
    ]
    low = np.flatnonzero((x < -NOISES * checks.noise[None]).mean(axis=0) > 0.05)
    if low.size:
        named = ", ".join(f"{c + 1}" for c in low)
        notes.append(
            f"channel {named} reads below its rest at some places and above at others: ratios of readings"
            " say little then; learn coordinates instead (--position COL)."
        )
    return localizer, [*notes, *(f"{words}." for words in localizer.doubts())]


def learn_positions(
    parts: Sequence[Streams], checks: Checks, seed: int
) -> tuple[PositionEstimator, list[str]]:
    """A position estimator of the rows whose coordinates are known, and what to mind.

    Raises `InputError` as `fit_positions` does.
    """
    rows = [part.counts & np.isfinite(part.position).all(1) for part in parts]
    x, y = _taught(parts, checks, rows, "position")
    least = NOISES * float(np.sqrt(np.sum(checks.noise**2)))
    pressed = np.flatnonzero(np.linalg.norm(x, axis=1) > least)
    kept = _some(pressed, MOST_POSITIONS)
    notes = []
    if len(kept) < len(pressed):
        notes.append(f"positions are learnt from {len(kept)} of {len(pressed)} rows, evenly drawn.")
    return fit_positions(x[kept], y[kept], least=least, seed=seed), notes


def _taught(
    parts: Sequence[Streams], checks: Checks, rows: Sequence[np.ndarray], name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Of some rows of every part the changes of the readings, and what was pressed."""
    zero, scale = np.asarray(checks.readout.zero), np.asarray(checks.readout.scale)
    each = [
        ((part.readings[at] - zero) / scale, getattr(part, name)[at])
        for part, at in zip(parts, rows, strict=True)
    ]
    x, y = (np.concatenate(column) for column in zip(*each, strict=True))
    return x, y


def _some(rows: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the rows, evenly."""
    return rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)]


def _at_rest(part: Streams, targets: Targets) -> np.ndarray:
    rest = part.counts.copy()
    if targets.place is not None:
        rest &= part.place == ""
    elif targets.force is None:
        rest &= ~np.isfinite(part.position).all(1)
    if targets.force is not None:
        rest &= part.force <= AT_REST * np.nanmax(part.force)
    return rest


def _noise(parts: Sequence[Streams], readings: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """From second differences, in which what moves smoothly drops out, where rows follow one another."""
    found, spread = readings[rest].std(0) if rest.sum() >= FEW else 0.0, readings.std(0)
    seconds = [
        np.diff(part.readings[rows], 2, axis=0)
        for part in parts
        for rows in part.sequences()
        if part.record.time is not None and rows.stop - rows.start > 2
    ]
    if not seconds:
        return np.broadcast_to(found, spread.shape).astype(float)
    # The median of |e| is 0.67 deviations, and a second difference has six variances.
    white = np.median(np.abs(np.concatenate(seconds)), axis=0) / 0.6745 / np.sqrt(6)
    return np.where(white < 0.1 * spread, white, found)


def _longest_run(readings: np.ndarray) -> int:
    """Equal readings in a row, of any channel."""
    ends = (np.flatnonzero([True, *(np.diff(column) != 0), True]) for column in readings.T)
    return max([1, *(int(np.diff(at).max()) for at in ends)])


def _clipped(channel: Quantity, column: np.ndarray, is_stream: bool) -> list[str]:
    at = float(column.max())
    share = float(np.mean(column == at))
    if not is_stream or at == float(np.median(column)) or share < max(0.01, 8 / len(column)):
        return []
    return [
        f"{share:.1%} of {channel.name!r} stands at its largest reading, {at:g}: clipped? Name the"
        " converter's range (--range LOW HIGH), so that it is told SATURATED, or measure with a wider one."
    ]
