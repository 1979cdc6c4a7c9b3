"""What a baseline reads of the past of an input: which way it went last."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Int

from hysteresis import Record
from hysteresis.records._cycles import noise_level

from ..records._new_record import same_inputs


def dead_band(record: Record) -> float:
    """How far an input must come back before its direction has changed: eight times its noise."""
    return 8 * float(np.median([noise_level(record.input[rows]) for _, rows in record.sequences()]))


class OncePerInput:
    """What is made of a record's inputs, once for all records that differ at most in the rows that count.

    Memory takes most of the time of a baseline, and several read the same.
    """

    def __init__(self, made: Callable[[Record], np.ndarray], columns: tuple[str, ...] = ()) -> None:
        self.made, self.columns = made, columns
        self.known: list[tuple[Record, np.ndarray]] = []

    def __call__(self, record: Record) -> np.ndarray:
        for one, found in self.known:
            if one is record or same_inputs(one, record, self.columns):
                return found
        self.known.append((record, self.made(record)))
        return self.known[-1][1]


def branches_of(train: Record) -> OncePerInput:
    """`directions` with the dead band of a record."""
    band = dead_band(train)
    return OncePerInput(lambda record: directions(record, band))


def directions(record: Record, band: float) -> Int[np.ndarray, " samples"]:
    """+1 where the input rose last, -1 where it fell, +1 before its first move.

    It turns when it has come back by more than `band`, which is known only then: the rows between a peak
    and that moment still rise.
    """
    found = np.ones(len(record), int)
    for _, rows in record.sequences():
        u = record.input[
            rows
        ].tolist()  # a loop over Python floats is five times faster than NumPy's
        sign, extreme, turned = 1, u[0], []
        moved = False
        for x in u:
            if (x - extreme) * sign >= 0:
                moved |= x != extreme
                extreme = x
            elif (extreme - x) * sign > band or not moved:
                sign, extreme, moved = -sign, x, True
            turned.append(sign)
        found[rows] = turned
    return found
