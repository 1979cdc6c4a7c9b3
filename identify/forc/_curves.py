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
    """Find the first-order reversal curves of a record; they come with the lowest reversal first.

    The top of a record is everything within a hundredth of the input's range from its maximum. Each
    excursion from the top and back gives one curve: it starts at the lowest input reached, and holds the
    samples whose input exceeds all earlier ones of the rise. Smaller loops on the way are wiped out and do
    no harm. Rows before the first visit to the top are excluded, unless a sequence has no others: then it
    is taken to start in positive saturation, or on the descent from it.

    **Arguments:** `record`: input and output in any units; rows outside its mask are excluded.

    Raises `InputError` `too-few-curves` if there is no curve.

    Source: Mayergoyz, Mathematical models of hysteresis and their applications (2003), section 1.2.

    **Example:**

        >>> [curve.reversal for curve in identify.forc_curves(loops)]
        [0.0, 0.0, 0.0, 4.0, 8.0, 12.0, 16.0]
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
            "the record does not contain a first-order reversal curve.",
            place=record.source,
            cause="the input never rises again after a descent from its top.",
            fix="name the column that tells the curves apart (--group COL), or measure such curves.",
        )
    return tuple(sorted(found, key=lambda curve: curve.reversal))


def check_curves(curves: tuple[Forc, ...], least: int) -> None:
    """Raise `InputError` unless there are `least` curves, sorted, with different reversals."""
    reversals = [curve.reversal for curve in curves]
    if len(curves) < least:
        raise InputError(
            "too-few-curves",
            f"there are {len(curves)} curves, and at least {least} are needed.",
            fix="measure more curves, or smooth over fewer.",
        )
    if (k := next((k for k, (a, b) in enumerate(pairwise(reversals)) if b <= a), None)) is not None:
        raise InputError(
            "not-increasing",
            f"the reversals of curves {k} and {k + 1} are {reversals[k]:g} and {reversals[k + 1]:g}.",
            cause="a curve was measured twice, or the curves are not sorted.",
            fix="keep one of them, and give the curves with the lowest reversal first.",
        )
