"""Columns without names: which of them are measurements of their own, by their shape alone."""

import numpy as np

from hysteresis import InputError, Table

from ._column_pairs import Column, correlation, is_scaled, rank_correlation

LEAST = 20
"""Rows from which a shape can be told."""
RATE = 0.99
"""Correlation of a rate with the slope of what it is the rate of."""
FOLLOWS = 0.3


def by_shape(
    table: Table, columns: list[Column], time: str | None, asked: set[str]
) -> list[Column]:
    """The two columns that follow each other most, beside those `asked` for.

    Copies in another unit, also one that stood still for a while, and rates of other columns are left out.

    Raises `InputError` `no-header` where nothing follows anything.
    """
    if len(table.line) < LEAST:
        said = f"{len(table.line)} rows are too few to tell them by their shape."
        raise no_header(table.path, said)
    kept: list[Column] = []
    # Of copies the one that never stands; values that a logger has scaled follow those it has read.
    stands = [float(np.mean(np.diff(c.x) == 0)) for c in columns]
    for k in sorted(range(len(columns)), key=lambda k: (stands[k], -k)):
        c = columns[k]
        twin = any(_scaled_where_both_move(c.x, other.x) for other in kept)
        if c.name in asked or not twin:
            kept.append(c)
    kept = [c for c in columns if c in kept]
    if time is not None:
        t = table.columns[time]
        slopes: list[np.ndarray] = []
        moving = []
        for c in kept:  # of an oscillation each column is the slope of the other: the first counts
            if c.name in asked or not any(abs(correlation(s, c.x)) > RATE for s in slopes):
                moving.append(c)
                slopes.append(_slope(t, c.x))
        kept = moving
    found = [c for c in kept if c.name in asked]
    if len(kept) < 3:
        return kept
    scored = [
        (abs(rank_correlation(a.x, b.x)), -j, a, b)
        for j, b in enumerate(kept) for a in kept[:j]
        if all(c in (a, b) for c in found)
    ]  # fmt: skip
    best, _, a, b = max(scored, key=lambda one: one[:2], default=(0.0, 0, kept[0], kept[1]))
    if best < FOLLOWS:
        raise no_header(table.path, "No two columns follow each other.")
    return [a, b]


def _scaled_where_both_move(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether one is a straight line of the other in the rows between which both move, if most rows are."""
    moves = (np.diff(x, prepend=np.nan) != 0) & (np.diff(y, prepend=np.nan) != 0)
    return bool(moves.mean() > 0.5) and is_scaled(x[moves], y[moves])


def no_header(place: str, problem: str) -> InputError:
    """The file has no header, and its numbers do not say what they are."""
    return InputError(
        "no-header",
        f"The first line contains numbers, so the columns have no names. {problem}",
        place=place,
        fix="Write a line above it that names each column with its unit, as in "
        "time (s),force (N),displacement (mm).",
    )


def _slope(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """dx/dt by differences (n,); NaN where the clock stands still."""
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.gradient(x) / np.gradient(t)
    return np.where(np.isfinite(slope), slope, np.nan)
