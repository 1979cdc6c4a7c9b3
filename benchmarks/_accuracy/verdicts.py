"""Verdicts beside what the fits are worth: the errors of each level, and how many a baseline beats."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import identify

from .._measure import Row, judged, noted

LEVELS = ("PASS", "CAUTION", "FAIL")


class Judged(NamedTuple):
    """A fit's verdict, and what the test rows say, which no fit has seen.

    - `error`: of the fit, `other`: of its best `baseline`, in per cent of the range of those rows.
    - `beaten`: whether a baseline is better beyond the standard error of the difference.
    """

    what: str
    level: str
    error: float
    baseline: str
    other: float
    beaten: bool


def is_beaten(
    ours: Float[np.ndarray, " blocks"], baselines: Iterable[Float[np.ndarray, " blocks"]]
) -> bool:
    """Whether any baseline is better on the test rows by more than the standard error of the difference."""
    found = (identify.internal.root_difference(theirs, ours) for theirs in baselines)
    return any(one is not None and one.value > one.error for one in found)


def calibration(found: Sequence[Judged]) -> list[Row]:
    """Of each level: how many fits, their median error, how many are beaten; none that PASS may be."""
    rows: list[Row] = []
    for level in LEVELS:
        of_level = [one for one in found if one.level == level]
        if not of_level:
            continue
        errors = [one.error for one in of_level]
        ends = f"{min(errors):.2g} to {max(errors):.2g} %"
        what = f"{level}: median error of {len(errors)} fits, per cent ({ends})"
        rows.append(noted(what, float(np.median(errors))))
        beaten = [one for one in of_level if one.beaten]
        names = "; ".join(
            f"{one.what} {one.error:.2g}, {one.baseline} {one.other:.2g}" for one in beaten
        )
        what = f"{level}: verdicts though a baseline is better" + (f" ({names})" if names else "")
        count = float(len(beaten))
        rows.append(judged(what, count, 0) if level == "PASS" else noted(what, count))
    return rows
