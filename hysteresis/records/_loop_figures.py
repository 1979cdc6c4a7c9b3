"""Figures of loops: what each loop of a record tells, with an error, for all loops at once.

Errors are propagated from the noise of input and output, see `RowNoise`, and from the sampling step.
"""

from typing import NamedTuple

import numpy as np

from ._abstract_record import AbstractRecord
from ._loop_cut import (
    AGREE,
    LoopRows,
    Pair,
    RowNoise,
    largest_row,
    loop_rows,
    parabola,
    ranges,
    widest,
)

FULL = 0.95
"""Of the inputs that both branches of the widest loop pass: loops that pass so much of it are compared."""

LEVELS = 65
"""Inputs at which the branches of a loop without noise are compared."""

BIN_ROWS = 8
"""Rows of a branch that are averaged at a level where there is noise."""

TIP_ROWS = 16
"""Rows beside a turning point that tell its level where there is noise."""

MAY_BE = 4.0
"""Standard deviations of the noise: rows so close to the largest value may be where a series turns."""

MOST_ROWS = 400
"""Rows of a branch that are enough: the means of further ones lose a hundred-thousandth of a round tip."""

QUIET = 1e-7
"""Of a series' range: noise below this is rounding."""


class Rows(NamedTuple):
    """The rows of all branches one after the other: branch 2 k and 2 k + 1 are those of loop k.

    - `at`: (m,) positions; `branch`: (m,) of each; `begins`: (2 k,) first of each branch in `at`.
    """

    at: np.ndarray
    branch: np.ndarray
    begins: np.ndarray


