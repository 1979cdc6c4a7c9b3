"""Fitting the map that combines several channels into the one input of a scalar model.

The map is linear in the rises of its curves over their cells and in the weights of what each channel leaves
behind, so all of them are found at once, by least squares with a prior whose strengths are chosen group by
group on held-out parts, see `_group_strengths`. The channels have a memory where that takes away a part of
the held-out error. So are first cycles left out of the map: those of a sample that still settles.
The scalar model is fitted to all rows.

The scalar model is fitted to values that each part has from a map that did not see it. On the values of the
whole fit, which is better on rows it saw than it will be on any other, a model with memory explains errors
that are not there again: one that predicts a sensor's next run to 1.0 per cent of its range then misses it
by up to 2.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import ChannelMap, InputError, Note, Record
from hysteresis.models._channel_map import memory_columns

from .._levels import ENOUGH_ROWS, RADII
from ..records._clocks import repeats, slow_times
from ..records._conditions import BLOCKS
from ..records._folds import BLOCKS_OF_FOLD, QUARTERS, Fold, earned, held_out_errors, thinned
from ..records._new_record import combine
from ._cross_validation import normal_equations_of
from ._group_strengths import APART, Group, GroupedColumns, Strengths

CELLS = 10
"""Cells of each channel's even grid."""

SETTLING = 3
"""First cycles left out, at most."""


def fit_channel_map(
    record: Record, keep_conditioning: bool = False
) -> tuple[ChannelMap, Record, Float[np.ndarray, " blocks"]]:
    """The map of a record's channels, the record with the combined input to fit a model to, and the map's
    squared errors on the rows that `condition_parts` would hold out.

    The record's history says what was done. `keep_conditioning` leaves no cycle out of the map.

    Raises `InputError` where no channel changes, nor the output, or there are fewer rows than channels.
    """
    moving = [name for name in record.channels if np.ptp(record.columns[name][record.mask]) > 0]
    rows = int(record.mask.sum())
    if not moving:
        raise InputError(
            "constant-input",
            f"None of the {len(record.channels)} channels changes in the rows that count.",
            place=record.source,
            fix="choose other columns (--input COL), or drive the rig.",
        )
    if not np.ptp(record.output[record.mask]):
        raise InputError(
            "constant-output",
            f"Output {record.output_name!r} is the same in every row; nothing to identify.",
            place=record.source,
            fix="choose another column (--output COL), or look at the sensor.",
        )
    if rows < len(moving):
        raise InputError(
            "too-few-rows",
            f"{rows} rows for {len(moving)} channels.",
            place=record.source,
            fix="use more rows, or fewer channels.",
        )
    # Of cycles that differ the first tell what later ones do not.
    alike = repeats(replace(record, input=np.nan_to_num(record.output)))
    several = len(record.labels) > 1
    most = _most_settling(record) if (alike or several) and not keep_conditioning else 0
    cut = _parts(record, most)
    best = _Problem(record, moving, cut)
    for left_out in range(1, most + 1):
        fewer = _Problem(record, moving, cut, left_out)
        if earned(best.blocks, fewer.blocks):
            best = fewer
    remembering = _Problem(record, moving, cut, best.left_out, remembers=True)
    if earned(best.blocks, remembering.blocks):
        best = remembering
    fitted = best.map(tuple(best.normal))
    combined = combine(record, fitted)
    u = combined.input.copy()
    used = u[record.mask]
    fitted = replace(fitted, trained=(float(used.min()), float(used.max())))
    # Values of a part that nothing else is like, an only ramp's end, would be no use to a model.
    for fold in cut.each:
        rows = cut.part == fold.test[0]
        u[rows] = combine(record, best.map(fold.train)).input[rows]
    error = 100 * float(np.sqrt(best.blocks.mean())) / float(np.ptp(record.output[record.mask]))
    said = []
    if still := [name for name in record.channels if name not in moving]:
        text = f"Left out {', '.join(map(repr, still))}: the same in all rows that count."
        said.append(Note("skipped", text))
    if best.left_out:
        rows, all_rows = int((record.mask & ~best.settled).sum()), int(record.mask.sum())
        text = (
            f"The map of the channels leaves out what comes before cycle {best.left_out + 1}, {rows} of"
            f" {all_rows} rows: without it, it predicts held-out rows better."
        )
        said.append(Note("settled", text, {"rows": rows, "of": all_rows}))
    memory = " and a memory each" if best.remembers else ""
    text = (
        f"Combined {len(moving)} channels by curves{memory}: parts held out are {error:.2g} % of the range"
        " off. Each has the values of a map without it."
    )
    said.append(Note("combined", text))
    combined = replace(combined, input=u, history=(*record.history, *said))
    outer = 0 if several else BLOCKS_OF_FOLD
    return fitted, combined, best.blocks[outer : BLOCKS_OF_FOLD * len(cut.each) - outer]


