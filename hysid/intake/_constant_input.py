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
    """The chosen rows with this value in the column `name`; those with one time become one.

    A constant input has no history to lose, and long tests are logged with clocks of few digits: the
    output of rows in a row with the same time is averaged.
    """
    at, columns, notes = _chosen(table, where), dict(table.columns), table.notes
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
    constant = np.full(len(at), value)

    def text(asked: str) -> np.ndarray:
        return constant.astype(str) if asked == name else few.text[asked]

    return replace(
        few,
        columns={**few.columns, name: constant},
        text=TextColumns((*few.text, name), text),
        units={CONSTANT: "1", **few.units},
    )


def at_hold(
    table: Table, column: str, time: str | None, where: Mapping[str, list[str]]
) -> tuple[Table, float]:
    """The longest stretch of the chosen rows in which a column stays near its median, and that level.

    What comes before it, the way there, and after it is left out; the clock begins with it.

    Raises `InputError` where that is less than half of the rows.
    """
    at = _chosen(table, where)
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
    note = f"{column!r} is held at {level:.4g} from line {table.line[at[rows.start]]} on: {count} rows."
    held = rows_of(table, at[rows])
    if time is not None:
        t = table.number(time)[at]
        way = t[rows.start] - t[0]
        held = replace(held, columns={**held.columns, time: t[rows] - t[rows.start]})
        note += (
            f" Time counts from there. The way took {way:.3g}: what is over as fast is not seen."
        )
    return replace(held, notes=(*table.notes, Note("held", note))), level


def _chosen(table: Table, where: Mapping[str, list[str]]) -> np.ndarray:
    rows = np.ones(len(table.line), bool)
    for name, values in where.items():
        rows &= parse_condition(f"{name}={','.join(values)}")(table)
    return np.flatnonzero(rows)
