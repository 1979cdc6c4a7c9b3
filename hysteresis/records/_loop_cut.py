"""Loops of a record: the rows at which each begins, turns and ends, and the noise of those rows."""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from math import comb
from typing import NamedTuple

import numpy as np
import scipy

from ._abstract_record import AbstractRecord
from ._cycles import default_dead_band, groups_of_legs, noise_level, turning_points

# Noise of readings whose neighbours may be alike, as behind a filter: its size, and how long it lasts.
#
#     R(k) = sigma^2 ((1 - share) [k = 0] + share keeps^|k|)
#
# is the covariance of the noise of rows k apart: a part that is new in every row, and one that fades.

ORDER = 6
"""Of the highest differences: they leave nothing of a smooth signal."""

BLOCKS = 16
"""Means of rows that a leg has at least: fewer do not follow its bend."""

ALIKE = 0.8
"""Of the largest level by differences of the last three orders: noise has one level, what is left of a bend
fades from order to order, and what is left of a corner grows."""

SPREAD = 10.0
"""Times 1 / n: variance of the logarithm of a squared level that n means tell, measured on white noise."""

SURE = 9.21
"""Chi square of two degrees of freedom that chance exceeds once in a hundred."""

LASTS = 1 - 1 / np.geomspace(1.5, 400, 40)
SHARES = 1 - np.geomspace(1, 1e-5, 26)[1:]
"""Tried for `keeps` and `share`."""


class RowNoise(NamedTuple):
    """Noise of several series, (k,) each: standard deviation, share of it that fades, and by how much."""

    sigma: np.ndarray
    share: np.ndarray
    keeps: np.ndarray

    def grown(self, rows: np.ndarray | float) -> np.ndarray:
        """The variance of a mean of so many rows, of what it is where neighbours have nothing alike."""
        return 1 + self.share * _alike(self.keeps, rows)

    def at(self, which: np.ndarray) -> "RowNoise":
        """The noise of these series."""
        return RowNoise(*(x[which] for x in self))

    def of(self, weights: np.ndarray) -> np.ndarray:
        """The standard deviation of a sum of successive rows with these weights, (n,) or (k, n)."""
        total = np.sum(weights**2, axis=-1)
        for lag in range(1, weights.shape[-1]) if self.share.any() else ():
            alike = np.sum(weights[..., lag:] * weights[..., :-lag], axis=-1)
            total = total + 2 * self.share * self.keeps**lag * alike
        return self.sigma * np.sqrt(np.maximum(total, 0.0))

    def means(self, rows: int) -> "RowNoise":
        """The noise of means of so many rows each."""
        grown, slow = self.grown(rows), self.share * (1 + _alike(self.keeps, rows))
        ratio = (1 + self.keeps) / (1 - self.keeps) / (1 + _alike(self.keeps, rows))
        return RowNoise(self.sigma * np.sqrt(grown / rows), slow / grown, (ratio - 1) / (ratio + 1))


def _alike(keeps: np.ndarray, rows: np.ndarray | float) -> np.ndarray:
    """What the alikeness of neighbours adds to the variance of a mean of so many rows."""
    return 2 * keeps / (1 - keeps) * (1 - (1 - keeps**rows) / (rows * (1 - keeps)))


def student(freedom: int) -> float:
    """How many times wider a 90 % interval is whose standard error so many degrees of freedom tell."""
    return float(scipy.special.stdtrit(freedom, 0.95) / scipy.special.ndtri(0.95))


