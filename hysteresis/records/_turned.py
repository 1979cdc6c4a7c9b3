"""What a rig counts another way than its record should: a push for a pull, or from another zero."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._errors import InputError
from .._format import quantity
from .._note import Note
from ._record import Record


def turned(record: Record, names: str | Sequence[str]) -> Record:
    """The record with the sign of these columns turned: its input, output, channels or conditions.

    **Raises:** `InputError` `no-column` for a name that is none of them.

    **Example:**

        >>> from hysteresis.records._turned import turned
        >>> turned(record, record.output_name).output[-1] == -record.output[-1]
        np.True_
    """
    changes: dict[str, Any] = {"columns": dict(record.columns)}
    for name in (names,) if isinstance(names, str) else names:
        roles = {record.output_name: "output"}
        if not record.channels:
            roles[record.input_name] = "input"
        if name in roles:
            changes[roles[name]] = -getattr(record, roles[name])
        elif name not in (*record.channels, *record.conditions):
            have = ", ".join(map(repr, (*roles, *record.channels, *record.conditions)))
            raise InputError(
                "no-column",
                f"{name!r} is not used, so its sign cannot be turned; have {have}.",
                place=record.source,
                fix="Name the input, the output, a channel or a condition (--turn COL).",
            )
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

    **Example:**

        >>> from hysteresis.records._turned import rezeroed
        >>> tared = hysteresis.Record.from_arrays([0, 1, 2, 1], [0, 1, 7, 6])
        >>> rezeroed(tared, ["3:5"]).output
        array([0., 1., 2., 1.])
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
        raise InputError(
            "bad-option",
            f"{text!r} is not a line and the size of a jump.",
            fix="Write the line of the first row behind it and the size: --rezero 232:-13.7.",
        )
    return int(match[1]), size
