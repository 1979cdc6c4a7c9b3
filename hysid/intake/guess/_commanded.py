"""What a rig was told to do: a column that is held, goes in steps, or moves at a constant rate."""

from itertools import pairwise

import numpy as np

from hysteresis.records._cycles import turning_points

from ._column_pairs import held, rank_correlation

HELD = 0.7
"""Above this share of rows at two levels a column is held constant."""
STRAIGHT, BENT = 0.005, 0.02
"""Deviation from straight lines over time, relative to the range: below the first a drive keeps a constant
rate, above the second a column does not."""
NEAR, ALIKE = 0.01, 0.9
"""A column is held within so much of its range, and is not if it still has this rank correlation there."""
LONG = 0.2
"""The share of its range that a column goes between two reversals where that counts."""
LEVELS, STANDS = 3, 0.6
"""A staircase has so many levels at least, and stands for so large a share of its rows."""


def commanded(x: np.ndarray, other: np.ndarray, t: np.ndarray | None) -> str:
    """How the rig drove x (n,) and not the other column (n,), in words; "" where that does not show.

    `t` (n,): the clock; without one rows are taken as evenly spaced in time.
    """
    if held(x) > HELD > held(other) and not _follows(x, other):
        return "is held constant"
    if _stands(x) > STANDS and _stands(other) < 0.5 * STANDS:
        return "goes in steps"
    clocks = [] if t is None else [("moves at a constant rate", t)]
    # A clock that turns over, or repeats a stamp, bends what moves evenly.
    for said, rows in (*clocks, ("moves evenly from row to row", np.arange(len(x)))):
        if _bend(x, rows) < STRAIGHT and _bend(other, rows) > BENT:
            return said
    return ""


def _follows(x: np.ndarray, other: np.ndarray) -> bool:
    """Whether x follows the other column where it seems to be held: its range is that of a few rows."""
    near = np.abs(x - np.median(x)) <= NEAR * np.ptp(x)
    return abs(rank_correlation(x[near], other[near])) > ALIKE


def _stands(x: np.ndarray) -> float:
    """The share of rows at which x stays as it is, where it stays at several levels in turn."""
    still = np.diff(x) == 0
    levels = np.unique(x[1:][still])
    return float(still.mean()) if still.size and len(levels) >= LEVELS else 0.0


def _bend(x: np.ndarray, t: np.ndarray) -> float:
    """The largest deviation of x from a straight line over t between its reversals, relative to its range.

    A column that never goes far counts as bent.
    """
    span = float(np.ptp(x)) if x.size else 0.0
    if not span:
        return np.inf
    worst, found = 0.0, False
    for rows in (slice(a, b + 1) for a, b in pairwise(turning_points(x, 0.1 * span))):
        if abs(x[rows][-1] - x[rows][0]) < LONG * span or len(x[rows]) < 5:
            continue
        clock = t[rows] - t[rows][0]
        if not (np.all(np.isfinite(clock)) and np.ptp(clock) > 0):
            return np.inf
        line = np.polyval(np.polyfit(clock, x[rows], 1), clock)
        worst, found = max(worst, float(np.sqrt(np.mean((x[rows] - line) ** 2))) / span), True
    return worst if found else np.inf
