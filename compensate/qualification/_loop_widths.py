"""How wide the loops of a record are, and how much of that a compensator leaves."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import Record
from hysteresis.records._cycles import counted_cycles

LEVELS = 32
"""Equal parts of what both branches of a cycle pass, in each of which their gap is taken."""


class Loop(NamedTuple):
    """How wide the loops are, in the input's unit, as means over `cycles`; NaN where there are none.

    - `before`: between the inputs of both branches at one output.
    - `after`: between the errors of both branches at one input.
    """

    before: float
    after: float
    cycles: int

    @property
    def ratio(self) -> float:
        """Part of the width that is left: 0 after a perfect compensator; NaN where no loop was."""
        return self.after / self.before if self.before > 0 else float("nan")


def loop_widths(record: Record, estimate: Float[np.ndarray, " samples"]) -> Loop:
    """How wide the loops are before and after a compensator, e = input - estimate:

        before = mean over cycles and y of |u_rising(y) - u_falling(y)|
        after  = mean over cycles and u of |e_rising(u) - e_falling(u)|

    over `LEVELS` equal parts of the y, or u, that both branches of a cycle pass; each branch's value is
    the mean over the part of its rows joined by straight lines. Where y turns with u both widths are the
    loop's area over a range, so a straight line through the ends of a closed loop leaves all: a ratio of
    1. Noise of the output widens what is left. Only counted rows of complete cycles are taken.
    """
    u, y, error = record.input, record.output, record.input - estimate
    found = []
    for cycles in counted_cycles(record, record.mask, share=0.0):
        for _, rows, _ in cycles:
            inside = rows.start + np.flatnonzero(record.mask[rows])
            legs = [inside[record.branch[inside] == sign] for sign in (1, -1)]
            if min(map(len, legs)) < 3:
                continue
            widths = _width(y, u, legs), _width(u, error, legs)
            if np.isfinite(widths).all():
                found.append(widths)
    before, after = np.mean(found, axis=0).tolist() if found else [float("nan")] * 2
    return Loop(before, after, len(found))


def _width(level: np.ndarray, value: np.ndarray, legs: list[np.ndarray]) -> float:
    """Mean distance between the values of two legs at one level; NaN where they share none."""
    low, high = max(level[x].min() for x in legs), min(level[x].max() for x in legs)
    if not high > low:
        return float("nan")
    edges = np.linspace(low, high, LEVELS + 1)
    rising, falling = (_means(level[x], value[x], edges) for x in legs)
    return float(np.abs(rising - falling).mean())


def _means(level: np.ndarray, value: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Between each two edges the mean of the values joined by straight lines; ties are averaged."""
    at, which, count = np.unique(level, return_inverse=True, return_counts=True)
    grid = np.union1d(at, edges)
    joined = np.interp(grid, at, np.bincount(which, value) / count)
    steps = np.diff(grid) * (joined[1:] + joined[:-1]) / 2
    area = np.append(0.0, np.cumsum(steps))[np.searchsorted(grid, edges)]
    return np.diff(area) / np.diff(edges)
