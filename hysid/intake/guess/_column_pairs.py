"""Scores of column pairs: which quantities, or without names which shapes, make a loop."""

from collections.abc import Mapping
from itertools import combinations, pairwise, permutations
from typing import NamedTuple

import numpy as np

from hysteresis import InputError
from hysteresis._format import SAID
from hysteresis.records._cycles import turning_points
from hysteresis.records._table import Table
from hysteresis.records._units import Kind, kind_of, unit_of

_PLAIN = ("N", "mm", "V", "A", "Pa")
SENSED = ("voltage", "resistance", "capacitance", "sensor", "current")
PAIRS: dict[tuple[str, ...], float] = {
    **{tuple(pair.split()): usual for pair, usual in SAID["pairs"].items()},
    **{(one, sensed): usual for one, usual in SAID["sensed"].items() for sensed in SENSED[:4]},
}
"""Input, output, and how usual the pair is."""


LARGEST = 1e300
"""No measurement is larger."""

SIX_DIGITS = 1e-5
"""What two columns of six digits each may be off together, relative to the largest value."""

COARSEST = 0.01
"""Part of its range to which a column is told that can be known for a copy."""

TURNS_BACK = -0.3
"""Correlation of neighbouring second differences: of white noise -2 / 3, of a bend positive."""

AT_REST = 0.01
"""Part of its range within which a column is at zero: the width of a level of `held`."""

STRENGTH, FLUX = ("A/m", "kA/m", "Oe", "kOe"), ("T", "mT", "G", "kG", "Gs")
"""Units of a field that drives, and of the flux density that answers."""


class Column(NamedTuple):
    """A column of numbers: its name, unit and kind, its cells (n,), and the share that is missing."""

    name: str
    unit: str
    kind: Kind
    x: np.ndarray
    missing: float


class Pair(NamedTuple):
    """Input, output, the score of the pair, in [0, 1], and how far one follows the other, by ranks."""

    input: Column
    output: Column
    score: float
    follows: float


def columns_of(table: Table) -> dict[str, Column]:
    """The columns of numbers by name; columns of words or without a value are skipped."""
    found = {}
    for name, x in table.columns.items():
        if x.dtype.kind != "f":
            continue
        x = np.where(np.abs(x) <= LARGEST, x, np.nan)
        if not np.isfinite(x).any():
            continue
        unit = unit_of(name, table.units.get(name))
        missing = float(np.mean(~np.isfinite(x)))
        found[name] = Column(name, unit, kind_of(name, unit), x, missing)
    return found


def pairs(columns: list[Column], clock: np.ndarray | None = None) -> list[Pair]:
    """Pairs of an input and an output, the best first; no copies of each other.

    A pair's score is the product of how usual it is, how sure the kinds are, how far one column follows the
    other (the rank correlation), and the shares of its rows in which both are measured and have a time of
    the `clock` (n,).
    """
    found = []
    for a, b in permutations(columns, 2):
        usual = PAIRS.get((a.kind.name, b.kind.name), 0.0)
        if a.kind.name == b.kind.name == "field" and a.unit in STRENGTH and b.unit in FLUX:
            usual = 0.9
        if usual and not is_scaled(a.x, b.x):
            follows = abs(rank_correlation(a.x, b.x))
            sure = a.kind.sure * b.kind.sure * (0.5 if a.kind.commanded else 1.0)
            sure *= 0.5 if b.kind.commanded else 1.0
            sure *= _shared(a.x, b.x, clock)
            found.append(Pair(a, b, usual * sure * (0.4 + 0.6 * follows), follows))
    return sorted(found, key=lambda pair: -pair.score)


def _shared(x: np.ndarray, y: np.ndarray, clock: np.ndarray | None) -> float:
    """The share of the rows of the emptier column where both are numbers, and half of it without times."""
    both = np.isfinite(x) & np.isfinite(y)
    rows = min(np.isfinite(x).sum(), np.isfinite(y).sum())
    share = float(both.sum() / rows) if rows else 0.0
    if clock is None or not both.any():
        return share
    return share * (0.5 + 0.5 * float(np.isfinite(clock[both]).mean()))