class _Problem:
    """The columns of every channel at the rows that count, and their products over each part.

    - `remembers`: whether the channels have stops and slow states too.
    - `left_out`: first cycles that the map does not learn from.
    - `blocks`: squared errors of the parts held out.
    """

    def __init__(
        self,
        record: Record,
        names: list[str],
        cut: "_Cut",
        left_out: int = 0,
        remembers: bool = False,
    ) -> None:
        self.left_out, self.remembers = left_out, remembers
        self.names, self.units = tuple(names), tuple(record.channels[name] for name in names)
        self.settled = _settled(record, left_out)
        used = record.mask & self.settled
        self.scale, self.centre = (
            float(record.output[used].std()) or 1.0,
            float(record.output[used].mean()),
        )
        x = np.column_stack([record.columns[name] for name in names])
        low, high = x[used].min(0), x[used].max(0)
        high = np.where(high > low, high, low + 1.0)  # one that moved in the cycles left out alone
        self.nodes = np.linspace(low, high, CELLS + 1, axis=1)
        self.radii = tuple(RADII[1::2].tolist()) if remembers else ()
        self.times = slow_times(record) if remembers else ()
        rows = thinned(np.flatnonzero(record.mask), ENOUGH_ROWS)
        y = (record.output[rows] - self.centre) / self.scale
        X, groups = self._columns(record, (x - low) / (high - low), rows)
        learnt, tested = used[rows], cut.tested[rows]
        self.columns = GroupedColumns(X, groups)
        self.mean = X[learnt].mean(0)
        A, w = self.columns.whitened, record.weights[rows]
        of_part = {p: cut.part[rows] == p for p in range(cut.part.max() + 1)}
        self.normal, held = (
            normal_equations_of(
                A * w[:, None], y * w, {p: own & some for p, own in of_part.items()}
            )
            for some in (learnt, tested)
        )
        self.strengths = Strengths(self.columns, self.normal, cut.folds, held)

        def error(unknowns: np.ndarray, test: tuple[int, ...]) -> np.ndarray:
            some = np.isin(cut.part[rows], test) & tested
            return w[some] * (A[some] @ unknowns - y[some])

        self.blocks = self.scale**2 * held_out_errors(cut.folds, self.strengths.solution, error)

    def _columns(
        self, record: Record, v: Float[np.ndarray, "samples channels"], rows: np.ndarray
    ) -> tuple[np.ndarray, list[Group]]:
        """A line, a curve, and what is left behind, of each channel; those of a kind are one group."""
        cells = np.arange(CELLS)
        curves = [np.clip(CELLS * one[rows, None] - cells, 0, 1) for one in v.T]
        lines = [np.clip(one[rows, None], 0, 1) for one in v.T]
        kinds = [(lines, np.zeros(1)), (curves, cells / 2)]
        if self.remembers:
            left = [np.empty((len(rows), len(self.radii) + len(self.times))) for _ in v.T]
            for _, own in record.sequences():
                a, b = np.searchsorted(rows, [own.start, own.stop])
                time = None if record.time is None else record.time[own]
                for found, one in zip(left, v[own].T, strict=True):
                    found[a:b] = memory_columns(one, time, self.radii, self.times)[
                        rows[a:b] - own.start
                    ]
            stops = len(self.radii)
            kinds.append(([one[:, :stops] for one in left], np.arange(stops)))
            if self.times:
                kinds.append(([one[:, stops:] for one in left], np.arange(len(self.times))))
        groups, end = [], 0
        for each, places in kinds:
            begin, end = end, end + len(each) * len(places)
            which = np.repeat(np.arange(len(each)), len(places))
            apart = np.column_stack([np.tile(places, len(each)), APART * which])
            groups.append(Group(np.arange(begin, end), apart, is_expected=begin == 0))
        return np.hstack([np.hstack(each) for each, _ in kinds]), groups

    def map(self, which: tuple[int, ...]) -> ChannelMap:
        """The map of some parts; its curves are 0 in the mean over the rows it is for."""
        weights, offset = self.columns.weights(self.strengths.solution(which))
        weights = self.scale * weights
        count = len(self.names)
        lines, rises, memory = np.split(weights, [count, count * (1 + CELLS)])
        rises = rises.reshape(count, CELLS) + lines[:, None] / CELLS
        mean = self.mean[count : count * (1 + CELLS)].reshape(rises.shape)
        means = (rises * mean).sum(1)
        values = np.pad(np.cumsum(rises, axis=1), ((0, 0), (1, 0))) - means[:, None]
        offset = self.centre + self.scale * offset + means.sum()
        if not self.remembers:
            return ChannelMap(self.nodes, values, offset, self.names, self.units)
        stops, slow = (
            one.reshape(count, -1) for one in np.split(memory, [count * len(self.radii)])
        )
        return ChannelMap(
            self.nodes, values, offset, self.names, self.units, radii=self.radii, times=self.times,
            memory=np.hstack([stops, slow]),
        )  # fmt: skip


