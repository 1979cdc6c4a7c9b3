"""Reading a test rig's CSV: every fault is answered with its line, its column and its remedy."""

from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from functools import reduce
from pathlib import Path
from typing import Literal

import numpy as np

from .._errors import InputError
from .._note import Note
from ._cells import floats
from ._read_table import read_table
from ._record import Record
from ._table import Table, column_of
from ._turned import read_jump, rezeroed, turned
from ._two_clocks import on_one_clock
from ._units import column_unit


def read_csv(
    path: str | Path | Table,
    input: str | Sequence[str],
    output: str,
    time: str | None = None,
    dt: float | None = None,
    group: str | Sequence[str] | None = None,
    where: Mapping[str, Sequence[str]] | None = None,
    nan: Literal["raise", "omit", "interpolate"] = "raise",
    decimal: str = ".",
    separator: str | None = None,
    units_row: int | None = None,
    na_values: Collection[str] = (),
    input_unit: str | None = None,
    output_unit: str | None = None,
    time_unit: str | None = None,
    keep: Sequence[str] = (),
    segments: Literal["auto"] | None = None,
    input_time: str | None = None,
    condition: Sequence[str] = (),
    turn: Sequence[str] = (),
    rezero: Sequence[str] = (),
    sigma: str | None = None,
) -> Record:
    """A `Record` from a CSV file, or from a `Table` already read.

    **Arguments:**

    - `input`, `output`, `time`: columns by their exact headers. Units come from "Force (N)",
        "Force [N]", "force_N", a row of units, or `input_unit`, `output_unit`, `time_unit`;
        without any the unit is "1", noted. Several inputs are channels that `fit` combines.
    - `dt`: step in seconds where there is no time column: `t = k dt` within each sequence.
    - `group`: column(s) whose values name independent sequences, joined by "/".
    - `where`: `{column: values}`, the rows to use; numbers compare as numbers.
    - `nan`: "raise"; "omit" masks rows without output, history still runs over them, and drops rows that
        have neither input nor output, unless `dt` counts them; "interpolate" fills them linearly.
    - `keep`: further columns to carry along in `Record.columns`.
    - `segments`: "auto" starts a new sequence wherever time goes back.
    - `input_time`: the clock of the input(s), where it is another than that of the output, which is
        then `time`: the input is interpolated linearly to the output's times.
    - `condition`: columns such as a temperature or a pressure, on which the output depends too.
    - `sigma`: the standard deviation of each row's output, in its unit, but for a factor common to all.
    - `turn`: columns whose sign is turned: a push that the rig counts as a pull.
    - `rezero`: jumps of the output's zero that are taken out, each `LINE:SIZE`. SIZE is subtracted from the
        output from the row on this line of the file to the end of its sequence, before a sign is turned.
    - `decimal`, `separator`, `units_row`, `na_values`: see `read_table`.

    **Raises:** `InputError` as `read_table` and `Record` do, and `no-column`, `no-match`,
    `text-cell`, `decimal-comma`, `thousands-separator`, `not-finite`, `too-large`,
    `unknown-unit`, `wrong-unit`, `bad-option`.

    **Example:**

        >>> file = datasets / "sponge-50mm-cycles.csv"
        >>> record = hysteresis.read_csv(file, "force (N)", "displacement (mm)", "time (s)")
        >>> len(record), record.input_unit, record.output_unit
        (101, 'N', 'mm')
    """
    if isinstance(path, Table):
        table = path
    else:
        table = read_table(
            path, decimal=decimal, separator=separator, units_row=units_row, na_values=na_values
        )
    if dt is not None and (time is not None or not 0 < dt < np.inf):
        problem = f"time={time!r}, dt={dt!r}: give one of them, and a step above 0."
        raise InputError("bad-option", problem, fix="--time COL, or --dt SECONDS.")
    if nan not in ("raise", "omit", "interpolate"):
        raise InputError("bad-option", f"nan={nan!r}.", fix="--nan raise, omit or interpolate.")
    notes, units = list(table.notes), {}
    inputs = [input] if isinstance(input, str) else list(input)
    if not inputs or len(set(inputs)) < len(inputs):
        twice = ", ".join(sorted({repr(name) for name in inputs if inputs.count(name) > 1}))
        problem = f"Input {twice} is given twice." if inputs else "No input is given."
        raise InputError("given-twice", problem, fix="give each channel once (--input COL).")
    given = [("input", name, input_unit) for name in inputs] + [("output", output, output_unit)]
    if time is not None:
        given.append(("time", time, time_unit))
    given += [("condition", name, None) for name in condition]
    for role, name, unit in given:
        column_of(table, name)
        units[role, name], note = column_unit(name, role, unit, table.units.get(name), table.path)
        notes += note
    channels = {name: units["input", name] for name in inputs} if len(inputs) > 1 else {}
    named = {} if channels else {"input_name": inputs[0], "input_unit": units["input", inputs[0]]}
    said = repr(inputs[0]) if named else f"{len(inputs)} channels"
    rows = np.ones(len(table.line), bool)
    for name, values in (where or {}).items():
        rows &= _matching(table, name, [str(v) for v in values])
    asked = " and ".join(f"{name}={','.join(map(str, v))}" for name, v in (where or {}).items())
    if not rows.any():
        raise InputError("no-match", f"No row has {asked}.", place=table.path)
    if not rows.all():
        notes.append(Note("selected", f"Used {rows.sum()} of {len(rows)} rows: {asked}."))
    if nan == "omit" and dt is None and input_time is None:
        cells = [np.isnan(table.number(name, rows)) for name in (*inputs, output)]
        empty = np.flatnonzero(rows)[np.logical_and.reduce(cells)]
        if 0 < len(empty) < rows.sum():
            rows[empty] = False
            without = f"Left out {len(empty)} rows that have neither {said} nor {output!r}."
            notes.append(Note("skipped", without))
    for line, _ in map(read_jump, rezero):
        if line not in table.line:
            problem = f"No row of the file is on line {line}."
            lines = f"The rows are on lines {table.line.min()} to {table.line.max()} (--rezero LINE:SIZE)."
            raise InputError("no-match", problem, place=table.path, fix=lines)
    chosen = slice(None) if rows.all() else rows  # a view, where a mask makes a copy
    names = [group] if isinstance(group, str) else list(group or ())
    for name in (*names, *keep, *filter(None, [sigma])):
        column_of(table, name)
    groups = None
    if names:
        parts = [table.text[name][chosen] for name in names]
        groups = reduce(lambda a, b: np.char.add(np.char.add(a, "/"), b), parts)
    t = None if time is None else table.number(time, chosen)
    moved = {name: table.number(name, chosen) for name in (*inputs, *condition)}
    if input_time is not None:
        if t is None:
            problem = f"The input's clock is {input_time!r}, and the output's is not given."
            raise InputError("bad-option", problem, fix="--time COL, the clock of the output.")
        own = table.number(input_time, rows)
        moved, note = on_one_clock(moved, own, t, groups, input_time, time or "")
        notes.append(note)
        if (ended := np.isnan(t) & np.isnan(table.number(output, rows))).any():  # before the input
            rows[np.flatnonzero(rows)[ended]] = False
            chosen = rows
            moved, t = {name: x[~ended] for name, x in moved.items()}, t[~ended]
            groups = None if groups is None else groups[~ended]
    record = Record.from_arrays(
        moved[inputs[0]] if named else None,
        table.number(output, chosen),
        t,
        groups,
        dt=dt,
        line=table.line[chosen],
        segments=segments,
        nan=nan,
        history=(Note("read", f"Read {rows.sum()} rows: {said} -> {output!r}."), *notes),
        columns={name: table.columns[name][chosen] for name in keep}
        | {name: moved[name] for name in (*channels, *condition)},
        channels=channels,
        conditions={name: units["condition", name] for name in condition},
        sigma=table.number(sigma, chosen) if sigma else None,
        sigma_name=sigma or "",
        output_name=output,
        time_name=time or "time",
        output_unit=units["output", output],
        time_unit=units.get(("time", time), time_unit or "s"),
        source=table.path,
        sha256=table.sha256,
        **named,
    )
    record = rezeroed(record, rezero) if rezero else record
    return turned(record, turn) if turn else record