def row_noise(x: np.ndarray, first: np.ndarray, stop: np.ndarray) -> tuple[float, float, float]:
    """`sigma`, `share` and `keeps` of a smooth series with legs from each first row to before its stop.

    White noise has one level at all scales: the means of m rows have 1 / sqrt(m) of it. Where their level
    grows, that tells how long the noise lasts.
    """
    sigma, legs = noise_level(x), stop - first
    sizes, squares, counts = [1], [sigma**2], [float(len(x))]
    most = int(np.median(legs)) // BLOCKS if len(legs) and sigma > 0 else 0
    while 2 * sizes[-1] <= most:
        size = 2 * sizes[-1]
        level, count = _level_of_means(x, first, legs // size, size)
        if not level > 0:
            break
        sizes.append(size)
        squares.append(size * level**2)
        counts.append(count)
    if len(sizes) < 3:
        return sigma, 0.0, 0.0
    weights, told = np.array(counts) / SPREAD, np.log(squares)
    # What lasts longer than the largest means is not seen in them.
    lasts = LASTS[1 - 1 / sizes[-1] >= LASTS][:, None]
    shares = SHARES[:, None, None]
    shapes = np.log(1 - shares + shares * _levels(lasts, np.array(sizes)))
    off = told - np.concatenate([np.zeros((1, *shapes.shape[1:])), shapes])
    mean = off @ weights / weights.sum()
    missed = (off - mean[..., None]) ** 2 @ weights
    share, keeps = np.unravel_index(int(missed.argmin()), missed.shape)
    if missed[0, 0] - missed[share, keeps] < SURE:
        return sigma, 0.0, 0.0
    return float(np.exp(mean[share, keeps] / 2)), float(SHARES[share - 1]), float(LASTS[keeps])


def _level_of_means(
    x: np.ndarray, first: np.ndarray, blocks: np.ndarray, size: int
) -> tuple[float, float]:
    """Standard deviation of the noise of means of `size` rows within legs, and how many means tell it; 0
    where a signal remains."""
    leg = np.repeat(np.arange(len(first)), blocks)
    number = np.arange(len(leg)) - np.repeat(np.cumsum(blocks) - blocks, blocks)
    d = x[(first[leg] + number * size)[:, None] + np.arange(size)].mean(1)
    levels = []
    for k in range(1, ORDER + 1):
        d = np.diff(d)
        own = np.abs(d[leg[k:] == leg[:-k]])
        if not len(own):
            return 0.0, 0.0
        levels.append(np.median(own) / (0.6745 * np.sqrt(comb(2 * k, k))))
    noise = min(levels[-3:]) > ALIKE * max(levels[-3:])
    return (levels[-1] if noise else 0.0), float(len(leg))


def _levels(keeps: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """What differences of means make of noise that fades, (fades, sizes): squared, of unit variance."""
    total = comb(2 * ORDER, ORDER) * (1 + _alike(keeps, sizes))
    for lag in range(1, ORDER + 1):
        alike = keeps ** (sizes * (lag - 1) + 1) * ((1 - keeps**sizes) / (1 - keeps)) ** 2 / sizes
        total = total + 2 * (-1) ** lag * comb(2 * ORDER, ORDER - lag) * alike
    return total / comb(2 * ORDER, ORDER)


CLOSED = 0.05
"""Of its range of inputs: a loop whose ends are so close is closed by a straight line. The tip that this
cuts off a round loop is less than a hundredth of its area."""

COUNTED = 0.9
"""Of a loop's rows that have to count."""

MOST_TURNS = 16
"""Turning points of the longest period that is looked for."""

STAIRS = 0.1
"""Of the rows that differ from the one before: so many follow rows that are equal where steps of a
converter are wider than the noise. A hold is one such place, not many."""


BLOCK = 500_000
"""Rows of loops that are evaluated at once: a row takes 175 bytes."""

AGREE = 2.0
"""Standard errors of an estimate from fewer rows by which one from more may differ and still be taken."""

Pair = tuple[np.ndarray, np.ndarray]
"""Values and their standard errors."""


class LoopRows(NamedTuple):
    """Loops of all sequences, as positions in the rows that count.

    - `rows`: (n,) of the record. `bounds`: (sequences + 1,) first of each sequence in `rows`.
    - `first`, `turn`, `last`: (k,) where a loop begins, reverses, and meets its first input again.
    - `sequence`, `number`: (k,) of each loop; numbers count from 1 within a sequence.
    - `counted`: (k,) whether enough of its rows count. `closed`: (k,) whether it comes back to its first
      input. `ends`: (k, 2) first and last row of the record.
    - `noise`: of input and of output, of each sequence. `clock`: the usual time from row to row, 0 without
      a clock.
    """

    rows: np.ndarray
    bounds: np.ndarray
    first: np.ndarray
    turn: np.ndarray
    last: np.ndarray
    sequence: np.ndarray
    number: np.ndarray
    counted: np.ndarray
    closed: np.ndarray
    ends: np.ndarray
    noise: tuple[RowNoise, RowNoise]
    clock: float

    def only(self, chosen: np.ndarray) -> "LoopRows":
        """Some of the loops."""
        names = ("first", "turn", "last", "sequence", "number", "counted", "closed", "ends")
        return self._replace(**{name: getattr(self, name)[chosen] for name in names})

    def blocks(self) -> Iterator["LoopRows"]:
        """All loops in parts of so many rows that their arrays stay small; one part without loops."""
        edges = np.searchsorted(self.last, np.arange(BLOCK, self.last.max(initial=0), BLOCK))
        edges = np.unique([0, *edges, len(self.last)])
        for begin, end in pairwise(edges) if len(edges) > 1 else [(0, 0)]:
            part = self.only(np.arange(begin, end))
            # The rows beside a tip tell its level: some of the loops on either side are kept.
            beside = int(np.median(part.last - part.first)) // 4 if end > begin else 0
            low = max(int(part.first.min(initial=len(self.rows))) - beside, 0)
            high = min(int(part.last.max(initial=0)) + beside + 1, len(self.rows))
            moved = {name: getattr(part, name) - low for name in ("first", "turn", "last")}
            bounds = np.clip(self.bounds, low, max(high, low)) - low
            yield part._replace(rows=self.rows[low:high], bounds=bounds, **moved)


def loop_rows(record: AbstractRecord) -> LoopRows:
    """Cut every sequence into loops.

    A loop is a cycle of the record: two successive legs of the input. It is one leg later where more
    loops close so, as behind a virgin curve, and has more legs where the input repeats itself only after
    several turning points. A second leg that passes the loop's first input is cut off there.
    """
    found: list[np.ndarray] = []
    kept: list[np.ndarray] = []
    noise, bounds = np.zeros((2, 3, len(record.labels))), [0]
    for k, (_, where) in enumerate(record.sequences()):
        u, y = record.input[where], record.output[where]
        rows = np.flatnonzero(record.mask[where] & np.isfinite(y))
        cut = _legs(u)
        # Rows that do not count are taken away: a bound in them moves to the next that counts.
        at = np.searchsorted(rows, cut)
        at[:, 2] = np.searchsorted(rows, cut[:, 2], side="right") - 1
        counted = (at[:, 2] + 1 - at[:, 0]) >= COUNTED * (cut[:, 2] + 1 - cut[:, 0])
        counted &= (at[:, 1] > at[:, 0]) & (at[:, 2] > at[:, 1])
        closed = np.zeros(len(cut), bool)
        at[counted, 2], closed[counted] = _closed(u[rows], at[counted])
        legs = at[counted, :2].T.ravel(), at[counted, 1:].T.ravel()
        noise[:, :, k] = [_noise(x[rows], *legs) for x in (u, y)]
        ends = cut[:, ::2]
        ends[counted] = rows[at[counted, ::2]]
        which = np.full(len(cut), k), np.arange(1, len(cut) + 1)
        found.append(
            np.column_stack([at + bounds[-1], *which, counted, closed, where.start + ends])
        )
        kept.append(where.start + rows)
        bounds.append(bounds[-1] + len(rows))
    clock = 0.0
    if record.time is not None and len(record) > 1:
        clock = float(np.median(np.diff(record.time)))
    first, turn, last, sequence, number, counted, closed, *ends = np.concatenate(found).T
    return LoopRows(
        np.concatenate(kept), np.array(bounds), first, turn, last, sequence, number,
        counted.astype(bool), closed.astype(bool), np.column_stack(ends),
        (RowNoise(*noise[0]), RowNoise(*noise[1])), clock,
    )  # fmt: skip


def _legs(u: np.ndarray) -> np.ndarray:
    """First row, turning row and last row of each loop of a sequence, (k, 3)."""
    band = default_dead_band(u)
    points = turning_points(u, band)
    v = u[points]
    best, most = groups_of_legs(points, v, band), -1.0
    for legs in range(2, MOST_TURNS + 1, 2):
        for begin in range(legs):
            cut = groups_of_legs(points, v, band, begin, legs)
            if not len(cut) or (legs > 2 and len(cut) < 2):
                continue
            gap, size = np.abs(np.diff(u[cut[:, ::2]]))[:, 0], np.ptp(u[cut], axis=1)
            passes = (u[cut[:, 2]] - u[cut[:, 0]]) * (u[cut[:, 1]] - u[cut[:, 0]]) < 0
            # Of the legs, not the loops, so that a longer period is no better for having fewer.
            score = legs * float(
                np.sum((gap <= CLOSED * size) + 0.5 * (passes & (gap > CLOSED * size)))
            )
            if legs > 2:
                turns = v[begin + legs * np.arange(len(cut))[:, None] + np.arange(legs + 1)]
                score *= float(np.abs(turns - turns[0]).max() <= CLOSED * np.ptp(v))
            if score > most:
                best, most = cut, score
        if most > 0.5 * max(len(points) - 1, 1):
            break
    return best


def _closed(u: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each loop comes back to its first input, and whether it does, (k,) each."""
    first, turn, last = at.T
    side = np.sign(u[turn] - u[first])
    size = np.abs(u[turn] - u[first])
    gap = side * (u[last] - u[first])
    passes = np.flatnonzero(gap < -CLOSED * size)
    rows = ranges(turn[passes], last[passes] + 1)
    lengths = last[passes] + 1 - turn[passes]
    beyond = np.repeat(side[passes], lengths) * (u[rows] - np.repeat(u[first[passes]], lengths)) < 0
    last = last.copy()
    if len(passes):
        starts = np.cumsum([0, *lengths[:-1]])
        crossing = np.minimum.reduceat(np.where(beyond, rows, len(u)), starts)
        last[passes] = np.maximum(crossing - 1, turn[passes] + 1)
    return last, gap <= CLOSED * size


def ranges(first: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """All numbers from each first to before its stop, one range after the other."""
    lengths = stop - first
    begins = np.cumsum(lengths) - lengths
    return np.arange(int(lengths.sum())) + np.repeat(first - begins, lengths)


def _noise(x: np.ndarray, first: np.ndarray, last: np.ndarray) -> tuple[float, float, float]:
    """Noise of a reading on legs between these rows, or what the steps of a converter leave open."""
    found, step = row_noise(x, first, last + 1), step_of(x) / np.sqrt(12)
    return found if found[0] > step else (step, 0.0, 0.0)


def step_of(x: np.ndarray) -> float:
    """The step of a converter that is wider than the noise, 0 of other series."""
    rests = np.diff(x) == 0
    moves = np.abs(np.diff(x)[~rests])
    if np.sum(rests[:-1] & ~rests[1:]) <= STAIRS * max(len(moves), 1):
        return 0.0
    return float(np.median(moves))


def widest(found: Iterable[Pair]) -> Pair:
    """Of estimates from more and more rows the last but one of those that agree with all before them, or
    the last one of all.

    An estimate that is about to differ hides so much. What it differs by from one of fewer rows, beyond the
    noise of that difference, its error has as well.
    """
    estimates = iter(found)
    narrower = [next(estimates)]
    value, error = more, wrong = narrower[0]
    agree = np.ones(len(value), bool)
    for new, own in estimates:
        beyond = np.zeros(len(new))
        for one, its in narrower:
            off = np.abs(new - one)
            agree = agree & (off <= AGREE * its)
            beyond = np.maximum(beyond, off**2 - np.maximum(its**2 - own**2, 0.0))
        value, error = np.where(agree, more, value), np.where(agree, wrong, error)
        more, wrong = np.where(agree, new, more), np.where(agree, np.sqrt(own**2 + beyond), wrong)
        narrower.append((new, own))
    return np.where(agree, more, value), np.where(agree, wrong, error)


def largest_row(x: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """The first row of the largest value between two rows, both included, for each pair."""
    lengths = last + 1 - first
    rows = ranges(first, last + 1)
    begins = np.cumsum(lengths) - lengths
    if not len(rows):
        return first
    top = np.maximum.reduceat(x[rows], begins)
    hit = np.where(x[rows] == np.repeat(top, lengths), rows, len(x))
    return np.minimum.reduceat(hit, begins)


def parabola(places: np.ndarray) -> np.ndarray:
    """Weights (3, n) of values at these places in their least-squares parabola: at 0, slope, and square."""
    return np.linalg.pinv(np.vander(places, 3, increasing=True).astype(float))
