"""Learning from the last cycles alone, where one cycle is repeated and the sample settles."""

import numpy as np

from hysteresis import Record
from hysteresis.records._cycles import counted_cycles

from ._folds import Fold, Parts
from ._speeds import ALIKE, rates_differ

FEWEST = 6
"""Cycles that a record needs for some of them to be enough."""

SEVERAL = 4
"""Cycles of one kind that repeat each other: two show a change, and two more how well it is known."""

LEAST = 3
"""Cycles that are always learnt from."""


def repeats(record: Record, fewest: int = SEVERAL) -> bool:
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
    if not parts.folds or not repeats(record, FEWEST):
        return []
    # Rows in no cycle are a part of their own behind the cycles, and learnt from.
    of_cycles = set(parts.label[record.mask & (record.cycle > 0)].tolist())

    def last(which: tuple[int, ...], count: int | None) -> tuple[int, ...]:
        cycles = [p for p in which if p in of_cycles]
        count = max(LEAST, -(-len(cycles) // 2)) if count is None else count
        return tuple(p for p in which if p not in of_cycles or p in cycles[-count:])

    return [
        parts._replace(
            folds=tuple(Fold(last(fold.train, count), fold.test) for fold in parts.folds),
            kept=last(parts.all, count),
        )
        for count in (None, LEAST)
    ]
