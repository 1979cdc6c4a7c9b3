"""How soon a compensator says OK after it is switched on: its statuses over the rows of a fit."""

from typing import Any, NamedTuple

import numpy as np

from compensate import Status
from hysteresis import Record
from hysteresis._format import quantity

REACHED = 0.9
"""Part of all later rows that are OK from where OK is reached."""


class RunIn(NamedTuple):
    """The part of a record's counted rows that are OK, and where OK is reached: after so many cycles, and
    so much time; None where it is not, or there is no clock. `start`: what was known of the first state."""

    share: float
    cycles: float | None
    time: float | None
    start: str

    @property
    def document(self) -> dict[str, Any]:
        """For `fit.json`."""
        return {
            "ok_share": self.share,
            "ok_after": {"cycles": self.cycles, "time": self.time},
            "start": self.start,
        }

    @classmethod
    def of(cls, document: dict[str, Any]) -> "RunIn":
        """From `fit.json`."""
        after = document["ok_after"]
        return cls(document["ok_share"], after["cycles"], after["time"], document["start"])

    def sentence(self, time_unit: str) -> str:
        """When the compensator is OK, and for how much of the record."""
        of_rows = f"Switched on at the first row, {100 * self.share:.3g} % of the estimates are OK"
        if self.cycles is None:
            return f"{of_rows}; nine tenths of what follows never are."
        time = "" if self.time is None else f", {quantity(self.time, time_unit, 3)}"
        return f"{of_rows}: OK is reached after {self.cycles:.2g} cycles{time}."


def run_in_of(status: np.ndarray, record: Record, start: str = "unknown") -> RunIn:
    """Of the statuses of a record's rows, each sequence of which is a start of its own.

    OK is reached at the first row from which nine tenths of all later ones are OK; of several sequences the
    latest counts.
    """
    used = record.mask & np.isfinite(record.output)
    ok, latest, cycles = status == Status.OK, 0.0, 0.0
    for _, rows in record.sequences():
        known = ok[rows][used[rows]]
        if not len(known):
            continue
        later = np.cumsum(known[::-1])[::-1] / np.arange(len(known), 0, -1)
        reached = np.flatnonzero(known & (later >= REACHED))
        if not len(reached):
            return RunIn(float(ok[used].mean()), None, None, start)
        row = rows.start + int(np.flatnonzero(used[rows])[reached[0]])
        turns = record.cycle[rows]
        own = np.flatnonzero(turns == record.cycle[row]) + rows.start
        cycles = max(cycles, record.cycle[row] - turns.min() + (row - own[0]) / len(own))
        if record.time is not None:
            latest = max(latest, float(record.time[row] - record.time[rows.start]))
    time = None if record.time is None else latest
    return RunIn(float(ok[used].mean()), float(cycles), time, start)
