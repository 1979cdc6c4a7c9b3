"""Where an input sequence turns: turning points, branches and cycles that noise cannot make."""

from collections.abc import Iterator
from math import comb
from typing import Any, NamedTuple

import numpy as np

from ._arrays import pieces

NEXT_TO_END = (0.02, 0.03, 0.05)
"""Of the way to the other end: places beside the end of a loop, where its legs have hardly parted."""


PIECES, PIECE = 20, 10_000
"""Of a long signal: how many pieces of it tell its noise, and of how many samples."""


def noise_level(u: np.ndarray) -> float:
    """Standard deviation of the sample-to-sample noise of a smooth signal, in the unit of `u`.

    `min over k = 2..6 of median |D^k u - median D^k u| / (0.6745 sqrt(C(2k, k)))`

    White noise gives its own level at every order `k`; a smooth signal fades as `k` grows, so the
    smallest is the one least fooled by coarse sampling. Fewer than three samples: 0. Quantised and
    piecewise linear signals give 0 or nearly so. Of more than 200,000 samples, twenty pieces of ten
    thousand are looked at: their medians are known to a third of a per cent.
    """
    if len(u) > PIECES * PIECE:
        begins = np.linspace(0, len(u) - PIECE, PIECES).astype(int)
        u = u[begins[:, None] + np.arange(PIECE)]
    levels, d = [], np.diff(u)
    for k in range(2, min(7, u.shape[-1])):
        d = np.diff(d)
        gain = np.sqrt(comb(2 * k, k))  # standard deviation of D^k of unit white noise
        levels.append(np.median(np.abs(d - np.median(d))) / (0.6745 * gain))
    return float(min(levels, default=0.0))


def default_dead_band(u: np.ndarray) -> float:
    """How far the input must come back before that counts as a reversal, in the unit of `u`.

    `max(8 noise_level(u), range(u) / 10)`, at most a quarter of the range

    Eight standard deviations: the extremes of 60,000 white samples lie 8.4 apart, so within one
    branch a noisy plateau stays whole. A tenth of the range: creep in a hold, a controller's
    overshoot and a stepping encoder reach some per cent of the stroke. A quarter at most: the true
    cycles must survive where fewer than ten samples a cycle look like noise. Loops smaller than
    the dead band are minor loops of the cycle that holds them.
    """
    span = float(np.ptp(u)) if len(u) else 0.0
    return min(max(8.0 * noise_level(u), 0.1 * span), 0.25 * span)


def turning_points(u: np.ndarray, dead_band: float) -> np.ndarray:
    """Indices of the alternating extrema of `u`, (k,), with its first and last sample.

    A reversal counts when the input has come back by more than `dead_band`, hence
    `|u[i[j+1]] - u[i[j]]| > dead_band` on every leg but the first and the last. The extremum of a
    plateau is its last sample. Whatever wobbles before the first leg belongs to it.
    """
    if len(u) < 2:
        return np.arange(len(u))
    # Only raw extrema can be turning points: the last samples of runs of one direction.
    raw, rose = [np.zeros(1, int)], np.empty(0, bool)
    for rows in pieces(len(u) - 1):
        step = np.diff(u[rows.start : rows.stop + 1])
        moves = np.flatnonzero(step)
        rising = np.append(rose, step[moves] > 0)
        raw.append(rows.start + moves[len(rose) ^ 1 :][rising[1:] != rising[:-1]])
        rose = rising[-1:]
    index = np.concatenate([*raw, [len(u) - 1]])
    kept = bytearray(len(index))
    kept[0] = kept[-1] = True
    low = high = sign = 0  # candidates: the extreme samples since the last reversal
    bottom = top = float(u[0])
    for rows in pieces(len(index)):
        # A loop over Python floats is five times faster than over NumPy's.
        for k, x in enumerate(u[index[rows]].tolist(), rows.start):
            if x >= top:
                high, top = k, x
            if x <= bottom:
                low, bottom = k, x
            if sign >= 0 and top - x > dead_band:
                if sign:
                    kept[high] = True
                sign, low, high, bottom, top = -1, k, k, x, x
            elif sign <= 0 and x - bottom > dead_band:
                if sign:
                    kept[low] = True
                sign, low, high, bottom, top = 1, k, k, x, x
    return index[np.frombuffer(kept, bool)]


