"""Records of a soft sensor under known forces: checked, set one behind the other, and cut into parts."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import InputError, Record

LEAST_ROWS, LEAST_PRESSES = 100, 3


class ForceRecord(NamedTuple):
    """One sequence of a sensor under a known force, from rest.

    `time` in s (samples,); `reading` (samples,) or (samples, channels), in any unit; `force` in N
    (samples,), NaN where it was not read and the records are taken with `nan="omit"`.
    """

    time: Float[np.ndarray, " samples"]
    reading: Float[np.ndarray, "samples *channels"]
    force: Float[np.ndarray, " samples"]


class ForceData(NamedTuple):
    """All records one behind the other.

    - `time`, `force` (rows,), `reading` (rows,) or (rows, channels). `starts`: first row of each record.
    - `known`: rows with a force. `rests`: rows between two presses of a record where the force is least,
      and all `starts`: a run might begin at any of them. `presses`: how often the force rises, in all.
    """

    time: Float[np.ndarray, " rows"]
    reading: Float[np.ndarray, "rows *channels"]
    force: Float[np.ndarray, " rows"]
    starts: tuple[int, ...]
    known: Bool[np.ndarray, " rows"]
    rests: tuple[int, ...]
    presses: int

    @property
    def channels(self) -> int:
        return 1 if self.reading.ndim == 1 else self.reading.shape[1]

    @property
    def span(self) -> float:
        """Largest less smallest force."""
        return float(np.ptp(self.force[self.known]))

    def sequences(self) -> list[slice]:
        """The rows of each record."""
        return _slices(self.starts, len(self.time))


def gather(records: Sequence[Any], nan: str = "raise") -> ForceData:
    """The records as one, checked.

    Raises `InputError` as `Record.from_arrays` does; for records of unlike channels, readings that do not
    move, forces that pull or do not move; less than 100 rows with a force, or 3 presses.
    """
    if not len(records):
        raise InputError("no-rows", "There are no records to learn from.")
    checked = [_checked(k, t, y, F, nan) for k, (t, y, F) in enumerate(records)]
    counts = {record.reading.shape[1:] for record in checked}
    if len(counts) > 1:
        shapes = ", ".join(str(shape[0] if shape else 1) for shape in sorted(counts))
        said, fix = f"The records have {shapes} channels.", "Give every record the same columns."
        raise InputError("wrong-channels", said, fix=fix)
    time, reading, force = (np.concatenate(part) for part in zip(*checked, strict=True))
    lengths = [len(record.time) for record in checked]
    starts = tuple(int(k) for k in np.cumsum([0, *lengths])[:-1])
    known = np.isfinite(force)
    if known.sum() < LEAST_ROWS:
        raise InputError(
            "too-few-rows",
            f"{int(known.sum())} rows have a force, but at least {LEAST_ROWS} are needed.",
            cause="The record is short, or the force was hardly ever read.",
            fix="Record more presses.",
        )
    _check_moves(reading, force[known])
    sequences = _slices(starts, len(time))
    low, span = force[known].min(), np.ptp(force[known])
    found = [_presses(force[rows], low, span) for rows in sequences]
    presses = max(len(checked), sum(rises for rises, _ in found))
    if presses < LEAST_PRESSES:
        raise InputError(
            "too-few-presses",
            f"{len(checked)} sequence{'s' * (len(checked) > 1)} with {presses} presses: "
            "no part of it can be held out to judge on.",
            cause="The record is a single loading or a single hold.",
            fix=f"Give at least {LEAST_PRESSES} presses, in one record or several.",
        )
    pairs = zip(starts, found, strict=True)
    rests = tuple(sorted({*starts, *(first + at for first, (_, own) in pairs for at in own)}))
    return ForceData(time, reading, force, starts, known, rests, presses)


def held_out_parts(
    data: ForceData,
    parts: int,
    skip: float = 0.0,
    seed: int = 0,
    groups: Sequence[Any] | None = None,
) -> Int[np.ndarray, " rows"]:
    """For every row the part, 0 to parts - 1, it is held out with: never single rows.

    Whole `groups` of records where they are given; else whole records, drawn by `seed`, where there are at
    least two for each part; else whole presses, one after the other; else as many stretches of every
    record. The first part `skip` of records is -1.

    Raises `InputError` for groups that are not one for each record, or less than two.
    """
    part, whole = np.full(len(data.time), -1), []
    sequences, presses = data.sequences(), _slices(data.rests, len(data.time))
    firsts = [rows.start + int(skip * (rows.stop - rows.start)) for rows in sequences]
    if groups is not None:
        names = list(dict.fromkeys(groups))
        if len(groups) != len(sequences) or len(names) < 2:
            raise InputError(
                "length-mismatch",
                f"{len(groups)} groups, {len(names)} of them different, for {len(sequences)} records.",
                fix="Give one group for each record, and at least two different ones.",
            )
        whole = [names.index(group) % parts for group in groups]
    elif len(sequences) >= 2 * parts:
        whole = np.random.default_rng(seed).permutation(np.arange(len(sequences)) % parts)
    elif (kept := [rows for rows in presses if _is_kept(rows, sequences, skip)])[parts - 1 :]:
        for k, rows in enumerate(kept):
            part[rows] = k * parts // len(kept)
    else:
        for rows, first in zip(sequences, firsts, strict=True):
            count = rows.stop - first
            part[first : rows.stop] = np.arange(count) * parts // count
    for k, rows in zip(whole, sequences, strict=False):
        part[rows] = k
    for rows, first in zip(sequences, firsts, strict=True):
        part[rows.start : first] = -1
    return part


def _is_kept(press: slice, sequences: Sequence[slice], skip: float) -> bool:
    """Whether most of a press comes after what is skipped of its record."""
    record = next(rows for rows in sequences if rows.start <= press.start < rows.stop)
    return press.start + press.stop >= 2 * (record.start + skip * (record.stop - record.start))


def _slices(starts: Sequence[int], rows: int) -> list[slice]:
    return [slice(*pair) for pair in pairwise((*starts, rows))]


def _checked(k: int, time: Any, reading: Any, force: Any, nan: Any) -> ForceRecord:
    """Each channel as a `Record` checks it, and fills it where that is asked for."""
    t, channels = np.asarray(time, float), np.atleast_2d(np.asarray(reading, float).T)
    names = {"output_name": "force", "nan": nan}
    try:
        made = [
            Record.from_arrays(x, force, t, input_name=f"channel {c}", **names)
            for c, x in enumerate(channels)
        ]
    except InputError as error:
        place, words = f"record {k}", {"cause": error.cause, "fix": error.fix}
        raise InputError(error.code, error.problem, place=place, **words) from error
    first, columns = made[0], [one.input for one in made]
    assert first.time is not None
    y = np.column_stack(columns) if len(columns) > 1 else columns[0]
    return ForceRecord(first.time, y, first.output)


def _check_moves(reading: np.ndarray, force: np.ndarray) -> None:
    spread = np.ptp(reading.reshape(len(reading), -1), axis=0)
    if (still := np.flatnonzero(spread == 0)).size:
        named = ", ".join(map(str, still.tolist()))
        raise InputError(
            "constant-input",
            f"The reading of channel {named} (from 0) never changes.",
            cause="A wire is not connected, or the column is the wrong one.",
            fix="Leave out that channel.",
        )
    if force.max() <= 0 or np.ptp(force) == 0 or force.min() < -0.2 * force.max():
        raise InputError(
            "no-excitation",
            f"All forces are between {force.min():g} and {force.max():g} N.",
            cause="Compression counts as negative, the load cell was not zeroed, or nothing was pressed.",
            fix="Give forces that increase from about 0 when the sensor is pressed.",
        )


def _presses(force: np.ndarray, low: float, span: float) -> tuple[int, list[int]]:
    """How often the force goes from the lower part of its range to the upper; and the middle of where it is
    least, between every two presses."""
    side = np.where(force > low + 0.4 * span, 1, np.where(force < low + 0.2 * span, -1, 0))
    rows = np.flatnonzero(side)
    side = side[rows]
    rests = []
    for down, up in pairwise(np.flatnonzero(np.diff(side))):
        if side[down] > 0:
            between = force[rows[down + 1] : rows[up] + 1]
            least = np.flatnonzero(between <= np.nanmin(between) + 0.02 * span)
            rests.append(int(rows[down + 1] + least[len(least) // 2]))
    return int((np.diff(side) > 0).sum()), rests
