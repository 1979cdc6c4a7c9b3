"""Which figures of their loops two groups of specimens differ in, and how many specimens would tell."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import ndtri

from hysteresis import InputError
from hysteresis.records._loop_table import LoopTable

from .._levels import CHANCE, CONFIDENCE
from ._change import holm

FEW = "fewer than two specimens of a group tell it"


class LoopDifference(NamedTuple):
    """A figure in two groups: their means over specimens, the second less the first, and its error.

    - `p`: the probability of a difference this large if there was none (Welch), corrected for the number of
      figures (Holm). `needed`: specimens a group that would show this difference in 80 of 100 cases at the
      same level without correction; None without a difference. `reason`: why nothing is told.
    """

    name: str
    unit: str
    one: float | None
    other: float | None
    difference: float | None
    error: float | None
    p: float | None
    needed: int | None
    reason: str = ""

    @property
    def clear(self) -> bool:
        """Whether the difference is statistically significant."""
        return self.p is not None and self.p < CHANCE


def compare_loops(
    one: Sequence[LoopTable], other: Sequence[LoopTable]
) -> tuple[LoopDifference, ...]:
    """The figures of two groups of specimens; each specimen counts once, by its mean over the full loops.

    **Arguments:**

    - `one`, `other`: a table for each specimen, of one kind.

    **Raises:** `InputError` `too-few-fits` where a group is empty, `wrong-unit` where units differ.

    **Example:**

        >>> tables = [fit.loops() for fit in specimens]
        >>> found = identify.compare_loops(tables[:2], tables[1:])
        >>> found[0].name, found[0].clear
        ('duration', False)
    """
    if not (one and other):
        raise InputError(
            "too-few-fits", "A group has no specimen.", fix="Give one or more of each."
        )
    told = [[{s.name: s for s in table.summary} for table in group] for group in (one, other)]
    found = []
    for name in (n for n in one[0].names if all(n in s for group in told for s in group)):
        x, y = (
            np.array([s[name].value for s in group if s[name].value is not None], float)
            for group in told
        )
        unit, *others = sorted({s[name].unit for group in told for s in group})
        if others:
            raise InputError(
                "wrong-unit", f"{name} is in {unit} and in {others[0]}.",
                fix="Give both groups in the same units.",
            )  # fmt: skip
        if min(len(x), len(y)) < 2:
            found.append(LoopDifference(name, unit, None, None, None, None, None, None, FEW))
            continue
        squares = np.array([np.var(z, ddof=1) for z in (x, y)])
        difference, error = float(y.mean() - x.mean()), np.sqrt(squares @ [1 / len(x), 1 / len(y)])
        p, needed = 1.0, None
        if difference:
            welch = (
                scipy.stats.ttest_ind_from_stats
            )  # of figures: readings that agree give no warning
            sizes = (part for z in (x, y) for part in (z.mean(), z.std(ddof=1), len(z)))
            p = float(welch(*sizes, equal_var=False).pvalue) if error else 0.0
            each = squares.sum() / difference**2
            needed = max(2, int(np.ceil(each * (ndtri(1 - CHANCE / 2) + ndtri(CONFIDENCE)) ** 2)))
        means = float(x.mean()), float(y.mean())
        found.append(LoopDifference(name, unit, *means, difference, float(error), p, needed))
    tested = [k for k, row in enumerate(found) if row.p is not None]
    corrected = holm(np.array([found[k].p for k in tested], float)) if tested else []
    for k, p in zip(tested, corrected, strict=True):
        found[k] = found[k]._replace(p=float(p))
    return tuple(found)