def branches(u: np.ndarray, dead_band: float | None = None) -> np.ndarray:
    """+1 on loading (rising), -1 on unloading samples, (n,) int8.

    A turning sample ends its branch, and a plateau belongs to the branch before it. An input
    that never moves is loading.
    """
    points = turning_points(u, default_dead_band(u) if dead_band is None else dead_band)
    if len(points) < 2:
        return np.ones(len(u), np.int8)
    signs = np.where(u[points[1:]] >= u[points[:-1]], 1, -1).astype(np.int8)
    return np.repeat(signs, np.diff([-1, *points[1:]]))


def cycles(u: np.ndarray, dead_band: float | None = None) -> np.ndarray:
    """Number 1, 2, ... of the complete cycle each sample belongs to, 0 for none, (n,) int32."""
    firsts = first_of_cycles(u, dead_band)
    number = np.append(np.arange(1, len(firsts), dtype=np.int32), np.int32(0))
    return np.repeat(number, np.diff(firsts, append=len(u)))


def first_of_cycles(u: np.ndarray, dead_band: float | None = None) -> np.ndarray:
    """Index of the first sample of each complete cycle, and of the first one behind them all, (k + 1,).

    A cycle is two successive legs: from one trough to the next, or from peak to peak where the
    sequence starts by falling. It runs `(a, b]`: the trough that two cycles share ends the
    earlier one; the first sample, and a wait before the first leg, belong to cycle 1, a wait at
    the end to the last. The last cycle counts if its second leg comes back by at least half of its
    first; what follows the last complete cycle, say a ramp and a hold, belongs to none.
    """
    band = default_dead_band(u) if dead_band is None else dead_band
    points = turning_points(u, band)
    return np.append(0, groups_of_legs(points, u[points], band)[:, 2] + 1)


class Cycle(NamedTuple):
    """A complete cycle of a sequence: number, from 1 on, rows in the record, and the part that counts."""

    number: int
    rows: slice
    share: float


def counted_cycles(record: Any, counted: np.ndarray, share: float = 0.5) -> list[list[Cycle]]:
    """Of each sequence of a record the complete cycles of which at least such a part of the rows counts.

    Of every cycle at least one row does.
    """
    found = []
    for (_, where), firsts in zip(record.sequences(), record.first_of_cycles, strict=True):
        own = np.add.reduceat(counted[where][: firsts[-1]], firsts[:-1], dtype=np.int32)
        part, rows = (own / np.diff(firsts)).tolist(), (where.start + firsts).tolist()
        numbers = np.flatnonzero((own >= share * np.diff(firsts)) & (own > 0)).tolist()
        found.append([Cycle(k + 1, slice(rows[k], rows[k + 1]), part[k]) for k in numbers])
    return found


def groups_of_legs(
    points: np.ndarray, v: np.ndarray, dead_band: float | None, begin: int = 0, legs: int = 2
) -> np.ndarray:
    """First row, row farthest away and last row of each group of so many legs, (k, 3).

    Groups follow each other from a turning point on; `v` are the inputs of the points. The last group of a
    sequence counts where its last leg comes back by half of the one before it, and by more than the band;
    without a band it counts.
    """
    count = max(len(points) - 1 - begin, 0) // legs
    if count and begin + count * legs == len(points) - 1 and dead_band is not None:
        a, b, c = v[-3:]
        count -= not abs(c - b) > max(dead_band, 0.5 * abs(b - a))
    at = begin + legs * np.arange(count)
    inside = at[:, None] + np.arange(1, legs)
    away = np.abs(v[inside] - v[at][:, None])
    turn = inside[np.arange(count), away.argmax(1)] if count else at
    return points[np.column_stack([at, turn, at + legs])]


ENOUGH = 10_000
"""Loops of a sequence that are looked at: their mean is that of all within a hundredth of their scatter."""


