"""Columns that were logged in turn, each on rows of its own: several topics under one clock."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from ._column_pairs import Column

TOGETHER = 0.1
"""Share of the rows of the emptier column up to which two columns count as never there together."""


def logged_in_turn(columns: Mapping[str, Column]) -> set[str]:
    """The names of columns with no rows in common with another one that is logged in the same stretch."""
    gaps = {name: np.isfinite(c.x) for name, c in columns.items() if c.missing > 0}
    found: set[str] = set()
    for (a, x), (b, y) in combinations(gaps.items(), 2):
        rows = np.flatnonzero(x), np.flatnonzero(y)
        if (x & y).sum() > TOGETHER * min(map(len, rows)):
            continue
        both = min(rows[0][-1], rows[1][-1]) - max(rows[0][0], rows[1][0])
        if 2 * both > min(np.ptp(rows[0]), np.ptp(rows[1])) > 0:
            found |= {a, b}
    return found


def filled(column: Column) -> Column:
    """The column with its gaps interpolated linearly from row to row."""
    good = np.flatnonzero(np.isfinite(column.x))
    return column._replace(x=np.interp(np.arange(len(column.x)), good, column.x[good]), missing=0.0)
