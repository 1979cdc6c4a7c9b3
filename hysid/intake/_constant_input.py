"""Rows of creep and relaxation: a constant input, given or held, and runs at several temperatures."""

import re
from dataclasses import replace

import numpy as np

from hysteresis import InputError, Note
from hysteresis._quantities import conversion
from hysteresis.records._table import Table, rows_of, with_column
from hysteresis.records._units import named_unit
from identify.internal import MODULI, PARTS, RUNS

from ._options import SelectionOptions

CONSTANT = "constant input"
"""The name of the input of a step."""
NEAR = 0.02
"""Of the input's range: as near to its level it is held."""


def with_constant(table: Table, asked: SelectionOptions) -> Table:
    """The rows with the value `step` in the column `CONSTANT`; those with one time become one."""
    constant = np.full(len(table.line), asked.step)
    return _with_input(table, slice(None), CONSTANT, constant, asked)


def at_hold(table: Table, column: str, asked: SelectionOptions) -> Table:
    """The longest stretch of the rows in which a column stays near its median, and the way there.

    In the stretch the column has one value, its median, from where it comes as near to that as it stays.
    What comes after the stretch is left out, and so is the way before its last gap or step back of the
    clock.

    Raises `InputError` where the stretch is less than half of the rows.
    """
    u = table.number(column)
    known = u[np.isfinite(u)]
    level, span = (float(np.median(known)), np.ptp(known)) if known.size else (np.nan, 0.0)
    near = np.abs(u - level) <= NEAR * span
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    begins, ends = edges[::2], edges[1::2]
    rows = max(map(slice, begins, ends), key=lambda s: s.stop - s.start, default=slice(0, 0))
    count = rows.stop - rows.start
    if 2 * count < max(1, len(u)):
        raise InputError(
            "no-hold",
            f"{column!r} stays within {NEAR:.0%} of its range for {count} of {len(u)} rows,"
            " so it is not constant.",
            place=str(table.path),
            fix="Leave out --hold, or select the rows in which it is constant (--where COL=VALUE).",
        )
    level = float(np.median(u[rows]))
    away = np.abs(u[rows] - level)
    # As near as the rest stays: 4.5 times the median distance are three standard deviations of noise.
    first = rows.start + int(np.argmax(away <= max(4.5 * float(np.median(away)), 1e-9 * span)))
    t = np.arange(len(u), dtype=float) if asked.time is None else table.number(asked.time)
    there = np.isfinite(u) & np.isfinite(t) & np.isfinite(table.number(asked.output))
    good = there[:first] & (np.diff(t[: first + 1]) >= 0)
    begin = int(np.flatnonzero(np.append(True, ~good)).max())
    held = np.array(u)
    held[first : rows.stop] = level
    note = f"{column!r} is held at {level:.4g} from line {table.line[first]} on:"
    note += f" {rows.stop - first} rows. Time counts from there."
    table = replace(table, notes=(*table.notes, Note("held", note)))
    return _with_input(table, slice(begin, rows.stop), column, held, asked)


def _with_input(
    table: Table, rows: slice, name: str, values: np.ndarray, asked: SelectionOptions
) -> Table:
    """These rows with these values, one for each row of the table, in the column `name`.

    Long tests are logged with clocks of few digits: outputs of rows with the same time are averaged.
    """
    few = rows_of(replace(table, units={CONSTANT: "1", **table.units}), rows)
    few = with_column(few, name, values[rows])
    if asked.time is None or not len(few.line):
        return few
    y = few.number(asked.output)
    first = np.flatnonzero(np.diff(few.number(asked.time), prepend=np.nan) != 0)
    if len(first) == len(y):
        return few
    said = Note("averaged", f"Averaged {len(y)} rows to {len(first)} of different times.")
    mean = np.add.reduceat(y, first) / np.diff(np.append(first, len(y)))
    few = rows_of(replace(few, notes=(*few.notes, said)), first)
    return replace(few, columns={**few.columns, asked.output: mean})


RUN = "run"
"""The column that tells runs apart."""
RATIO = re.compile(r"tan", re.IGNORECASE)
"""Names of a loss that is a part of the storage modulus: tan delta."""


