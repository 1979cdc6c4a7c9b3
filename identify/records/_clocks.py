"""Two clocks in one record: an input that is updated less often than it is read, or read too late."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import Record
from hysteresis.records._arrays import pieces


class Clocks(NamedTuple):
    """What was done to the input before a model saw it.

    - `lag`: the model answers to u(t - lag), and `lag_error`: its standard error, None where it was not
      looked for.
    - `interpolated`: a staircase was made linear between its updates.
    """

    lag: float = 0.0
    lag_error: float | None = None
    interpolated: bool = False

    def applied(self, record: Record) -> Record:
        """The record as the model sees it; its history says what was done to it before, which is not done
        twice."""
        done = {note.code for note in record.history}
        if self.interpolated and INTERPOLATED not in done:
            record = interpolated(record)
        return record if LAG in done else shifted(record, self.lag)

    def undone(self, record: Record, u: Float[np.ndarray, " samples"]) -> np.ndarray:
        """Inputs on the record's own clock, from those the model was found to answer to."""
        return shifted(replace(record, input=u), -self.lag).input


LAG, INTERPOLATED = "lag", "interpolated"
"""Codes of the notes that say what was done to an input."""

HELD = 3
"""Rows an input repeats, in the middle, from which on it is taken for held between its updates."""


def shifted(record: Record, lag: float) -> Record:
    """The record with u(t - lag) for its input: what the output answered to, if the input came early.

    Linear between samples. A negative lag moves the input of a later time to the output, for a slow reading
    of the input; beyond a sequence's end it goes on as it did for as long before. Before the beginning the
    input was the first one.
    """
    if lag == 0 or record.time is None:
        return record
    u = np.empty_like(record.input)
    for _, rows in record.sequences():
        t, known = record.time[rows], record.input[rows]
        u[rows] = np.interp(t - lag, t, known)
        if lag < 0:
            slope = (known[-1] - np.interp(t[-1] + lag, t, known)) / -lag
            u[rows] += slope * np.maximum(t - lag - t[-1], 0)
    return record.noted(LAG, f"input moved by a lag of {lag:.4g}", input=u)


def is_held(record: Record) -> bool:
    """Whether the input repeats each reading for several rows while the output goes on."""
    moves, usual = _moves(record)
    return moves > 20 and usual >= HELD


def interpolated(record: Record) -> Record:
    """The record with an input that is linear between its updates instead of a staircase.

    A reading is right when it changes. One that stays for long is a rest, and stays.
    """
    if record.time is None:
        return record
    u = record.input.copy()
    usual = int(_moves(record)[1])
    for _, rows in record.sequences():
        t, v = record.time[rows], record.input[rows]
        change = np.flatnonzero(np.diff(v, prepend=np.nan) != 0)
        rests = [b - usual for a, b in pairwise(change) if b - a > 5 * usual]
        knots = np.union1d(change, rests).astype(int)
        u[rows] = np.interp(t, t[knots], v[knots])
    return record.noted(INTERPOLATED, "input made linear between its updates", input=u)


def _moves(record: Record) -> tuple[int, float]:
    """How many runs of equal inputs, of fewer than 50 rows each, another one ends; their median length."""
    counts = np.zeros(50, int)
    for _, rows in record.sequences():
        u, since = record.input[rows], 0
        for piece in pieces(len(u)):
            changes = np.flatnonzero(np.diff(u[max(piece.start - 1, 0) : piece.stop]))
            lengths = np.diff(changes := changes + max(piece.start, 1), prepend=since)
            counts += np.bincount(lengths[lengths < 50], minlength=50)
            since = changes[-1] if len(changes) else since
    moves, upto = int(counts.sum()), np.cumsum(counts)
    middle = np.searchsorted(upto, [max(moves - 1, 0) // 2, moves // 2], side="right")
    return moves, float(middle.mean())


def least_at(objective: Callable[[float], float], begin: float, step: float) -> tuple[float, float]:
    """Where a smooth function of a lag is least, and its second derivative there.

    From `begin`, the least at whole steps, half a step and a quarter go downhill; a parabola follows. The
    derivative is 0 where the function goes on falling.
    """
    middle, stride = begin, step
    for _ in range(2):
        stride /= 2
        middle = min((middle - stride, middle, middle + stride), key=objective)
    a, b, c = (objective(middle + k * stride) for k in (-1, 0, 1))
    curvature = (a - 2 * b + c) / stride**2 if b <= min(a, c) else 0.0
    away = (a - c) / (2 * stride * curvature) if curvature > 0 else 0.0
    return middle + float(np.clip(away, -stride, stride)), curvature
