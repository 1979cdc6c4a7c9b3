"""What a record shows of the sense of its loops, the sign of its slope and its first states."""

import numpy as np

from hysteresis import Record
from hysteresis.records._excitation import loop_direction

TOLD = 0.3
"""Loops tell their direction where so much of their area has it."""

SLIGHT = 0.3
"""A correlation of input and output up to which loops outweigh the slope."""

SLACK = 0.02
"""Part of the output's range within which it lies on its floor."""


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
    if abs(slope) > SLIGHT or abs(loop_direction(record)) < TOLD:
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
    down = y[y < least + SLACK * np.ptp(y)]
    return (float(np.median(down)),) if len(down) > 0.05 * len(y) else ()


def _correlation(u: np.ndarray, y: np.ndarray) -> float:
    size = float(np.sqrt((u @ u) * (y @ y)))
    return float(u @ y) / size if size else 0.0