def rank_correlation(x: np.ndarray, y: np.ndarray, most: int = 4000) -> float:
    """Spearman's, over at most so many rows; 0 where one does not move."""
    good = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    good = good[:: max(1, len(good) // most)]
    if good.size < 3:
        return 0.0
    a, b = (np.unique(v[good], return_inverse=True)[1].astype(float) for v in (x, y))
    return correlation(a, b)


def correlation(x: np.ndarray, y: np.ndarray) -> float:
    """Pearson's, over the rows where both are numbers; 0 where one does not move."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if len(x) < 3 or not (np.ptp(x) and np.ptp(y)):
        return 0.0
    # Of order one: squares of tiny numbers vanish, and those of huge ones overflow.
    return float(np.corrcoef(x / np.abs(x).max(), y / np.abs(y).max())[0, 1])


def leftover(u: np.ndarray, y: np.ndarray, branch: np.ndarray, bins: int = 50) -> float:
    """Part of y that its input u and the branch do not explain, relative to the range of y.

    `rms(y - line through y in the bin of u on that branch) / range(y)`
    """
    good = np.isfinite(u) & np.isfinite(y)
    u, y, branch = u[good], y[good], branch[good]
    span, height = np.ptp(u) if u.size else 0.0, np.ptp(y) if y.size else 0.0
    if not (span and height):
        return 1.0
    cell = np.minimum((bins * (u - u.min()) / span).astype(int), bins - 1) + bins * (branch > 0)
    count = np.maximum(np.bincount(cell, minlength=2 * bins), 1)
    u, y = (x - (np.bincount(cell, x, 2 * bins) / count)[cell] for x in (u / span, y / height))
    square = np.bincount(cell, u * u, 2 * bins)
    slope = np.bincount(cell, u * y, 2 * bins) / np.maximum(square, 1e-12)
    return float(np.sqrt(np.mean((y - slope[cell] * u) ** 2)))


def rises(x: np.ndarray) -> float:
    """The share of steps that do not go back; 0 where it does not move."""
    step = np.diff(x[np.isfinite(x)])
    return float(np.mean(step >= 0)) if step.size and np.any(step > 0) else 0.0


def usual_step(x: np.ndarray) -> float:
    """The median step; 0 of a single row."""
    step = np.diff(x[np.isfinite(x)])
    return float(np.median(step)) if step.size else 0.0


def held(x: np.ndarray) -> float:
    """The share of rows at the two commonest levels, each a hundredth of the range wide."""
    good = x[np.isfinite(x)]
    span = float(np.ptp(good)) if good.size else 0.0
    if not span:
        return 1.0
    counts = np.sort(np.bincount(np.round(100 * (good - good.min()) / span).astype(int)))
    return float(counts[-2:].sum() / good.size)


def worked(x: np.ndarray) -> np.ndarray:
    """The rows of a column without its rests at zero, where it leaves them and comes back: a load that is
    taken off is not held."""
    good = x[np.isfinite(x)]
    rests = np.abs(good) <= AT_REST * np.ptp(good) if good.size else np.zeros(0, bool)
    return good[~rests] if np.count_nonzero(np.diff(rests)) > 1 else good


def noise(x: np.ndarray) -> float:
    """The median size of the second differences, relative to the range."""
    good = x[np.isfinite(x)]
    span = float(np.ptp(good)) if good.size > 2 else 0.0
    return float(np.median(np.abs(np.diff(good, 2)))) / span if span else np.inf


def unsteadiness(x: np.ndarray) -> float:
    """Noise, where second differences turn back from row to row as those of noise do and those of a bend do
    not, and the smallest step of a column that often stays at one value, relative to the range."""
    good = x[np.isfinite(x)]
    if good.size < 5 or not np.ptp(good):
        return 0.0
    second, stays = np.diff(good, 2), np.mean(np.diff(good) == 0) > 0.2
    step = float(np.diff(np.unique(good)).min() / np.ptp(good)) if stays else 0.0
    return max(step, noise(x) if correlation(second[:-1], second[1:]) < TURNS_BACK else 0.0)


def duplicates(columns: list[Column]) -> list[Column]:
    """The same columns, but only the better one of two that hold one quantity in two units or signs: a line
    of another column is a copy of it.

    Better: a reading before a command, a quantity before a voltage, a unit of its own, the quantity named,
    then SI's units, then positive values; else the first.
    """
    kept: list[Column] = []
    for column in columns:
        twin = next((k for k, other in enumerate(kept) if _same(column, other)), None)
        if twin is None:
            kept.append(column)
        elif _worth(column) > _worth(kept[twin]):
            kept[twin] = column
    return kept


def _same(a: Column, b: Column) -> bool:
    if a.kind.name == b.kind.name:
        return abs(correlation(a.x, b.x)) > 1 - 1e-9 or is_scaled(a.x, b.x)
    return bool({a.kind.name, b.kind.name} & {*SENSED}) and is_scaled(a.x, b.x)


def is_scaled(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether one is a straight line of the other up to the last digit of both, or to six digits."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if len(x) < 3 or not (np.ptp(x) and np.ptp(y)):
        return False
    slope = float(np.polyfit(x - x.mean(), y - y.mean(), 1)[0])
    left = np.abs(y - y.mean() - slope * (x - x.mean()))
    rounding = SIX_DIGITS * np.abs(y).max()
    if left.max() > COARSEST * np.ptp(y) + rounding:
        return False  # most pairs, before digits are looked for
    digits = _last_digit(y) + abs(slope) * _last_digit(x)
    # A rounded copy lies up to half a digit off. Set values in whole tens are no rounding of a reading: it
    # stays much closer to the line than their digits.
    return bool(left.max() <= rounding or digits / 8 <= left.max() <= digits + rounding)


def _last_digit(x: np.ndarray) -> float:
    """The power of ten of which all values are multiples; 0 where that has more than six decimals."""
    for step in 10.0 ** np.arange(2, -7, -1):
        if np.allclose(x / step, np.round(x / step), rtol=0.0, atol=1e-6):
            return float(step)
    return 0.0


def _worth(column: Column) -> tuple[bool, bool, bool, float, bool, bool]:
    """A quantity before the voltage in which it was read."""
    read, sure = not column.kind.commanded, column.kind.sure
    known = column.kind.name not in (*SENSED, "unknown")
    positive = bool(np.nanmean(column.x) > 0)
    return read, known, column.unit != "1", sure, column.unit in _PLAIN, positive


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


class NothingDrivenError(Exception):
    """No column drives another, as in the log of one sensor: `str(error)` says why."""


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


# What a rig was told to do: a column that is held, goes in steps, at a constant rate, or as a sine.

HELD = 0.7
"""Above this share of rows at two levels a column is held constant."""
STRAIGHT, BENT = 0.005, 0.02
"""Deviation from straight lines over time, relative to the range: below the first a drive keeps a constant
rate, above the second a column does not."""
NEAR, ALIKE = 0.01, 0.9
"""A column is held within so much of its range, and is not if it still has this rank correlation there."""
EVEN = 0.2
"""The part by which the times between two reversals of a sine differ, at most: noise moves reversals."""
LONG = 0.2
"""The share of its range that a column goes between two reversals where that counts."""
LEVELS, STANDS = 3, 0.6
"""A staircase has so many levels at least, and stands for so large a share of its rows."""


def commanded(x: np.ndarray, other: np.ndarray, t: np.ndarray | None) -> str:
    """How the rig drove x (n,) and not the other column (n,), in words; "" where that does not show.

    `t` (n,): the clock; without one rows are taken as evenly spaced in time.
    """
    if held(worked(x)) > HELD > held(other) and not _follows(x, other):
        return "is held constant"
    if _stands(x) > STANDS and _stands(other) < 0.5 * STANDS:
        return "goes in steps"
    clocks = [] if t is None else [("moves at a constant rate", t)]
    # A clock that turns over, or repeats a stamp, bends what moves evenly.
    for said, rows in (*clocks, ("moves evenly from row to row", np.arange(len(x)))):
        if _bend(x, rows) < STRAIGHT and _bend(other, rows) > BENT:
            return said
    return ""


def is_sine(x: np.ndarray, other: np.ndarray, t: np.ndarray | None) -> bool:
    """Whether x moves as a sine of one frequency, and the other column does not."""
    clock = np.arange(len(x)) if t is None else t
    return _bend(x, clock, wave=True) < STRAIGHT and _bend(other, clock, wave=True) > BENT


def _follows(x: np.ndarray, other: np.ndarray) -> bool:
    """Whether x follows the other column where it seems to be held: its range is that of a few rows."""
    near = np.abs(x - np.median(x)) <= NEAR * np.ptp(x)
    return abs(rank_correlation(x[near], other[near])) > ALIKE


def _stands(x: np.ndarray) -> float:
    """The share of rows at which x stays as it is, where it stays at several levels in turn."""
    still = np.diff(x) == 0
    levels = np.unique(x[1:][still])
    return float(still.mean()) if still.size and len(levels) >= LEVELS else 0.0


def _bend(x: np.ndarray, t: np.ndarray, wave: bool = False) -> float:
    """The largest deviation of x from a straight line over t between its reversals, relative to its range.

    Of a `wave` from a sine, between reversals that are as far apart as usual. A column that never goes far,
    or has no such reversals, counts as bent.
    """
    span = float(np.ptp(x)) if x.size else 0.0
    if not span:
        return np.inf
    at = turning_points(x, 0.1 * span)
    legs = [
        slice(a, b + 1) for a, b in pairwise(at) if abs(x[b] - x[a]) >= LONG * span and b > a + 3
    ]
    legs = legs[1:-1] if wave else legs
    clocks = [t[rows] - t[rows][0] for rows in legs]
    if not legs or not all(np.all(np.isfinite(clock)) and np.ptp(clock) > 0 for clock in clocks):
        return np.inf
    half, worst = float(np.median([clock[-1] for clock in clocks])), 0.0
    if wave and max(abs(clock[-1] / half - 1) for clock in clocks) > EVEN:
        return np.inf
    for rows, clock in zip(legs, clocks, strict=True):
        turned = np.pi * clock / half
        terms = [np.cos(turned), np.sin(turned)] if wave else [clock]
        A = np.column_stack([np.ones(len(clock)), *terms])
        left = x[rows] - A @ np.linalg.lstsq(A, x[rows])[0]
        worst = max(worst, float(np.sqrt(np.mean(left**2))) / span)
    return worst
