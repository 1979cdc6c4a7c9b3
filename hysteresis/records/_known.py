"""Rows whose output is known beforehand, at the beginning of each sequence."""

from typing import Any

import numpy as np

from .._errors import InputError
from ._abstract_record import KNOWN
from ._record import Record


def with_known(record: Record, known: Any) -> Record:
    """The record with the first rows of every sequence known: so many, or as many as this column says.

    They tell the state that a model begins the rest in, and do not count.

    **Raises:** `InputError` `bad-option` for what is neither a number of rows nor a column, `no-rows` where
    nothing is left to predict.

    **Example:**

        >>> from hysteresis.records._known import with_known
        >>> int(record.mask.sum()), int(with_known(record, 20).mask.sum())
        (101, 81)
    """
    name = str(known)
    if name in record.columns:
        counts = np.asarray(record.columns[name], float)[record.starts]
    else:
        counts = np.full(len(record.starts), float(name) if name.isdecimal() else np.nan)
    if not (np.isfinite(counts) & (counts >= 0)).all():
        raise InputError(
            "bad-option",
            f"{name!r} is neither a number of rows nor a column of such numbers.",
            place=record.source,
            fix="Say how many rows of each sequence are known: --known 100, or --known COL.",
        )
    sizes = np.diff([*record.starts, len(record)])
    rows = np.arange(len(record)) - np.repeat(record.starts, sizes) < np.repeat(counts, sizes)
    mask = record.mask & ~rows
    if not mask.any():
        raise InputError(
            "no-rows",
            "All rows are known: none is left to predict.",
            place=record.source,
            fix="Give fewer known rows (--known N).",
        )
    said = f"The first states are told from {rows.sum()} known rows, which do not count."
    return record.noted("known-rows", said, mask=mask, columns={**record.columns, KNOWN: rows})