def with_moduli(table: Table, frequency: str, asked: SelectionOptions) -> Table:
    """The rows with their storage moduli, and again with their loss moduli, as sequences.

    A loss without a unit beside a storage modulus that has one is tan delta, a part of it. Rows without a
    frequency above 0 or without a modulus are left out, and counted in the note; noise may turn the sign of
    a small loss. Raises `InputError` `wrong-unit`.
    """
    storage, loss = asked.output, asked.loss
    f, values = table.number(frequency), [table.number(storage)]
    if loss is not None:
        own, of = (named_unit(name, None, table.units.get(name)) or "1" for name in (loss, storage))
        factor = conversion(own, of)
        if factor is None and own != "1":
            raise InputError(
                "wrong-unit",
                f"a loss modulus in {own} beside a storage modulus in {of}.",
                place=str(table.path),
                fix="give both in units of stress, or tan delta without a unit.",
            )
        is_ratio = factor is None or (own == of == "1" and bool(RATIO.search(loss)))
        values.append(table.number(loss) * (values[0] if is_ratio else factor))
    run, parts = _runs(table, f, asked), []
    for part, y in zip(PARTS, values, strict=False):
        there = y > 0 if part == PARTS[0] else y != 0
        at = np.flatnonzero(np.isfinite(y) & there & (f > 0))
        parts.append((at, y[at], [f"{part} {k}".strip() for k in run[at]]))
    at, y, names = (np.concatenate([part[k] for part in parts]) for k in range(3))
    if not len(at):
        raise InputError("no-rows", "No row has a frequency and a modulus.", place=str(table.path))
    beside = "" if loss is None else f" and the loss of {loss!r}"
    said = f"The storage of {storage!r}{beside} over {frequency!r}: {len(at)} moduli"
    left = len(f) * len(values) - len(at)
    note = Note(MODULI, f"{said}; cells without one: {left}, left out." if left else f"{said}.")
    long = replace(rows_of(table, at), notes=(*table.notes, note))
    long = replace(long, columns={**long.columns, storage: y})
    return with_column(long, RUN, np.array(names))


def with_runs(table: Table, asked: SelectionOptions) -> Table:
    """The rows of every run in the order of its times, with the value `step` in the column `CONSTANT`."""
    time = asked.time
    if time is None:
        raise InputError(
            "no-time",
            "runs at several temperatures are shifted in time, and no time was named.",
            place=str(table.path),
            fix="name the time column (--time COL).",
        )
    t = table.number(time)
    run = _runs(table, t, asked)
    order = np.lexsort((t, np.unique(run, return_inverse=True)[1]))
    order = order[t[order] > 0]
    few = rows_of(table, order)
    said = f"{len(np.unique(run))} runs, of which each has one temperature."
    few = replace(few, notes=(*few.notes, Note(RUNS, said)))
    few = with_column(few, CONSTANT, np.full(len(order), asked.step), "1")
    return with_column(few, RUN, run[order])


def _runs(table: Table, x: np.ndarray, asked: SelectionOptions) -> np.ndarray:
    """The run that each row belongs to, "" where they are one.

    Runs have one value each of the groups. Of temperatures, which differ from row to row, another
    run begins where `x` turns back; where it never does, rows within a kelvin are one.
    """
    if asked.group or not asked.condition:
        words = [table.text[name] for name in asked.group] or [np.full(len(x), "")]
        return np.array(["|".join(row) for row in zip(*words, strict=True)])
    good = np.isfinite(x)  # other rows are left out later
    back = np.zeros(len(x), int)
    back[good] = np.cumsum(np.append(0, turns_back(x[good])))[: good.sum()]
    return (back if back.any() else np.round(table.number(asked.condition[0]))).astype(str)


def turns_back(x: np.ndarray) -> np.ndarray:
    """Of each step of a series whether it is against the usual way, (n - 1,)."""
    steps = np.diff(x)
    way = np.sign(np.median(np.sign(steps[steps != 0]))) if np.any(steps) else 1.0
    return steps * way < 0
