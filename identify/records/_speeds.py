"""How fast and how far the input of a record moves, and whether its differences are its speeds."""

from typing import Any

import numpy as np

from hysteresis import Record
from hysteresis.records._cycles import counted_cycles, default_dead_band, turning_points

EVEN = 0.05
"""Of a usual step of the input: where nine in ten steps differ from the one before by less, their noise
makes two per cent of a speed."""

VARIED = 1.5
"""Ratio of the rates of cycles from which on a lag between the clocks is not just another loop."""

ALIKE = 0.15
"""By which part of their size ranges of one amplitude may differ."""

WHOLE = 0.9
"""Part of a cycle's rows that count, against the cycle with the greatest one, if it is a whole one."""


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
    return len(rates) < 2 or bool(np.quantile(rates, 0.9) >= VARIED * np.quantile(rates, 0.1))


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
    return bool(len(bends)) and bool(np.quantile(bends, 0.9) < EVEN * usual)
