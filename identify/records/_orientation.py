"""What a record shows of the sense of its loops, the sign of its slope and its first states."""

import numpy as np

from hysteresis import Record, loop_direction


def orientations(record: Record) -> tuple[bool, ...]:
    """`leading` values worth trying: one where the loops tell their direction, else both.

    Where the output falls, they are those of its negative, whose loops turn the other way.
    """
    direction = loop_direction(record) * (-1 if output_falls(record) else 1)
    if abs(direction) > 0.3:
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
    """
    sequence = np.zeros(len(record), int)
    sequence[record.starts[1:]] = 1
    run = np.cumsum(sequence) * (record.cycle.max() + 1) + record.cycle
    u, y, run = record.input[record.mask], record.output[record.mask], run[record.mask]
    _, run, rows = np.unique(run, return_inverse=True, return_counts=True)
    u, y = (x - (np.bincount(run, x) / rows)[run] for x in (u, y))
    return bool(u @ y < 0)
