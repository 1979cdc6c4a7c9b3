"""How the output changes from cycle to cycle at the same inputs: drift, and a zero that moves."""

from collections.abc import Iterator
from itertools import compress
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from .._format import quantity
from .._verdict import Note, warning
from ._abstract_record import AbstractRecord
from ._arrays import in_rows
from ._cycles import Cycle, counted_cycles
from ._zero import comparable, zero_drift

ENOUGH = 10_000
"""Cycles that are compared: their rate is known as well as the record tells it."""

FEWEST = 4
"""Cycles of one kind: two of them to see a rate, and two to see how well it is known."""

ALIKE = 0.15
"""By how much of their median range the ends of cycles that repeat each other may differ."""

LEVELS = 32
"""Inputs at which cycles are compared, on both branches."""

CHANCE = 0.01
"""Good records in which a rate passes for more than chance."""

MOVED = 0.15
"""Of the output's range: a zero that moves so far is as grave as an error that is too large to use."""

DRIFTS = 0.05
"""Of the output's range: a steady drift so far is an error in the next run with which no fit passes."""


class Change(NamedTuple):
    """The output of one cycle less that of the cycles before, at the same inputs and on the same branch.

    - `rate`, `error`: a cycle, over the later half of the cycles, and its standard error.
    - `cycles`: how many were compared. `duration`: of one, NaN without time.
    - `moved`: the farthest that the zero has moved from one cycle to another; `first`, `last`: the numbers
      of those cycles.
    """

    rate: float
    error: float
    cycles: int
    duration: float
    moved: float
    first: int
    last: int

    @property
    def is_sure(self) -> bool:
        """Whether the rate is more than chance: by Student's t, since a few cycles tell its error badly."""
        freedom = self.cycles - _later(self.cycles) - 2
        sure = float(scipy.special.stdtrit(freedom, 1 - CHANCE / 2))
        return abs(self.rate) > sure * self.error


def change(record: AbstractRecord) -> Change | None:
    """Compare the cycles of the sequence that has most of one kind; None where there are fewer than four.

    A cycle behind one of another kind is left out: small loops on either branch of a larger one pass the
    same inputs at other outputs, and nothing has drifted.

    Of each cycle the output is read at 32 inputs that all of them pass, on both branches. The mean of its
    differences from the median cycle tells the rate, their median how far the zero has moved: a curve that
    changes its shape leaves the median where it is.
    """
    counted = comparable(record)
    each = (_levels(record, counted, cycles) for cycles in counted_cycles(record, counted))
    found = [one for one in each if one is not None]
    if not found:
        return None
    numbers, apart, duration = max(found, key=lambda one: len(one[0]))
    means, zeros = np.nanmean(apart, axis=1), np.nanmedian(apart, axis=1)
    later = _later(len(means))
    k, y = numbers[later:].astype(float), means[later:]
    k -= k.mean()
    rate = float(k @ y / (k @ k))
    left = y - y.mean() - rate * k
    error = float(np.sqrt(left @ left / (len(k) - 2) / (k @ k)))
    ends = int(np.argmin(zeros)), int(np.argmax(zeros))
    first, last = (int(numbers[at]) for at in sorted(ends))
    moved = float(zeros[max(ends)] - zeros[min(ends)])
    return Change(rate, error, len(means), duration, moved, first, last)


def _later(cycles: int) -> int:
    """The first cycle of the later half, if there are enough in it."""
    return cycles // 2 if cycles >= 2 * FEWEST else 0


def change_warnings(record: AbstractRecord) -> list[Note]:
    """A zero that moves by 15 % of the output's range or drifts surely by 5 %, and its fix."""
    (y,), unit = in_rows(np.isfinite(record.output), record.output), record.output_unit
    span = float(np.ptp(y)) if len(y) else 0.0
    one = change(record)
    if one is not None and abs(one.moved) >= MOVED * span:
        moved, where = one.moved, f"from cycle {one.first} to cycle {one.last}"
    elif (drift := zero_drift(record)) is not None and abs(drift.size) >= DRIFTS * span:
        moved = drift.size
        where = f"from {record.place(drift.first)} to {record.place(drift.last)}"
    else:
        return []
    percent = 100 * abs(moved) / span
    said = (
        f"The zero of the output moves by {quantity(moved, unit, 3)}, {percent:.0f} % of its range,"
        f" {where} at the same inputs. A model of new runs has no such drift: let the sensor warm up,"
        " correct its zero, fit the later cycles alone, or keep the drift of this run (--drift keep)."
    )
    return [warning("zero-moves", said, {"moved": moved, "percent": percent})]


def _levels(
    record: AbstractRecord, counted: Bool[np.ndarray, " samples"], cycles: list[Cycle]
) -> tuple[Int[np.ndarray, " cycles"], Float[np.ndarray, "cycles inputs"], float] | None:
    """Numbers of cycles alike, the output of each less that of the median one, and how long one lasts."""
    u, y = record.input, record.output
    if len(cycles) < FEWEST:
        return None
    if len(cycles) > ENOUGH:
        cycles = [cycles[k] for k in np.linspace(0, len(cycles) - 1, ENOUGH).astype(int)]

    def inside(some: list[Cycle]) -> Iterator[Int[np.ndarray, " rows"]]:
        return (one.rows.start + np.flatnonzero(counted[one.rows]) for one in some)

    ends = np.array([(u[own].min(), u[own].max()) for own in inside(cycles)])
    middle = np.median(ends, axis=0)
    alike = (np.abs(ends - middle) <= ALIKE * (middle[1] - middle[0])).all(1)
    alike[1:] &= alike[:-1].copy()
    if alike.sum() < FEWEST:
        return None
    cycles = list(compress(cycles, alike))
    low, high = ends[alike, 0].max(), ends[alike, 1].min()
    level = low + (high - low) * (np.arange(LEVELS) + 0.5) / LEVELS
    read = np.full((len(cycles), 2, LEVELS), np.nan)
    for out, own in zip(read, inside(cycles), strict=True):
        for side, sign in zip(out, (1, -1), strict=True):
            leg = own[record.branch[own] == sign]
            if len(leg) > 1:
                leg = leg[np.argsort(u[leg], kind="stable")]
                side[:] = np.interp(level, u[leg], y[leg])
    both = read.reshape(len(cycles), -1)
    both = both[:, np.isfinite(both).all(0)]
    if not both.size:
        return None
    duration = np.nan
    if record.time is not None:
        duration = float(np.median([np.ptp(record.time[own]) for own in inside(cycles)]))
    numbers = np.array([one.number for one in cycles])
    return numbers, both - np.median(both, axis=0), duration
