"""Reading a CSV of a test rig; records with a sign turned, a zero moved, or first rows known."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import reduce
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .._errors import InputError
from .._format import quantity
from .._verdict import Note
from ._abstract_record import KNOWN
from ._arrays import floats
from ._read_table import read_table
from ._record import Record
from ._table import OWN_ROW, Table, column_of, places
from ._units import column_unit


def with_known(record: Record, known: Any) -> Record:
    """The record with the first rows of every sequence known: so many, or as many as this column says.

    They tell the state that a model begins the rest in, and do not count.

    **Raises:** `InputError` `bad-option` for what is neither a number of rows nor a column, `no-rows` where
    nothing is left to predict.
    """
    name = str(known)
    if name in record.columns:
        counts = floats(record.columns[name])[record.starts]
    else:
        counts = np.full(len(record.starts), float(name) if name.isdecimal() else np.nan)
    if not (np.isfinite(counts) & (counts >= 0) & (counts == np.floor(counts))).all():
        problem = f"{name!r} is neither a number of rows nor a column of such numbers."
        mend = "Say how many rows of each sequence are known: --known 100, or --known COL."
        raise InputError("bad-option", problem, place=record.source, fix=mend)
    sizes = np.diff([*record.starts, len(record)])
    rows = np.arange(len(record)) - np.repeat(record.starts, sizes) < np.repeat(counts, sizes)
    mask = record.mask & ~rows
    if not rows.any():
        return record
    if not mask.any():
        problem = "All rows are known: none is left to predict."
        mend = "Give fewer known rows (--known N)."
        raise InputError("no-rows", problem, place=record.source, fix=mend)
    said = f"The first states are told from {rows.sum()} known rows, which do not count."
    return record.noted("known-rows", said, mask=mask, columns={**record.columns, KNOWN: rows})


def _listed(words: str | Sequence[str] | None) -> list[str]:
    """Names as a list: one alone is a list of one."""
    return [words] if isinstance(words, str) else list(words or ())


def turned(record: Record, names: str | Sequence[str]) -> Record:
    """The record with the sign of these columns turned: its input, output, channels or conditions.

    **Raises:** `InputError` `no-column` for a name that is none of them.
    """
    changes: dict[str, Any] = {"columns": dict(record.columns)}
    for name in _listed(names):
        roles = {record.output_name: "output"}
        if not record.channels:
            roles[record.input_name] = "input"
        if name in roles:
            changes[roles[name]] = -getattr(record, roles[name])
        elif name not in (*record.channels, *record.conditions):
            have = ", ".join(map(repr, (*roles, *record.channels, *record.conditions)))
            said = f"{name!r} is not used, so its sign cannot be turned; have {have}."
            mend = "Name the input, the output, a channel or a condition (--turn COL)."
            raise InputError("no-column", said, place=record.source, fix=mend)
        if name in record.columns:
            changes["columns"][name] = -record.columns[name]
        note = Note("turned", f"Turned the sign of {name!r}.")
        changes["history"] = (*changes.get("history", record.history), note)
    return replace(record, **changes)


def rezeroed(record: Record, jumps: Sequence[str]) -> Record:
    """The record with jumps of the output's zero taken out.

    **Arguments:**

    - `jumps`: each `LINE:SIZE`. From the row of this line to the end of its sequence the output is less by
      SIZE, in its unit. Lines that the record does not have change nothing.

    **Raises:** `InputError` `bad-option`.
    """
    y, notes = record.output.copy(), []
    for jump in jumps:
        line, size = read_jump(jump)
        for label, rows in record.sequences():
            if not (found := np.flatnonzero(record.line[rows] == line)).size:
                continue
            y[rows.start + found[0] : rows.stop] -= size
            to = "" if len(record.labels) == 1 else f" of sequence {label!r}"
            much = quantity(size, record.output_unit)
            told = f"Subtracted {much} from the output{to}, from line {line} on."
            notes.append(Note("rezeroed", told))
    return replace(record, output=y, history=(*record.history, *notes))


def read_jump(text: str) -> tuple[int, float]:
    """Line and size of a jump, `LINE:SIZE`. Raises `InputError` `bad-option`."""
    match = re.fullmatch(r"\s*(\d{1,18})\s*:\s*(\S+)\s*", text)
    try:
        size = float(match[2]) if match else np.nan
    except ValueError:
        size = np.nan
    if match is None or not np.isfinite(size):
        said = f"{text!r} is not a line and the size of a jump."
        mend = "Write the line of the first row behind it and the size: --rezero 232:-13.7."
        raise InputError("bad-option", said, fix=mend)
    return int(match[1]), size


def on_one_clock(
    inputs: Mapping[str, np.ndarray],
    own: np.ndarray,
    time: np.ndarray,
    groups: np.ndarray | None,
    own_name: str,
    name: str,
) -> tuple[dict[str, np.ndarray], Note]:
    """Inputs (n,), read at the times `own` (n,), at the output's `time` (n,) instead; and a note.

    Linear within each group and each run of rising times; before the first and after the last reading the
    nearest one holds. A reading that is missing is left out.

    Raises `InputError` `time-backwards` where one clock goes back and the other does not, since nothing
    says which readings belong together.
    """
    label = (
        np.zeros(len(time), int) if groups is None else np.unique(groups, return_inverse=True)[1]
    )
    moved = {key: np.full(len(time), np.nan) for key in inputs}
    for value in np.unique(label):
        rows = np.flatnonzero(label == value)
        cut, other = (np.flatnonzero(np.diff(clock[rows]) < 0) + 1 for clock in (time, own))
        if not np.array_equal(cut, other):
            raise InputError(
                "time-backwards",
                f"The clocks {own_name!r} and {name!r} go back at different rows.",
                cause="several runs in one file, or a clock that stumbles.",
                fix="name the runs (--group COL), or use one clock (leave --input-time out).",
            )
        for part in np.split(rows, cut):
            for key, x in inputs.items():
                good = part[np.isfinite(x[part]) & np.isfinite(own[part])]
                if good.size:
                    moved[key][part] = np.interp(time[part], own[good], x[good])
    apart = float(np.nanmedian(np.abs(time - own)))
    said = (
        f"Input taken from its clock {own_name!r} to the output's {name!r} by linear interpolation:"
        f" they are {apart:.3g} apart in the median."
    )
    return moved, Note("one-clock", said)


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
    notes, units = list(table.notes), {}
    inputs, condition, keep, rezero = map(_listed, (input, condition, keep, rezero))
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
    names = _listed(group)
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
        | {name: moved[name] for name in (*channels, *condition)}
        | ({} if np.all(np.diff(table.line) > 0) else {OWN_ROW: places(table)[chosen]}),
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


def parse_condition(text: str) -> tuple[str, list[str]]:
    """Column and values of "COL=VALUE[,VALUE]" or "COL%2=0". Raises `InputError` `bad-condition`."""
    name, equals, right = text.partition("=")
    name, values = name.strip(), [v.strip() for v in right.split(",")]
    if not (name and equals and all(values)):
        mend = "write COL=VALUE[,VALUE] or COL%2=0."
        raise InputError("bad-condition", f"{text!r} is no condition on a column.", fix=mend)
    return name, values


def fulfilling(table: Table | Record, conditions: Iterable[str], strict: bool = True) -> np.ndarray:
    """The rows (n,) bool of a table or record that fulfil all conditions; see `parse_condition`.

    Numbers compare as numbers: `run=4` holds for "4" and 4.0. Raises `no-column`, and where it is `strict`
    `no-match` for a value that occurs nowhere.
    """
    rows = np.ones(len(table.line), bool)
    for name, values in map(parse_condition, conditions):
        stem, _, modulus = name.rpartition("%")
        if stem and modulus.isdigit() and int(modulus) and name not in table.columns:
            rest = np.mod(floats(column_of(table, stem)), int(modulus))
            rows &= np.isin(rest, floats(values))
        else:
            rows &= _matching(table, name, values, strict)
    return rows


def _matching(
    table: Table | Record, name: str, values: Sequence[str], strict: bool = True
) -> np.ndarray:
    words, inverse = np.unique(column_of(table, name), return_inverse=True)
    numbers, found = floats(words), np.zeros(len(words), bool)
    for value, number in zip(values, floats(values), strict=True):
        hit = (words.astype(str) == value) | (numbers == number)
        if strict and not hit.any():
            known = [f"{w:g}" if isinstance(w, float) else str(w) for w in words.tolist()]
            near = ", ".join(get_close_matches(value, known, 5, 0.0))
            problem = f"No row has {name}={value}; nearest: {near}."
            place = table.path if isinstance(table, Table) else table.source
            raise InputError("no-match", problem, place=place)
        found |= hit
    return found[inverse]
