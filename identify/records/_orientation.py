"""What a record shows of the sense of its loops, the sign of its slope and its first states."""

import numpy as np

from hysteresis import Note, Record
from hysteresis._format import quantity
from hysteresis.records._arrays import pieces
from hysteresis.records._cycles import noise_level
from hysteresis.records._excitation import loop_direction

from .._levels import HELD, HELD_AT_ONCE, SEAM
from ._folds import thinned as thinned_rows

# Fewer rows of a long record: one in k counts, and those stay that the input's path needs.
#
# |u - line through the kept rows beside it| <= tolerance, at every row
#
# So every reversal that is wider than twice the tolerance stays, and a model passes the same history at the
# same times. A rig at 10 kHz writes a thousand times as many rows as a fit can learn from. The rows that
# are furthest off the lines are added until none is off: O(n) a round, about ten rounds.


FINE = 1e-4
"""Of the input's range: how far the path may be off where rows are enough; where they are few, `SEAM`. The
best models leave some thousandths unexplained, and a verdict allows some hundredths."""

NOISE = 10.0
"""Standard deviations of the input's noise: its extremes lie so far apart, and are no path."""


def thinned(record: Record) -> Record:
    """A record of at most `HELD_AT_ONCE` rows, of which half or fewer count; a shorter one as it is.

    The rows kept for the path do not count. A record whose path needs more rows, say of ten to a cycle, is
    given back whole.
    """
    if len(record) <= HELD_AT_ONCE:
        return record
    u, counted = record.input, np.zeros(len(record), bool)
    counted[thinned_rows(np.flatnonzero(record.mask), HELD_AT_ONCE // 2)] = True
    tolerance, most = _tolerance(u), SEAM * float(np.ptp(u))
    while (rows := _kept(record, counted, tolerance)).size > HELD_AT_ONCE:
        if (tolerance := 2 * tolerance) > most:
            return record
    said = (
        f"Of {record.mask.sum():,} rows {counted.sum():,} count; {len(rows):,} keep the input's path "
        f"to {quantity(tolerance, record.input_unit)}."
    )
    return record._in_order(rows, Note("thinned", said), mask=counted[rows])


def _kept(record: Record, counted: np.ndarray, tolerance: float) -> np.ndarray:
    """The rows that count and those that the path needs, rising; more than `HELD_AT_ONCE` if need be."""
    kept = counted.copy()
    kept[record.starts] = kept[record.starts - 1] = True  # the first and the last row of a sequence
    while np.count_nonzero(kept) <= HELD_AT_ONCE:
        beyond = _furthest(record, np.flatnonzero(kept), tolerance)
        if not beyond.size:
            break
        kept[beyond] = True
    return np.flatnonzero(kept)


def _tolerance(u: np.ndarray) -> float:
    """How far the input may be off the lines: it is no finer than its noise and than two of its steps."""
    least = np.inf
    for rows in pieces(len(u)):
        step = np.abs(np.diff(u[rows.start : rows.stop + 1]))
        least = min(least, step.min(where=step > 0, initial=np.inf))
    steps = 2 * least if least < np.inf else 0.0
    return max(FINE * float(np.ptp(u)), NOISE * noise_level(u), steps)


def _furthest(record: Record, kept: np.ndarray, tolerance: float) -> np.ndarray:
    """The row that is furthest off the line between each two kept rows, where that is too far."""
    found, u, t = [np.empty(0, int)], record.input, record.time
    for some in pieces(len(kept) - 1):
        ends = kept[some.start : some.stop + 1]
        rows, count = np.arange(ends[0], ends[-1]), np.diff(ends)
        clock = np.arange(ends[0], ends[-1] + 1.0) if t is None else t[ends[0] : ends[-1] + 1]
        begins = ends - ends[0]
        # From one sequence to the next there is no row between, and time may stand still.
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.diff(u[ends]) / np.diff(clock[begins])
            since = clock[:-1] - np.repeat(clock[begins[:-1]], count)
            off = np.abs(u[rows] - np.repeat(u[ends[:-1]], count) - np.repeat(slope, count) * since)
        worst = np.maximum.reduceat(off, begins[:-1])
        worst[~(worst > tolerance)] = np.nan
        found.append(rows[off == np.repeat(worst, count)])
    return np.concatenate(found)


TOLD = 0.3
"""Loops tell their direction where so much of their area has it; a correlation of input
and output beyond it outweighs them."""


def orientations(record: Record) -> tuple[bool, ...]:
    """`leading` values worth trying: one where the loops tell their direction, else both.

    Where the output falls, they are those of its negative, whose loops turn the other way.
    """
    direction = loop_direction(record) * (-1 if output_falls(record) else 1)
    if abs(direction) > TOLD:
        return (direction < 0,)
    return False, True


def initial_states(record: Record) -> tuple[str, ...]:
    """Initial states worth trying: negative saturation alone where most sequences start low."""
    u = record.input
    first = u[record.starts]
    low, high = u[record.mask].min(), u[record.mask].max()
    if np.mean(first < low + 0.25 * (high - low)) > 0.5:
        return ("negative",)
    return "negative", "positive", "demagnetised"


def output_falls(record: Record) -> bool:
    """Whether the output falls, on the whole, as the input rises.

    Judged within cycles, or sequences without any: what creeps from one to the next says nothing of it.
    Where loops are so wide that the input hardly tells the output, as of dry friction, a slope is chance.
    The output then falls only if its steps go against those of the input, by more than chance.
    """
    sequence = np.zeros(len(record), int)
    sequence[record.starts[1:]] = 1
    run = np.cumsum(sequence) * (record.cycle.max() + 1) + record.cycle
    u, y, run = record.input[record.mask], record.output[record.mask], run[record.mask]
    _, run, rows = np.unique(run, return_inverse=True, return_counts=True)
    u, y = (x - (np.bincount(run, x) / rows)[run] for x in (u, y))
    slope = _correlation(u, y)
    if abs(slope) > TOLD or abs(loop_direction(record)) < TOLD:
        return slope < 0
    follows = record.mask[1:] & record.mask[:-1]
    follows[record.starts[1:] - 1] = False
    du, dy = np.diff(record.input)[follows], np.diff(record.output)[follows]
    return bool(_correlation(du, dy) < -3 / np.sqrt(max(len(du), 1)))


def slack(record: Record) -> tuple[float, ...]:
    """The output at which a record lies on its floor for a twentieth of its rows or more, if it does.

    That of a falling output's negative is its ceiling.
    """
    y = record.output[record.mask] * (-1 if output_falls(record) else 1)
    least = np.quantile(y, 0.01)
    down = y[y < least + HELD * np.ptp(y)]
    return (float(np.median(down)),) if len(down) > 0.05 * len(y) else ()


def _correlation(u: np.ndarray, y: np.ndarray) -> float:
    size = float(np.sqrt((u @ u) * (y @ y)))
    return float(u @ y) / size if size else 0.0
