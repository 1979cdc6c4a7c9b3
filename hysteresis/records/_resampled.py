"""A record on a clock of even steps."""

from typing import Any

import numpy as np

from .._errors import InputError
from .._format import quantity
from .._note import Note
from ._abstract_record import AbstractRecord


def resampled(
    record: AbstractRecord, dt: float
) -> tuple[np.ndarray, Note, dict[str, Any], dict[str, np.ndarray]]:
    """The nearest rows, what is to be noted, the fields on the new clock, and the columns on it."""
    if record.time is None or not dt > 0:
        why = "there is no time column" if record.time is None else f"the step is {dt:g}"
        raise InputError("no-time", f"Cannot resample: {why}.", fix="give time= or dt=.")
    y, clock, rows = [], [], []
    inputs = {"": record.input}
    inputs |= {name: record.columns[name] for name in (*record.channels, *record.conditions)}
    moved: dict[str, list[np.ndarray]] = {name: [] for name in inputs}
    for _, s in record.sequences():
        t, out = record.time[s], record.output[s]
        c = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt * (1 + 1e-12)) + 1)
        good = np.isfinite(out)
        for name, x in inputs.items():
            moved[name].append(np.interp(c, t, x[s]))
        y.append(np.interp(c, t[good], out[good]) if good.any() else np.full(len(c), np.nan))
        rows.append(s.start + np.searchsorted((t[1:] + t[:-1]) / 2, c))
        clock.append(c)
    starts = np.cumsum([0, *map(len, clock[:-1])])
    whole = {name: np.concatenate(parts) for name, parts in moved.items()}
    sentence = f"Resampled {len(record)} rows to a step of {quantity(dt, record.time_unit)}."
    said = Note("resampled", sentence)
    changes = {"starts": starts, "input": whole.pop(""), "output": np.concatenate(y)}
    return np.concatenate(rows), said, changes | {"time": np.concatenate(clock)}, whole
