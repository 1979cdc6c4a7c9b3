"""First-order reversal curves, found in a record.

From positive saturation the input falls to a reversal b and rises again: y(u | b). With relays of -1
and +1 the curves *are* the material's Everett function, whatever its density,

    E(u, b) = (y(u | b) - y(b | b)) / 2.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import InputError, Record


class Forc(NamedTuple):
    """One first-order reversal curve: the output while the input rises from a reversal.

    - `reversal`: the input where the curve starts.
    - `input`, `output` (samples,): along it; the input rises strictly.
    """

    reversal: float
    input: Float[np.ndarray, " samples"]
    output: Float[np.ndarray, " samples"]


def forc_curves(record: Record) -> tuple[Forc, ...]:
    """The first-order reversal curves of a record, the lowest reversal first.

    The record's top is what lies within a hundredth of the range of its greatest input. Each
    excursion from the top and back gives one curve: it starts at the lowest input reached, and
    holds the samples whose input exceeds all since. Smaller loops on the way down or up are wiped
    out and do no harm. What comes before the first visit to the top is left out, unless it is all
    there is of a sequence: then the sequence is taken to start in positive saturation, or on the
    descent from it.

    Rows outside the mask are left out. Raises `InputError` `too-few-curves` where there is no curve.
    """
    top = float(record.input.max() - np.ptp(record.input) / 100)
    found = []
    for _, rows in record.sequences():
        u, y, used = record.input[rows], record.output[rows], record.mask[rows]
        below = np.append(False, u < top)
        leaves = np.flatnonzero(below[1:] & ~below[:-1])
        if len(leaves) > 1 and leaves[0] == 0:
            leaves = leaves[1:]
        for a, b in pairwise([*leaves, len(u)]):
            lowest = b - 1 - int(np.argmin(u[a:b][::-1]))
            rise = np.arange(lowest, b)
            before = np.maximum.accumulate(np.append(-np.inf, u[rise]))[:-1]
            rise = rise[(u[rise] > before) & used[rise]]
            if len(rise) > 1:
                found.append(Forc(float(u[rise[0]]), u[rise], y[rise]))
    if not found:
        raise InputError(
            "too-few-curves",
            "the record has no first-order reversal curve.",
            place=record.source,
            cause="the input never rises again after a descent from its top.",
            fix="name the column that tells the curves apart (--group COL), or measure such curves.",
        )
    return tuple(sorted(found, key=lambda curve: curve.reversal))


def check_curves(curves: tuple[Forc, ...], least: int) -> None:
    """Raises `InputError` unless there are `least` curves, sorted, with different reversals."""
    reversals = [curve.reversal for curve in curves]
    if len(curves) < least:
        raise InputError(
            "too-few-curves",
            f"{len(curves)} curves where at least {least} are needed.",
            fix="measure more curves, or smooth over fewer.",
        )
    if (k := next((k for k, (a, b) in enumerate(pairwise(reversals)) if b <= a), None)) is not None:
        raise InputError(
            "not-increasing",
            f"the reversals of curves {k} and {k + 1} are {reversals[k]:g} and {reversals[k + 1]:g}.",
            cause="a curve measured twice, or curves that are not sorted.",
            fix="keep one of them, and give the curves with the lowest reversal first.",
        )