def parse_condition(text: str) -> Callable[[Table | Record], np.ndarray]:
    """ "COL=VALUE[,VALUE]" or "COL%2=0" as a function of a table or record: its rows (n,) bool.

    Numbers compare as numbers: `run=4` holds for "4" and 4.0. The function raises `no-column`,
    and `no-match` where a value occurs nowhere. Raises `bad-condition`.

    **Example:**

        >>> table = hysteresis.read_table(datasets / "sponge-50mm-cycles.csv")
        >>> rows = hysteresis.parse_condition("cycle=2,3")(table)
        >>> int(rows.sum())
        40
    """
    name, equals, right = text.partition("=")
    name, values = name.strip(), [v.strip() for v in right.split(",")]
    if not (name and equals and all(values)):
        mend = "write COL=VALUE[,VALUE] or COL%2=0."
        raise InputError("bad-condition", f"{text!r} is no condition on a column.", fix=mend)
    stem, _, modulus = name.rpartition("%")

    def rows(table: Table | Record) -> np.ndarray:
        if stem and modulus.isdigit() and int(modulus) and name not in table.columns:
            return np.isin(np.mod(floats(column_of(table, stem)), int(modulus)), floats(values))
        return _matching(table, name, values)

    return rows


def _matching(table: Table | Record, name: str, values: Sequence[str]) -> np.ndarray:
    words, inverse = np.unique(column_of(table, name), return_inverse=True)
    numbers, found = floats(words), np.zeros(len(words), bool)
    for value, number in zip(values, floats(values), strict=True):
        hit = (words.astype(str) == value) | (numbers == number)
        if not hit.any():
            known = [f"{w:g}" if isinstance(w, float) else str(w) for w in words.tolist()]
            near = ", ".join(get_close_matches(value, known, 5, 0.0))
            problem = f"No row has {name}={value}; nearest: {near}."
            place = table.path if isinstance(table, Table) else table.source
            raise InputError("no-match", problem, place=place)
        found |= hit
    return found[inverse]
