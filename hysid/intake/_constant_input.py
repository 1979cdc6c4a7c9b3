"""Rows of creep and relaxation, whose input is a constant: given, or the level a column is held at."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hysteresis import InputError, Note, Table, parse_condition
from hysteresis.records._table import TextColumns, rows_of

CONSTANT = "constant input"
"""The name of the input of a step."""
NEAR = 0.02
"""Of the input's range: as near to its level it is held."""


def with_constant(
    table: Table,
    name: str,
    value: float,
    output: str,
    time: str | None,
    where: Mapping[str, list[str]],
) -> Table:
    """The chosen rows with this value in the column `name`; those with one time become one."""
    at = chosen(table, where)
    constant = np.full(len(table.line), value)
    return _with_input(table, at, name, constant, output, time)


def at_hold(
    table: Table, column: str, output: str, time: str | None, where: Mapping[str, list[str]]
) -> Table:
    """The longest stretch of the chosen rows in which a column stays near its median, and the way there.

    In the stretch the column has one value, its median, from where it comes as near to that as it stays.
    What comes after the stretch is left out, and so is the way before its last gap or step back of the
    clock.

    Raises `InputError` where the stretch is less than half of the rows.
    """
    at = chosen(table, where)
    u = table.number(column)[at]
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
    t = np.arange(len(u), dtype=float) if time is None else table.number(time)[at]
    there = np.isfinite(u) & np.isfinite(t) & np.isfinite(table.number(output)[at])
    good = there[:first] & (np.diff(t[: first + 1]) >= 0)
    begin = int(np.flatnonzero(np.append(True, ~good)).max())
    held = np.array(table.number(column))
    held[at[first : rows.stop]] = level
    kept = at[begin : rows.stop]
    note = f"{column!r} is held at {level:.4g} from line {table.line[at[first]]} on:"
    note += f" {rows.stop - first} rows. Time counts from there."
    table = replace(table, notes=(*table.notes, Note("held", note)))
    return _with_input(table, kept, column, held, output, time)


def _with_input(
    table: Table, at: np.ndarray, name: str, values: np.ndarray, output: str, time: str | None
) -> Table:
    """The rows `at` with these values, one for each row of the table, in the column `name`.

    Long tests are logged with clocks of few digits: outputs of rows with the same time are averaged.
    """
    columns, notes = dict(table.columns), table.notes
    if time is not None and len(at):
        t, y = table.number(time)[at], table.number(output)[at]
        first = np.flatnonzero(np.append(True, np.diff(t) != 0))
        if len(first) < len(at):
            said = f"Averaged {len(at)} rows to {len(first)} of different times."
            notes += (Note("averaged", said),)
            columns[output] = np.zeros(len(table.line))
            counts = np.diff(np.append(first, len(at)))
            columns[output][at[first]] = np.add.reduceat(y, first) / counts
            at = at[first]
    few = rows_of(replace(table, columns=columns, notes=notes), at)
    return with_column(few, name, values[at])


def with_column(table: Table, name: str, values: np.ndarray) -> Table:
    """The table with this column, of numbers or of words."""

    def text(asked: str) -> np.ndarray:
        return values.astype(str) if asked == name else table.text[asked]

    return replace(
        table,
        columns={**table.columns, name: values},
        text=TextColumns((*table.text, name), text),
        units={CONSTANT: "1", **table.units},
    )


def chosen(table: Table, where: Mapping[str, list[str]]) -> np.ndarray:
    """Which rows fulfil all conditions."""
    rows = np.ones(len(table.line), bool)
    for name, values in where.items():
        rows &= parse_condition(f"{name}={','.join(values)}")(table)
    return np.flatnonzero(rows)
