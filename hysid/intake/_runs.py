"""Rows of moduli over frequency, and of steps at several temperatures: a sequence for every run."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hysteresis import InputError, Note, Table, conversion
from hysteresis.records._table import rows_of
from hysteresis.records._units import named_unit
from identify.internal import MODULI, PARTS, RUNS

from ._constant_input import chosen, with_column

RUN = "run"
"""The column that tells runs apart."""
RATIO = re.compile(r"tan", re.IGNORECASE)
"""Names of a loss that is a part of the storage modulus: tan delta."""


def with_moduli(
    table: Table,
    frequency: str,
    storage: str,
    loss: str | None,
    runs: Sequence[str],
    exact: bool,
    where: Mapping[str, list[str]],
) -> Table:
    """The chosen rows with their storage moduli, and again with their loss moduli, as sequences.

    A loss without a unit beside a storage modulus that has one is tan delta, a part of it. Rows without a
    frequency above 0 or without a modulus are left out. Raises `InputError` `wrong-unit`.
    """
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
    at = chosen(table, where)
    run = _runs(table, f, at, runs, exact)
    parts = []
    for part, y in zip(PARTS, values, strict=False):
        there = np.isfinite(y[at]) & (y[at] > 0) & (f[at] > 0)
        parts.append((at[there], y[at[there]], [f"{part} {k}".strip() for k in run[there]]))
    at, y, names = (np.concatenate([part[k] for part in parts]) for k in range(3))
    if not len(at):
        raise InputError("no-rows", "No row has a frequency and a modulus.", place=str(table.path))
    beside = "" if loss is None else f" and the loss of {loss!r}"
    note = Note(MODULI, f"The storage of {storage!r}{beside} over {frequency!r}: {len(at)} moduli.")
    long = replace(rows_of(table, at), notes=(*table.notes, note))
    long = replace(long, columns={**long.columns, storage: y})
    return with_column(long, RUN, np.array(names))


def with_runs(
    table: Table,
    name: str,
    value: float,
    time: str | None,
    runs: Sequence[str],
    exact: bool,
    where: Mapping[str, list[str]],
) -> Table:
    """The chosen rows, of every run in the order of its times, with this value in the column `name`."""
    at = chosen(table, where)
    if time is None:
        raise InputError(
            "no-time",
            "runs at several temperatures are shifted in time, and no time was named.",
            place=str(table.path),
            fix="name the time column (--time COL).",
        )
    t = table.number(time)
    run = _runs(table, t, at, runs, exact)
    order = np.lexsort((t[at], np.unique(run, return_inverse=True)[1]))
    order = order[t[at][order] > 0]
    few = rows_of(table, at[order])
    said = f"{len(np.unique(run))} runs, of which each has one temperature."
    few = replace(few, notes=(*few.notes, Note(RUNS, said)))
    few = with_column(few, name, np.full(len(order), value))
    return with_column(few, RUN, run[order])


def _runs(
    table: Table, x: np.ndarray, at: np.ndarray, names: Sequence[str], exact: bool
) -> np.ndarray:
    """Of the rows `at` the run that each belongs to, "" where they are one.

    Runs have one value each of the columns where that is `exact`. Of temperatures, which differ from row to
    row, another run begins where `x` turns back; where it never does, rows within a kelvin are one.
    """
    if exact or not names:
        words = [table.text[name][at] for name in names] or [np.full(len(at), "")]
        return np.array(["|".join(row) for row in zip(*words, strict=True)])
    good = np.isfinite(x[at])  # other rows are left out later
    back = np.zeros(len(at), int)
    back[good] = np.cumsum(np.append(0, turns_back(x[at][good])))[: good.sum()]
    return (back if back.any() else np.round(table.number(names[0])[at])).astype(str)


def turns_back(x: np.ndarray) -> np.ndarray:
    """Of each step of a series whether it is against the usual way, (n - 1,)."""
    steps = np.diff(x)
    way = np.sign(np.median(np.sign(steps[steps != 0]))) if np.any(steps) else 1.0
    return steps * way < 0
