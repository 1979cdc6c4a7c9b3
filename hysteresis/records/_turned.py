"""Columns whose sign is turned: a rig that counts a push where its record should count a pull."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from .._errors import InputError
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
