"""Views of long series, by level of detail: what can be seen of a million rows on a screen.

Over time, each of so many pieces of the view shows the rows with its least and greatest input and output,
so that no peak is lost. Of loops every cell of a raster that a row falls into shows one of its rows.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hysteresis import Record

from ..figures._base import thin

ALL = 6000
"""Rows of a view over time, about, and up to which it shows all of them."""
RASTER = (360, 240)
"""Cells of a raster of loops, along input and output."""

USED, EXCLUDED, HELD_OUT, GAP = 0, 1, 2, 8
"""Of a row: fitted, excluded, held out; and 8 more where a sequence begins at it."""


class Series(NamedTuple):
    """The rows of a measurement in the file's order.

    - `x`: (n,) the clock, which never goes back, or the number of the row.
    - `u`, `y`: (n,) input and output; not a number where they are missing.
    - `line`: (n,) lines of the file.
    - `state`: (n,) see `USED`.
    """

    x: np.ndarray
    u: np.ndarray
    y: np.ndarray
    line: np.ndarray
    state: np.ndarray

    def rows(self, low: float | None, high: float | None) -> slice:
        """The rows between two values of the clock, with a neighbour at both ends."""
        first = 0 if low is None else int(np.searchsorted(self.x, low, "left")) - 1
        last = len(self.x) if high is None else int(np.searchsorted(self.x, high, "right")) + 1
        return slice(max(first, 0), min(last, len(self.x)))

    def chosen(
        self, low: float | None, high: float | None, box: Sequence[float] | None
    ) -> np.ndarray:
        """(n,) bool: the rows between two values of the clock, and in a box of the loops.

        `box`: least and greatest input, least and greatest output.
        """
        first, last = -np.inf if low is None else low, np.inf if high is None else high
        found = (self.x >= first) & (self.x <= last)
        return found if box is None else found & in_box(self.u, self.y, box)

    def take(self, rows: np.ndarray) -> np.ndarray:
        """(5, m): clock, input, output, line and state of the rows."""
        return np.stack([np.asarray(column[rows], float) for column in self])


def as_bytes(*parts: np.ndarray) -> bytes:
    """Rows as float64, column after column, one part behind the other."""
    return b"".join(np.ascontiguousarray(part, "<f8").tobytes() for part in parts)


def in_box(u: np.ndarray, y: np.ndarray, box: Sequence[float]) -> np.ndarray:
    """(n,) bool: inputs and outputs within a box, whose edges belong to it."""
    return (u >= box[0]) & (u <= box[1]) & (y >= box[2]) & (y <= box[3])


def clock_of(record: Record) -> np.ndarray:
    """(n,) the clock of a record for a plot; the number of the row where it has none or goes back."""
    if record.time is None or np.any(np.diff(record.time) < 0):
        return np.arange(1.0, len(record) + 1)
    return record.time


def over_time(series: Series, low: float | None, high: float | None) -> np.ndarray:
    """(5, m) rows of a stretch of time that show each of its peaks."""
    rows = series.rows(low, high)
    return series.take(peaks((series.u, series.y), rows))


def peaks(columns: tuple[np.ndarray, ...], rows: slice) -> np.ndarray:
    """Indices of some rows, with the extremes of each column among them."""
    return rows.start + thin(ALL, *(column[rows] for column in columns))


def of_loops(
    series: Series, low: float | None, high: float | None, box: Sequence[float] | None
) -> tuple[np.ndarray, bool]:
    """(5, m) rows of the loops in a stretch of time, and whether they are all, in order, to join by lines.

    `box`: least and greatest input, least and greatest output that are seen.
    """
    rows = series.rows(low, high)
    u, y = series.u[rows], series.y[rows]
    seen = np.isfinite(u) & np.isfinite(y)
    if box is not None:
        seen &= in_box(u, y, box)
    count = int(seen.sum())
    if count <= ALL:
        if box is not None and count:  # the neighbours, so that lines leave the box
            seen[:-1] |= seen[1:]
            seen[1:] |= seen[:-1]
        chosen = rows.start + np.flatnonzero(seen)
        found = series.take(chosen)
        found[4] += GAP * (np.diff(chosen, prepend=chosen[:1] - 1) > 1)
        return found, True
    cell = np.zeros(count, np.int64)
    for x, n in zip((u[seen], y[seen]), RASTER, strict=True):
        least, span = x.min(), float(np.ptp(x)) or 1.0
        cell = cell * n + np.minimum(((x - least) * (n / span)).astype(np.int64), n - 1)
    first = np.full(RASTER[0] * RASTER[1], -1, np.int64)
    first[cell] = np.flatnonzero(seen)
    return series.take(rows.start + np.sort(first[first >= 0])), False