class Loops:
    """The loops of a record in numbers, (k,) each; pairs are values and their standard errors.

    **Arguments:**

    - `record`, `cut`: the readings, and the loops that can be evaluated.
    - `y`: (n,) another output in the place of the readings; it is averaged as these are.
    - `alike`: whether all branches are read at the same inputs, those that all of them pass.
    """

    def __init__(
        self,
        record: AbstractRecord,
        cut: LoopRows,
        y: np.ndarray | None = None,
        alike: bool = False,
    ):
        self.cut, self.size = cut, len(cut.first)
        self.u = record.input[cut.rows]
        self.y = (record.output if y is None else y)[cut.rows]
        self.t = None if record.time is None else record.time[cut.rows]
        self.noise = tuple(one.at(cut.sequence) for one in cut.noise)
        self.su, self.sy = (one.sigma for one in self.noise)
        both = (self.u, self.su), (record.output[cut.rows], self.sy)
        quiet = [not (self.size and np.median(s) > QUIET * np.ptp(x)) for x, s in both]
        self.quiet_u, self.quiet_y = quiet
        self.noisy = not all(quiet)
        self.turning_rows = cut.rows[cut.turn] if self.size else cut.turn
        legs = np.column_stack([cut.turn - cut.first, cut.last - cut.turn]).ravel() + 1
        # A short leg keeps four of its means.
        many = min(int(np.median(legs)) // MOST_ROWS, int(legs.min()) // 4) if self.size else 0
        self.rows, self.begins, self.many = (self.u, self.y), cut.bounds, 1
        self.before = self.after = np.zeros(self.size)
        if self.noisy and many > 1:
            self.many = many
            self._average(many)
            legs = legs // many
        cut = self.cut
        near = int(np.quantile(legs, 0.1)) // 6 if self.size else 0
        self.tip_rows = min(near, TIP_ROWS) if self.noisy and near >= 4 else 0
        bounds = cut.first, cut.turn, cut.last
        rows, off = zip(*(self.tip(self.u, at) for at in bounds), strict=True)
        # In a leg much shorter than the others the ends could change places.
        good = (rows[0] < rows[1]) & (rows[1] < rows[2])
        first, turn, last = rows = [
            np.where(good, *both) for both in zip(rows, bounds, strict=True)
        ]
        self.cut = cut = cut._replace(first=first, turn=turn, last=last)
        self.turns = list(zip(rows, off, strict=True))
        self.tips = [
            (self.value(self.u, at, both=True), self.value(self.y, at, by)) for at, by in self.turns
        ]
        self.leg_first = np.column_stack([first, turn]).ravel()
        self.leg_last = np.column_stack([turn, last]).ravel()
        self.lengths = lengths = self.leg_last + 1 - self.leg_first
        self.legs = Rows(
            ranges(self.leg_first, self.leg_last + 1), np.repeat(np.arange(len(lengths)), lengths),
            np.cumsum(lengths) - lengths,
        )  # fmt: skip
        self.rising = self.u[turn] > self.u[first]
        u = self.u[self.legs.at]
        low, high = (f.reduceat(u, self.legs.begins) for f in (np.minimum, np.maximum))
        self.ends = low.copy(), high.copy()
        # Of a branch that turns at its ends these are known better than by its outermost row.
        level = [one[0][0] for one in self.tips]
        begin, end = np.column_stack(level[:2]).ravel(), np.column_stack(level[1:]).ravel()
        for x, side in ((low, -1), (high, 1)):
            row = largest_row(side * self.u, self.leg_first, self.leg_last)
            at_end = np.where(self.leg_last - row <= self.tip_rows, end, self.u[row])
            x[:] = np.where(row - self.leg_first <= self.tip_rows, begin, at_end)
        both = low.reshape(-1, 2), high.reshape(-1, 2)
        self.low, self.high = both[0].min(1), both[1].max(1)
        self.common = both[0].max(1), both[1].min(1)
        if alike and self.size:
            low, high = self.common
            self.common = np.full(self.size, low.max()), np.full(self.size, high.min())
        self._levels()

    @classmethod
    def full(cls, record: AbstractRecord) -> "Loops":
        """The loops whose branches both pass 95 % of the widest loop's inputs, read at the same inputs."""
        cut = loop_rows(record)
        cut = cut.only(cut.counted)
        every = cls(record, cut)
        span = every.common[1] - every.common[0]
        return cls(
            record, cut.only(span >= FULL * span.max(initial=np.nextafter(0, 1))), alike=True
        )

    def _average(self, rows: int) -> None:
        """Take the means of so many rows each, which have less noise and lose nothing of a branch."""
        cut, bounds = self.cut, self.cut.bounds
        counts, rest = np.divmod(np.diff(bounds), rows)
        new, sequence = np.cumsum([0, *counts]), cut.sequence
        whole = ranges(bounds[:-1], bounds[1:] - rest).reshape(-1, rows)
        self.u, self.y = (x[whole].mean(1) for x in (self.u, self.y))
        if self.t is not None:
            self.t = self.t[whole].mean(1)
        self.noise = tuple(one.means(rows) for one in self.noise)
        self.su, self.sy = (one.sigma for one in self.noise)
        self.before = np.full(self.size, (rows - 1) / (2 * rows))
        self.after = self.before + rest[sequence] / rows
        first, turn, last = (
            new[sequence] + np.minimum((at - bounds[sequence]) // rows, counts[sequence] - 1)
            for at in (cut.first, cut.turn, cut.last)
        )
        self.cut = cut._replace(
            bounds=new, clock=cut.clock * rows, first=first, turn=turn, last=last
        )

    def noise_of(self, x: np.ndarray) -> tuple[RowNoise, bool]:
        """The noise of input or output, and whether the rows tell its levels: it is rounding alone."""
        quiet = self.quiet_u if x is self.u else self.quiet_y
        return self.noise[x is not self.u], quiet and self.many == 1

    def tip(self, x: np.ndarray, at: np.ndarray) -> Pair:
        """Where a series turns, near these rows, and the standard error of that row.

        The row of the largest value is chosen by its noise: of the rows that noise may have chosen, it is
        the one at the vertex of a parabola through the rows on either side.
        """
        w, (noise, quiet) = 2 * self.tip_rows, self.noise_of(x)
        if not w or quiet:
            return at, np.zeros(len(at))
        begin, end = self._ends()
        centre = np.clip(at, begin + w, np.maximum(end - w, begin + w))
        steps = np.arange(-w, w + 1)
        window = x[np.clip(centre[:, None] + steps, 0, len(x) - 1)]
        window = window - window[:, w : w + 1]
        mean, lean, bend = (window @ row for row in parabola(steps))
        top = (x[at] - x[centre])[:, None]
        side = np.sign(top - mean[:, None])
        near = side * (top - window) <= MAY_BE * noise.sigma[:, None]
        first = centre - w + near.argmax(1)
        last = centre + w - near[:, ::-1].argmax(1)
        vertex = np.nan_to_num(-lean / (2 * bend))
        error = noise.of(parabola(steps)[1]) / np.abs(2 * bend)
        found = np.clip(np.rint(centre + vertex), first, last).astype(int)
        rounded = np.hypot(np.nan_to_num(error, nan=np.inf), 1 / np.sqrt(12))
        rounded = np.minimum(rounded, np.maximum(last - first, 1) / np.sqrt(12))
        # A series that moves where its readings begin or end turns there.
        _, slope, square = parabola(steps)
        for row, edge, way in ((first, begin, -w), (last, end, w)):
            gone = way / w * side[:, 0] * (lean + 2 * way * bend)
            moves = (row == edge) & (gone > AGREE * noise.of(slope + 2 * way * square))
            found, rounded = np.where(moves, edge, found), np.where(moves, 0.0, rounded)
        return found, rounded

    def value(
        self, x: np.ndarray, at: np.ndarray, off: np.ndarray | float = 0.0, both: bool = False
    ) -> Pair:
        """The level of a series at a row, by parabolas through the rows beside it where there is noise.

        Of the rows before it and at it, and with `both` of those on both sides without it: an extreme is
        the row whose noise is largest, and lies between two rows. `off`: the standard error of the row.
        """
        noise, quiet = self.noise_of(x)
        sigma = noise.sigma
        near = [x[np.clip(at + k, *self._ends())] for k in (-1, 0, 1)]
        if not self.tip_rows or quiet:
            return x[at], np.hypot(sigma, both * np.abs(near[0] - 2 * near[1] + near[2]) / 8)
        level, error = widest(
            self._beside(x, at, off, both, w)
            for w in (self.tip_rows // 4, self.tip_rows // 2, self.tip_rows)
            if w >= 4
        )
        # Beside a hold a parabola goes past the readings: beyond them lies a turn between two rows alone.
        steps = [np.abs(x[at] - near[k]) for k in (0, 2)]
        step = np.maximum(*steps) * (both | (self.past(at) > 0))
        told = np.abs(level - x[at]) <= MAY_BE * sigma + step
        # Two rows alike at a turn: a hold, or a corner in the middle between them.
        flat = (np.minimum(*steps) < MAY_BE * sigma) & (step > MAY_BE * sigma) & (self.many == 1)
        half = np.where(both & flat & told, (level - x[at]) / 2, 0.0)
        return np.where(told, level - half, x[at]), np.where(told, np.hypot(error, half), sigma)

    def returned(self) -> Pair:
        """The output with which each loop comes back. How far its input stays off the first one, as where a
        record stops a row early, is an error of as much output, by the secant."""
        (u0, _), (u1, y1), (u2, y2) = self.tips
        with np.errstate(all="ignore"):
            secant = (y1[0] - y2[0]) / (u1[0] - u2[0])
        return y2[0], np.hypot(y2[1], np.nan_to_num(secant * (u2[0] - u0[0])))

    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        """First and last position of each loop's sequence."""
        begin, end = (self.cut.bounds[self.cut.sequence + k] for k in (0, 1))
        return begin, end - 1

    def past(self, at: np.ndarray) -> np.ndarray:
        """How far beyond these rows the first or last reading of a sequence lies, where they are means."""
        begin, end = self._ends()
        return np.where(at == end, self.after, np.where(at == begin, self.before, 0.0))

    def _beside(
        self, x: np.ndarray, at: np.ndarray, off: np.ndarray | float, both: bool, w: int
    ) -> Pair:
        """`value` by so many rows on a side."""
        noise, _ = self.noise_of(x)
        begin, end = self._ends()
        steps = np.arange(w) + both
        _, lean, _ = weights = parabola(steps)
        sides = [x[np.clip(at[:, None] + k * steps, 0, len(x) - 1)] for k in (-1, 1)]
        has_before, has_after = at - w >= begin, at + w <= end
        level = (-self.past(at)[:, None]) ** np.arange(3) @ weights
        left, right = ((side * level).sum(1) for side in sides)
        slopes = [side @ lean for side in sides]
        two = has_before & has_after & both
        found = np.where(two, (left + right) / 2, np.where(has_before, left, right))
        # A corner between two rows, whose sides are not equally steep; or so many rows along the slope.
        moved = (
            (slopes[0] - slopes[1]) / np.sqrt(48) * two
            if both
            else np.where(has_before, *slopes) * off
        )
        apart = np.pad(level, ((0, 0), (both, 0)))
        around = np.hstack([apart[:, :0:-1], apart[:, :1], apart[:, 1:]]) / 2
        error = np.hypot(np.where(two, noise.of(around), noise.of(level)), moved)
        told = has_before | has_after
        return np.where(told, found, x[at]), np.where(told, error, noise.sigma)

    def peak(self, x: np.ndarray, largest: bool) -> tuple[np.ndarray, np.ndarray, Pair]:
        """The row of a series' extreme in each loop, that row's error, and the level there.

        Where the output turns with the input, as by friction, it has a corner: its level is then that of
        the branch that comes to it.
        """
        rows, off = self.tip(x, self.extreme(x, largest))
        level = self.value(x, rows, both=True)
        if not self.tip_rows:
            return rows, off, level
        corners = [tip[x is not self.u] for tip in self.tips]
        # The lower of two ends that noise may have parted is too low: both tell where the loop closes.
        (a, ea), _, (b, eb) = corners
        alike = np.abs(a - b) <= MAY_BE * np.hypot(ea, eb)
        mean = np.where(alike, (a + b) / 2, [a, b]), np.where(alike, np.hypot(ea, eb) / 2, [ea, eb])
        corners[::2] = zip(*mean, strict=True)
        for (at, error), corner in zip(self.turns, corners, strict=True):
            beyond = (1 if largest else -1) * (level[0] - corner[0])
            there = (np.abs(rows - at) <= self.tip_rows) & (beyond < 2 * level[1])
            rows, off = np.where(there, at, rows), np.where(there, error, off)
            level = np.where(there, corner[0], level[0]), np.where(there, corner[1], level[1])
        return rows, off, level

    def extreme(self, x: np.ndarray, largest: bool) -> np.ndarray:
        """The row at which a series is largest or least within each loop."""
        return largest_row(x if largest else -x, self.cut.first, self.cut.last)

    def _levels(self) -> None:
        """The outputs of both branches at inputs that both pass: (k, 2, levels), the rising one first."""
        low, high = self.common
        usual = int(np.median(self.lengths)) if self.size else 0
        binned = self.noisy and usual >= 8 * BIN_ROWS
        most = usual // BIN_ROWS if binned else usual // 2 if self.noisy else LEVELS
        self.levels = max(min(most, LEVELS), 9) | 1
        self.place = (np.arange(self.levels) + 0.5) / self.levels
        at, branch, _ = self.legs
        loop = branch // 2
        u, y = self.u[at], self.y[at]
        own_low, own_high = self.ends
        width = np.where(own_high > own_low, own_high - own_low, 1.0)
        key = 2.0 * branch + (u - own_low[branch]) / width[branch]
        order = np.argsort(key, kind="stable")
        level = low[:, None] + (high - low)[:, None] * self.place
        each = np.repeat(level, 2, axis=0)
        number = np.arange(len(own_low))[:, None]
        wanted = 2.0 * number + (each - own_low[:, None]) / width[:, None]
        key, sorted_y = key[order], y[order]
        found = np.interp(wanted, key, sorted_y) if len(key) else wanted
        part, left = np.ones_like(found), np.zeros_like(found)
        if binned:
            size = np.where(high > low, high - low, 1.0)
            place = (u - low[loop]) / size[loop] * self.levels
            inside = (place >= 0) & (place < self.levels)
            cell = np.where(inside, place, 0).astype(int)
            off = place - cell - 0.5
            cell = (cell + branch * self.levels)[inside]
            off, y = off[inside], y[inside]
            square = off * off
            count, s1, s2, s3, sy, s1y = (
                np.bincount(cell, weights, found.size).reshape(found.shape)
                for weights in (np.ones(len(off)), off, square, square * off, y, off * y)
            )
            det = count * s2 - s1**2
            # Rows on one side of a level alone would be extrapolated from.
            good = (count >= 3) & (s1**2 < 0.5 * det)
            found = np.where(good, (s2 * sy - s1 * s1y) / det, found)
            part = np.where(good, np.sqrt(s2 / det), part)
            # The line through a bin lies off a curve by a part of its bend, of even rows a 24th; what that
            # leaves, a bend over twice the distance tells.
            share = np.where(good, (s2**2 - s1 * s3) / det, 0.0) / 2
            bend = np.diff(found, 2, axis=1)
            wider = (found[:, 4:] - 2 * found[:, 2:-2] + found[:, :-4]) / 4
            apart = np.pad(np.abs(bend[:, 1:-1] - wider), ((0, 0), (3, 3)), "edge")
            left = np.lib.stride_tricks.sliding_window_view(apart, 3, axis=1).max(2) * np.abs(share)
            found[:, 1:-1] -= bend * share[:, 1:-1]
        # Noise of the input counts as noise of the output, by the slope there.
        slope = np.gradient(found, axis=1) * self.levels / np.repeat(high - low, 2)[:, None]
        sigma_u, sigma_y = (np.repeat(x, 2)[:, None] for x in (self.su, self.sy))
        error = np.hypot(sigma_y, slope * sigma_u)
        if binned:
            # A branch that bends within a bin is read between rows, of which one that is off is none. A
            # chord lies off a curve by an eighth of its bend, means of rows by up to a 24th.
            a, b, c = (np.pad(sorted_y, 1, "edge")[k : len(key) + k] for k in range(3))
            smooth = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
            at_level = np.interp(wanted, key, smooth)
            off = np.abs(at_level - found)
            beyond = np.sqrt(np.maximum(off**2 - error**2, 0.0))
            bent = off > MAY_BE * error
            found, part = np.where(bent, at_level, found), np.where(bent, 1.0, part)
            bend = np.interp(wanted, key, np.pad(np.abs(np.diff(smooth, 2)), 1))
            left = np.where(bent, bend / 6, np.hypot(left, beyond))
            rise, run = (np.pad(x[2:] - x[:-2], 1, "edge") for x in (smooth, key))
            steep = np.interp(wanted, key, rise / np.where(run > 0, run, np.inf)) / width[:, None]
            slope = np.where(bent, steep, slope)
        # What lasts from row to row is the less averaged.
        rows = np.maximum(part**-2, 1.0)
        grown = [np.sqrt(one.at(number // 2).grown(rows)) for one in self.noise]
        error = np.hypot(np.hypot(grown[0] * slope * sigma_u, grown[1] * sigma_y) * part, left)
        shape = self.size, 2, self.levels
        found, error = (self.by_way(x.reshape(shape)) for x in (found, error))
        self.branches, self.branch_errors = found, error
        self.gap = found[:, 1] - found[:, 0]
        self.gap_error = np.hypot(error[:, 0], error[:, 1])

    def by_way(self, x: np.ndarray) -> np.ndarray:
        """(k, 2, ...) of first and second branch as rising and falling branch."""
        return np.where(self.rising.reshape(-1, *[1] * (x.ndim - 1)), x, x[:, ::-1])

    def width_at_middle(self) -> Pair:
        """Unloading less loading, at the middle of the inputs that both branches pass."""
        k = self.levels // 2
        return self.gap[:, k], self.gap_error[:, k]

    def largest_width(self) -> Pair:
        """The largest distance of the branches, with the sign of that place."""
        if not self.noisy:
            smooth, lean, bend = self._smoothed(1)[0]
            at, row = np.abs(smooth).argmax(1), np.arange(self.size)
            value, b, c = (x[row, at] for x in (smooth, lean, bend))
            top = -b / (2 * c)
            value = np.where(np.abs(top) <= 1, value + b * top / 2, value)
            return value, self.gap_error[row, at + 1]
        value, error = widest(self._largest(w) for w in range(1, max(self.levels // 10, 1) + 1))
        # A loop that is open at one or two levels alone.
        surely = np.abs(self.gap) - MAY_BE * self.gap_error
        at, row = surely.argmax(1), np.arange(self.size)
        narrow, gap = surely[row, at] > np.abs(value), self.gap[row, at]
        return np.where(narrow, gap, value), np.where(narrow, self.gap_error[row, at], error)

    def _smoothed(self, w: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """Level, slope and bend of the width by parabolas over `2 w + 1` levels, and its mean there."""
        windows = np.lib.stride_tricks.sliding_window_view(self.gap, 2 * w + 1, axis=1)
        return tuple(windows @ row for row in parabola(np.arange(-w, w + 1))), windows.mean(2)

    def _largest(self, w: int) -> Pair:
        (smooth, _, _), mean = self._smoothed(w)
        part = np.linalg.norm(parabola(np.arange(-w, w + 1))[0])
        # Noise that lasts is alike at neighbouring levels.
        rows = np.median(self.lengths) / self.levels
        grown = np.sqrt(self.noise[1].grown(rows / part**2) / self.noise[1].grown(rows))
        errors = self.gap_error[:, w : self.levels - w] * part * grown[:, None]
        # A parabola through a corner would be too high; the mean is high beside no corner.
        height, row = np.abs(mean), np.arange(self.size)
        at = height.argmax(1)
        value, error = smooth[row, at], errors[row, at]
        # The largest of many is chosen by its noise: the mean of those that may be it is not.
        near = height[row, at][:, None] - height <= error[:, None]
        near &= np.sign(smooth) == np.sign(value)[:, None]
        return np.where(near, smooth, 0.0).sum(1) / np.maximum(near.sum(1), 1), error
