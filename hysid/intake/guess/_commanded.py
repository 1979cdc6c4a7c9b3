"""What a rig was told to do: a column that is held, goes in steps, at a constant rate, or as a sine."""

from itertools import pairwise

import numpy as np

from hysteresis.records._cycles import turning_points

from ._column_pairs import held, rank_correlation, worked

HELD = 0.7
"""Above this share of rows at two levels a column is held constant."""
STRAIGHT, BENT = 0.005, 0.02
"""Deviation from straight lines over time, relative to the range: below the first a drive keeps a constant
rate, above the second a column does not."""
NEAR, ALIKE = 0.01, 0.9
"""A column is held within so much of its range, and is not if it still has this rank correlation there."""
EVEN = 0.2
"""The part by which the times between two reversals of a sine differ, at most: noise moves reversals."""
LONG = 0.2
"""The share of its range that a column goes between two reversals where that counts."""
LEVELS, STANDS = 3, 0.6
"""A staircase has so many levels at least, and stands for so large a share of its rows."""


def commanded(x: np.ndarray, other: np.ndarray, t: np.ndarray | None) -> str:
    """How the rig drove x (n,) and not the other column (n,), in words; "" where that does not show.

    `t` (n,): the clock; without one rows are taken as evenly spaced in time.
    """
    if held(worked(x)) > HELD > held(other) and not _follows(x, other):
        return "is held constant"
    if _stands(x) > STANDS and _stands(other) < 0.5 * STANDS:
        return "goes in steps"
    clocks = [] if t is None else [("moves at a constant rate", t)]
    # A clock that turns over, or repeats a stamp, bends what moves evenly.
    for said, rows in (*clocks, ("moves evenly from row to row", np.arange(len(x)))):
        if _bend(x, rows) < STRAIGHT and _bend(other, rows) > BENT:
            return said
    return ""


def is_sine(x: np.ndarray, other: np.ndarray, t: np.ndarray | None) -> bool:
    """Whether x moves as a sine of one frequency, and the other column does not."""
    clock = np.arange(len(x)) if t is None else t
    return _bend(x, clock, wave=True) < STRAIGHT and _bend(other, clock, wave=True) > BENT


def _follows(x: np.ndarray, other: np.ndarray) -> bool:
    """Whether x follows the other column where it seems to be held: its range is that of a few rows."""
    near = np.abs(x - np.median(x)) <= NEAR * np.ptp(x)
    return abs(rank_correlation(x[near], other[near])) > ALIKE


def _stands(x: np.ndarray) -> float:
    """The share of rows at which x stays as it is, where it stays at several levels in turn."""
    still = np.diff(x) == 0
    levels = np.unique(x[1:][still])
    return float(still.mean()) if still.size and len(levels) >= LEVELS else 0.0


def _bend(x: np.ndarray, t: np.ndarray, wave: bool = False) -> float:
    """The largest deviation of x from a straight line over t between its reversals, relative to its range.

    Of a `wave` from a sine, between reversals that are as far apart as usual. A column that never goes far,
    or has no such reversals, counts as bent.
    """
    span = float(np.ptp(x)) if x.size else 0.0
    if not span:
        return np.inf
    at = turning_points(x, 0.1 * span)
    legs = [
        slice(a, b + 1) for a, b in pairwise(at) if abs(x[b] - x[a]) >= LONG * span and b > a + 3
    ]
    legs = legs[1:-1] if wave else legs
    clocks = [t[rows] - t[rows][0] for rows in legs]
    if not legs or not all(np.all(np.isfinite(clock)) and np.ptp(clock) > 0 for clock in clocks):
        return np.inf
    half, worst = float(np.median([clock[-1] for clock in clocks])), 0.0
    if wave and max(abs(clock[-1] / half - 1) for clock in clocks) > EVEN:
        return np.inf
    for rows, clock in zip(legs, clocks, strict=True):
        turned = np.pi * clock / half
        terms = [np.cos(turned), np.sin(turned)] if wave else [clock]
        A = np.column_stack([np.ones(len(clock)), *terms])
        left = x[rows] - A @ np.linalg.lstsq(A, x[rows])[0]
        worst = max(worst, float(np.sqrt(np.mean(left**2))) / span)
    return worst
