"""Readings that are probably not what they seem: clipped, tared within the run, swapped, turned in sign."""

from typing import NamedTuple

import numpy as np

from .._format import duration, quantity
from .._note import Note, warning
from ._abstract_record import AbstractRecord
from ._cycles import loop_area, noise_level
from ._units import FORCES, LENGTHS
from ._zero_jumps import zero_jumps

MANY = 8
"""Samples at a limit that are too many for a peak."""

FURTHER = 2
"""Times the way of the input over which the output stays as it is elsewhere, as behind a backlash."""


class Clipped(NamedTuple):
    """A series stuck at its largest or smallest value: which, where, and that value."""

    role: str
    rows: np.ndarray
    limit: float


def loop_direction(record: AbstractRecord) -> float:
    """Which way the loops turn, in [-1, 1]: +1 counter-clockwise (the output lags), -1 clockwise.

    `sum of int D du / sum of int |D| du`, D(u) = y_unloading(u) - y_loading(u)

    over the loops of `loop_area`. Crossed loops fall between the bounds, pure noise near 0; 0 where
    nothing closes.

    **Example:**

        >>> round(hysteresis.loop_direction(record), 2)
        1.0
    """
    net, total = _loops(record)
    return net / total if total else 0.0


def clipped(record: AbstractRecord) -> list[Clipped]:
    """Where input or output is stuck at a limit while the other one moves.

    Stuck: at least 1 % of the rows and eight of them. The output is clipped where the input moves by
    2 % of its range, and twice as far as where the output stays as it is elsewhere, in steps of an encoder
    or behind a backlash; the input where, in one run of rows, the output goes 2 % of its range beyond
    both ends and comes back: in a hold it creeps one way, and single readings err. Zero and the value of
    the first row are the rest, not a limit.
    """
    u, y, found = record.input, record.output, []
    for role, x in (("output", y), ("input", u)):
        for limit in (np.nanmax(x), np.nanmin(x)) if np.isfinite(x).any() else ():
            rows = np.flatnonzero(x == limit)
            if limit in (0.0, x[0]) or len(rows) < max(MANY, 0.01 * len(x)):
                continue
            if role == "output":
                at, elsewhere = _ways_at_rest(record, limit)
                stuck = np.ptp(u[rows]) > 0.02 * np.ptp(u) and at > FURTHER * elsewhere
            else:
                least = max(0.02 * np.nanmax(y) - 0.02 * np.nanmin(y), 8 * noise_level(y))
                stuck = max(_bulge(y[run]) for run in _runs(record, rows)) > least
            if stuck:
                found.append(Clipped(role, rows, float(limit)))
    return found


def suspicions(record: AbstractRecord) -> list[Note]:
    """What is probably wrong with the readings, each a sentence with its fix and its code."""
    found = []
    for role, rows, limit in clipped(record):
        runs = _runs(record, rows)
        longest = max(runs, key=len)
        others = f" and {len(runs) - 1} more runs" if len(runs) > 1 else ""
        other = "input" if role == "output" else "output"
        at = quantity(limit, getattr(record, f"{role}_unit"))
        mend = (
            f"mask or censor (--na-values {limit:g} --nan omit), or measure with a wider range"
            if role == "output"
            else "measure with a wider range, or leave those rows' cycles out (--where)"
        )
        said = (
            f"{len(rows) / len(record):.1%} of the {role} at {at}: clipped, {record.lines(longest)}"
            f"{others} while the {other} moves; {mend}."
        )
        found.append(warning("saturation", said))
    return [*found, *_zero_jumps(record), *_created_energy(record)]


def _zero_jumps(record: AbstractRecord) -> list[Note]:
    """One note on the jumps of the zero, with the first of them."""
    jumps = zero_jumps(record)
    if not jumps:
        return []
    row, size = jumps[0]
    at = record.lines(np.array([row]))
    if record.time is not None:
        at += f" ({duration(float(record.time[row]), record.time_unit)})"
    more = f", and at {len(jumps) - 1} more rows" if jumps[1:] else ""
    said = (
        f"The zero of the output jumps by {quantity(size, record.output_unit)} at {at}{more}, while the "
        "input moves on: with the jump taken out, the branches before and behind it lie on each other. "
        "Fit the rows on one side of it alone (--exclude-lines FIRST-LAST), or correct the file."
    )
    return [warning("zero-jump", said)]


def _created_energy(record: AbstractRecord) -> list[Note]:
    """Loops of force over displacement that give more energy than they take."""
    units = record.input_unit, record.output_unit
    to_force = units[0] in LENGTHS and units[1] in FORCES
    if not (to_force or (units[0] in FORCES and units[1] in LENGTHS)):
        return []
    net, total = _loops(record)
    good = np.isfinite(record.output)
    u, y = record.input[good], record.output[good]
    if not (np.ptp(u) and np.ptp(y)):
        return []
    # Force over displacement takes energy clockwise.
    taken = (-net if to_force else net) / max(record.n_cycles, 1)
    # Where loops are thin or crossed a small lag between the channels turns them.
    if taken > -0.01 * np.ptp(u) * np.ptp(y) or abs(net) < 0.5 * total:
        return []
    cause, mend = "columns swapped, or a lag between them", "exchange --input and --output"
    if np.corrcoef(u, y)[0, 1] < 0:
        cause, mend = "the sign of one column is turned", "turn it"
    force, length = units[::-1] if to_force else units
    said = (
        f"Loops create energy ({taken:.3g} {force} {length} a cycle): no specimen does. {cause}? If"
        f" so, {mend}."
    )
    return [warning("energy-created", said)]


def _loops(record: AbstractRecord) -> tuple[float, float]:
    parts = [
        loop_area(record.input[s], record.output[s], record.mask[s]) for _, s in record.sequences()
    ]
    net, total = np.sum(parts, axis=0)
    return float(net), float(total)


def _runs(record: AbstractRecord, rows: np.ndarray) -> list[np.ndarray]:
    """Rows in pieces that follow each other in one sequence."""
    cut = (np.diff(rows) > 1) | np.isin(rows[1:], record.starts)
    return np.split(rows, np.flatnonzero(cut) + 1)


def _ways_at_rest(record: AbstractRecord, limit: float) -> tuple[float, float]:
    """How far the input moves at most while the output stays at `limit`, and while it stays elsewhere."""
    u, y = record.input, record.output
    first = np.flatnonzero(np.append(True, np.diff(y) != 0))
    first = np.union1d(first, record.starts)
    way = np.maximum.reduceat(u, first) - np.minimum.reduceat(u, first)
    at = y[first] == limit
    return float(way[at].max(initial=0.0)), float(way[~at].max(initial=0.0))


def _bulge(y: np.ndarray) -> float:
    """How far a quarter of a series lies beyond both its ends, on one side."""
    ends = y[[0, -1]]
    low, high = np.quantile(y, [0.25, 0.75])
    return float(max(high - ends.max(), ends.min() - low))