class _Cut(NamedTuple):
    """The rows cut into parts, see `_parts`.

    - `part` (samples,): of every row, whether it counts or not. `tested`: rows on which maps are judged.
    - `each`: every part held out in turn. `folds`: on which strengths are chosen, and what a map has.
    """

    part: Int[np.ndarray, " samples"]
    tested: Bool[np.ndarray, " samples"]
    each: tuple[Fold, ...]
    folds: tuple[Fold, ...]


def _parts(record: Record, most: int) -> _Cut:
    """Groups of sequences where several count, each held out in turn; else blocks of the rows that count,
    the later half of which are predicted from those before: what drifts shows in no other way.

    A new run begins with cycles that settle, too: they are tested. In a single one the `most` first cycles
    are not.
    """
    part, tested = np.zeros(len(record), int), record.mask
    counted = [rows for _, rows in record.sequences() if record.mask[rows].any()]
    several = len(counted) > 1
    if several:
        for k, rows in enumerate(counted):
            part[rows] = k % QUARTERS
    else:
        tested = tested & _settled(record, most)
        before = np.cumsum(tested) - tested
        part = np.minimum(before * BLOCKS // int(tested.sum()), BLOCKS - 1)
    every = range(int(part[record.mask].max()) + 1)
    each = tuple(Fold(tuple(p for p in every if p != k), (k,)) for k in every)
    later = tuple(Fold(tuple(range(k)), (k,)) for k in every if 2 * k >= len(every))
    return _Cut(part, tested, each, each if several else (*each, *later))


def _most_settling(record: Record) -> int:
    """How many first cycles may be left out, for at least as many and one more to stay."""
    counts = [
        int(np.max(record.cycle[rows], where=record.mask[rows], initial=0))
        for _, rows in record.sequences()
        if record.mask[rows].any()
    ]
    return int(np.clip((min(counts) - 1) // 2, 0, SETTLING))


def _settled(record: Record, left_out: int) -> Bool[np.ndarray, " samples"]:
    """Rows from the cycle on that comes after so many."""
    found = np.ones(len(record), bool)
    for _, rows in record.sequences():
        later = record.cycle[rows] > left_out
        if left_out and later.any():
            found[rows.start : rows.start + int(later.argmax())] = False
    return found
