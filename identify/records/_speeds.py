"""How fast the input of a record moves, and whether its differences are its speeds."""

import numpy as np

from hysteresis import Record

EVEN = 0.05
"""Of a usual step of the input: where nine in ten steps differ from the one before by less, their noise
makes two per cent of a speed."""


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
