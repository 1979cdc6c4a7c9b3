"""Relaxation times that a record may show, from its sampling step and its length."""

import numpy as np
from jaxtyping import Bool

from hysteresis import Record
from hysteresis.records._cycles import counted_cycles

from ._latest import repeats


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
