"""Two clocks in one record: an input that is updated less often than it is read, or read too late."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record
from hysteresis.records._arrays import pieces
from hysteresis.records._change import ALIKE, FEWEST
from hysteresis.records._cycles import counted_cycles, default_dead_band, turning_points

from .._levels import MUCH, PART, REPEATS, WHOLE
from ._folds import Fold, Parts


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


# Learning from the last cycles alone, where one cycle is repeated and the sample settles.

# How fast and how far the input of a record moves, and whether its differences are its speeds.


def rates_differ(record: Record) -> bool:
    """Whether the ranges over the durations of its whole cycles differ; of sequences without one, theirs.

    The fastest tenth against the slowest one; yes where there is only one cycle or sequence.
    """
    if record.time is None:
        return False
    rates: list[float] = []
    every = counted_cycles(record, record.mask, 0.0)
    for (_, rows), cycles in zip(record.sequences(), every, strict=True):
        most = max((one.share for one in cycles), default=0.0)
        whole: list[Any] = [one.rows for one in cycles if one.share > WHOLE * most]
        if not whole and record.mask[rows].any():
            whole = [rows.start + np.flatnonzero(record.mask[rows])]
        for own in whole:
            moved, lasted = np.ptp(record.input[own]), np.ptp(record.time[own])
            if moved > 0 and lasted > 0:
                rates.append(float(moved / lasted))
    return len(rates) < 2 or bool(np.quantile(rates, 0.9) >= MUCH * np.quantile(rates, 0.1))


def amplitudes_differ(record: Record) -> bool:
    """Whether its ways from one reversal to the next, or its sequences, differ in their range.

    Of a sequence the first and the last way may be cut short: its own range stands for them.
    """
    ranges: list[float] = []
    for _, rows in record.sequences():
        u = record.input[rows][record.mask[rows]]
        if len(u):
            turns = turning_points(u, default_dead_band(u))
            ranges += [float(np.ptp(u)), *np.abs(np.diff(u[turns]))[1:-1].tolist()]
    return min(ranges) < (1 - ALIKE) * max(ranges)


def usual_speed(record: Record) -> tuple[float, float]:
    """The speed of the input that a quarter of the samples exceed, and the sampling step; else 0."""
    if record.time is None:
        return 0.0, 0.0
    dt, du = (
        np.concatenate([np.diff(x[rows]) for _, rows in record.sequences()])
        for x in (record.time, record.input)
    )
    moved = dt > 0
    if not moved.any():
        return 0.0, 0.0
    speed = float(np.quantile(np.abs(du[moved] / dt[moved]), 0.75))
    return speed, float(np.median(dt[moved]))


def moves_evenly(record: Record, usual: float) -> bool:
    """Whether the input's differences are its speeds, with no noise or rounding to speak of."""
    turns = [np.diff(record.input[rows], 2) for _, rows in record.sequences()]
    bends = np.abs(np.concatenate(turns))
    return bool(len(bends)) and bool(np.quantile(bends, 0.9) < PART * usual)


SOME_OF = 2 * REPEATS
"""Cycles that a record needs for some of them to be enough."""


def repeats(record: Record, fewest: int = FEWEST) -> bool:
    """Whether so many cycles of a single sequence are alike in their range and rate."""
    cycles = counted_cycles(record, record.mask, 0.0)[0]
    if len(record.labels) > 1 or len(cycles) < fewest:
        return False
    ranges = [np.ptp(record.input[one.rows]) for one in cycles]
    return bool(np.ptp(ranges) <= ALIKE * np.median(ranges)) and not rates_differ(record)


def latest(record: Record, parts: Parts) -> list[Parts]:
    """The same parts and held-out rows, of which the last half of the trained cycles, and the last three,
    are learnt from; none where cycles differ in range or rate: first ones then tell what later ones do not.
    """
    if not parts.folds or not repeats(record, SOME_OF):
        return []
    # Rows in no cycle are a part of their own behind the cycles, and learnt from.
    of_cycles = set(parts.label[record.mask & (record.cycle > 0)].tolist())

    def last(which: tuple[int, ...], count: int | None) -> tuple[int, ...]:
        cycles = [p for p in which if p in of_cycles]
        count = max(REPEATS, -(-len(cycles) // 2)) if count is None else count
        return tuple(p for p in which if p not in of_cycles or p in cycles[-count:])

    return [
        parts._replace(
            folds=tuple(Fold(last(fold.train, count), fold.test) for fold in parts.folds),
            kept=last(parts.all, count),
        )
        for count in (None, REPEATS)
    ]


# Relaxation times that a record may show, from its sampling step and its length.


def relaxation_times(record: Record, learnt: Bool[np.ndarray, " samples"]) -> tuple[float, ...]:
    """Two a decade from the sampling step to twice the longest sequence; none without time.

    Where one cycle is repeated, only to a sixth of the rows that are `learnt` from: what has not died out,
    to exp(-3), in their first half cannot be told from a drift, would explain how one run settles, and go
    on in the next. Where a sequence's first cycles do not count, only to a quarter of a cycle: what lasts
    longer cannot be told from what those cycles left behind.
    """
    if record.time is None:
        return ()
    sequences = [record.time[rows] for _, rows in record.sequences()]
    steps = np.concatenate([np.diff(t) for t in sequences])
    step = float(np.median(steps[steps > 0]))
    last_time = 2 * longest_sequence(record)
    cycles = counted_cycles(record, record.mask, 0.0)[0]
    if repeats(record):
        t = record.time[learnt & (record.cycle > 0)]
        last_time = float(np.ptp(t)) / 6
    if len(sequences) == 1 and cycles and cycles[0].number > 1:
        last_time = float(np.median([np.ptp(record.time[one.rows]) for one in cycles])) / 4
    count = int(np.clip(1 + 2 * np.log10(last_time / step), 5, 9))
    return tuple(float(tau) for tau in np.geomspace(step, last_time, count))


def longest_sequence(record: Record) -> float:
    """How long its longest sequence lasts; 0 without time."""
    if record.time is None:
        return 0.0
    return max(float(np.ptp(record.time[rows])) for _, rows in record.sequences())


def slow_times(record: Record) -> tuple[float, ...]:
    """Four from five steps to a third of the longest sequence; none where that is no longer, or without
    time."""
    longest, step = longest_sequence(record), usual_speed(record)[1]
    if not 0 < 15 * step < longest:
        return ()
    return tuple(np.geomspace(5 * step, longest / 3, 4).tolist())