class LoopSums(NamedTuple):
    """Sums over loops of y(u), D = y_unloading - y_loading.

    - `net`, `total`: `sum int D du` and `sum int |D| du`. `span`: of the ranges of u that both branches
      pass. `count`: how many loops they are.
    """

    net: float
    total: float
    span: float
    count: int

    @property
    def width(self) -> float:
        """The mean distance between the branches, in the unit of y; NaN without a loop."""
        return self.total / self.span if self.span > 0 else float("nan")


def loop_sums(record: Any, y: np.ndarray, used: np.ndarray) -> LoopSums:
    """The sums over the loops of values (n,) over a record's input, in all its sequences.

    A loop is a pair of successive legs, over the inputs that both pass in rows where `used` holds:
    pairs with cut ends serve as well. A steady drift of the output is no loop: where half of three loops
    or more return to their first input and do not meet there, a line in time is taken out that closes them.
    It is no steeper than the gap beside a loop's own end tells: one reading that is off at an end, a first
    loop that starts elsewhere, or a single loop that stays open, is no drift.
    """
    each = [one for _, s in record.sequences() for one in _gaps(record.input[s], y[s], used[s])]
    net, total, span, count = np.sum([(0.0, 0.0, 0.0, 0), *each], axis=0)
    return LoopSums(float(net), float(total), float(span), int(count))


def _opened(
    u: np.ndarray, y: np.ndarray, loop: tuple[int, int, int], legs: list[np.ndarray]
) -> float:
    """By how much a row a loop that returns to its first input does not meet itself; 0 of others."""
    a, b, c = loop
    if abs(u[c] - u[a]) > 0.1 * np.ptp(u[a : c + 1]):
        return 0.0
    # The ends seldom share an input exactly: compare where the legs last do, and next to that.
    end = max(u[x[0]] for x in legs) if u[b] > u[a] else min(u[x[-1]] for x in legs)
    at = end + (u[b] - end) * np.array([0.0, *NEXT_TO_END])
    (y1, t1), (y2, t2) = ([np.interp(at, u[x], v) for v in (y[x], x)] for x in legs)
    slopes = (y2 - y1) / np.maximum(t2 - t1, 1)
    if t2[0] <= t1[0] or not np.isfinite(slopes).all():
        return 0.0
    return _least(float(slopes[0]), float(np.median(slopes[1:])))


def _least(*slopes: float) -> float:
    """The flattest of slopes of one sign, 0 of slopes of both."""
    signs = {bool(slope > 0) for slope in slopes}
    return min(slopes, key=abs) if len(signs) == 1 else 0.0


def _gaps(u: np.ndarray, y: np.ndarray, used: np.ndarray) -> Iterator[LoopSums]:
    """The sums of each loop."""
    points = turning_points(u, default_dead_band(u))
    cut = groups_of_legs(points, u[points], None)
    if len(cut) > ENOUGH:  # spread by the golden section, which no program of loops repeats
        at = np.arange(ENOUGH) * 0.6180339887498949 % 1 * len(cut)
        cut = cut[np.unique(at.astype(int))]
    loops = []
    for a, b, c in cut.tolist():
        legs = [np.arange(a, b + 1), np.arange(b, c + 1)]
        legs = [rows[np.argsort(u[rows], kind="stable")] for rows in legs]
        legs = [rows[used[rows]] for rows in legs]
        if min(map(len, legs)) >= 2:
            loops.append((a, b, legs, _opened(u, y, (a, b, c), legs)))
    slopes = [slope for *_, slope in loops]
    usual = float(np.median(slopes)) if len(slopes) > 2 else 0.0
    for a, b, legs, slope in loops:
        chord = _least(slope, usual)
        legs = [(u[rows], y[rows] - chord * (rows - a)) for rows in legs]
        low, high = max(x[0] for x, _ in legs), min(x[-1] for x, _ in legs)
        if high <= low:
            continue
        level = low + (high - low) * (np.arange(64) + 0.5) / 64
        first, second = (np.interp(level, *leg) for leg in legs)
        gap = (second - first) * np.sign(u[b] - u[a]) * (high - low)
        # Rounding is no loop: gaps below a millionth of the output's stroke count as nothing.
        total = max(np.abs(gap).mean(), 1e-6 * np.ptp(legs[0][1]) * (high - low))
        yield LoopSums(float(gap.mean()), float(total), float(high - low), 1)
