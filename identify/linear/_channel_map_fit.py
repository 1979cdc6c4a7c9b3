"""Fitting the map that combines several channels into the one input of a scalar model.

The map is linear in the rises of its curves over their cells, so all of them are found at once, by least
squares with a prior that holds neighbouring rises alike. Held-out parts of the training rows choose its
strength, and how many first cycles the map leaves out, where that takes away a part of their error: they
are those of a sample that still settles. The scalar model is fitted to all rows.

The scalar model is fitted to values that each part has from a map that did not see it. On the values of the
whole fit, which is better on rows it saw than it will be on any other, a model with memory explains errors
that are not there again: one that predicts a sensor's next run to 1.0 per cent of its range then misses it
by up to 2.
"""

from dataclasses import replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import ChannelMap, InputError, Note, Record

from ..records._channel_map import columns_of, combine
from ..records._folds import Fold, earned, held_out_errors, simplest, thinned
from ._cross_validation import ROWS, STRENGTHS, Choice, jittered, normal_equations_of, total

CELLS = 16
"""Cells of each channel's even grid."""

STRAIGHT = (100.0, 10.0, 1.0)
"""Further prior strengths, the strongest first: with 100 the curves are straight lines, which is all that a
few sessions with zeros of their own tell."""

RIDGE = 1e-3
"""Pulls what the data leave open to 0, as a part of the prior; straight lines are pulled no harder than
curves."""

SETTLING = 3
"""First cycles left out, at most."""

GROUPS = 5
"""Groups that several sequences make, at most, each held out in turn."""


def fit_channel_map(record: Record, keep_conditioning: bool = False) -> tuple[ChannelMap, Record]:
    """The map of a record's channels, and the record with the combined input to fit a model to.

    Its history says what was done. `keep_conditioning` leaves no cycle out of the map.

    Raises `InputError` where no channel changes, or there are fewer rows than channels.
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
    if rows < len(moving):
        raise InputError(
            "too-few-rows",
            f"{rows} rows for {len(moving)} channels.",
            place=record.source,
            fix="use more rows, or fewer channels.",
        )
    most = 0 if keep_conditioning else _most_settling(record)
    part, tested = _parts(record, most)
    choices = [
        _chosen(_Problem(record, moving, part, tested, left_out)) for left_out in range(most + 1)
    ]
    fewer = [one for one in choices[1:] if earned(choices[0].blocks, one.blocks)]
    choice = simplest(fewer) if fewer else choices[0]
    problem = choice.problem
    fitted = problem.map(choice.strength)
    combined = combine(record, fitted)
    u = combined.input.copy()
    used = u[record.mask]
    fitted = replace(fitted, trained=(float(used.min()), float(used.max())))
    # Values of a part that nothing else is like, an only ramp's end, would be no use to a model.
    for p in tested if len(tested) > 1 else ():
        u[part == p] = problem.map(choice.strength, without=p)(columns_of(record, fitted))[
            part == p
        ]
    error = 100 * float(np.sqrt(choice.blocks.mean()))
    said = []
    if still := [name for name in record.channels if name not in moving]:
        text = f"Left out {', '.join(map(repr, still))}: the same in all rows that count."
        said.append(Note("skipped", text))
    if problem.left_out:
        rows, all_rows = int((record.mask & ~problem.settled).sum()), int(record.mask.sum())
        text = (
            f"The map of the channels leaves out what comes before cycle {problem.left_out + 1}, {rows} of"
            f" {all_rows} rows: without it, it predicts held-out rows better."
        )
        said.append(Note("settled", text, {"rows": rows, "of": all_rows}))
    text = (
        f"Combined {len(moving)} channels by curves with a prior of strength {choice.strength:g}: parts"
        f" held out are {error:.2g} % of the range off. Each has the values of a map without it."
    )
    said.append(Note("combined", text))
    return fitted, replace(
        combined,
        input=u,
        history=(*record.history, *said),
    )


class _Problem:
    """The columns of every rise at the rows that count, and their products over each part."""

    def __init__(
        self,
        record: Record,
        names: list[str],
        part: Int[np.ndarray, " samples"],
        tested: tuple[int, ...],
        left_out: int,
    ) -> None:
        self.left_out, self.tested = left_out, tested
        self.names, self.units = tuple(names), tuple(record.channels[name] for name in names)
        self.settled = _settled(record, left_out)
        used = record.mask & self.settled
        self.scale = float(np.ptp(record.output[used]))
        self.centre = float(record.output[used].mean())
        x = np.column_stack([record.columns[name] for name in names])
        low, high = x[used].min(0), x[used].max(0)
        high = np.where(high > low, high, low + 1.0)  # one that moved in the cycles left out alone
        self.nodes = np.linspace(low, high, CELLS + 1, axis=1)
        # What is tested includes the rows left out of the fit, where there are other sequences.
        rows = thinned(np.flatnonzero(record.mask), ROWS)
        self.part, self.y = part[rows], (record.output[rows] - self.centre) / self.scale
        cells = (x[rows, :, None] - self.nodes[:, :-1]) / (self.nodes[:, 1:] - self.nodes[:, :-1])
        ramps = np.clip(cells, 0.0, 1.0).reshape(len(rows), -1)
        self.A = np.hstack([np.ones((len(rows), 1)), ramps])
        of_part = {int(p): (self.part == p) & used[rows] for p in np.unique(self.part)}
        self.normal = normal_equations_of(self.A, self.y, of_part)
        self.mean = self.A[used[rows]].mean(0)

    def all_but(self, without: int | None) -> tuple[int, ...]:
        """The parts, less one."""
        return tuple(p for p in self.normal if p != without)

    def solve(self, strength: float, which: tuple[int, ...]) -> Float[np.ndarray, " unknowns"]:
        """Offset about `centre` and rises, in `scale`, from some parts."""
        H, b = total(self.normal[p] for p in which).means
        D = np.diff(np.eye(CELLS), axis=0)
        each = strength * CELLS * D.T @ D + min(strength, STRENGTHS[0]) * RIDGE * np.eye(CELLS)
        H[1:, 1:] += np.kron(np.eye(len(self.names)), each)
        return np.linalg.solve(jittered(H), b)

    def tried(self, strength: float) -> "Tried":
        """The errors of the parts that are tested, each without it."""

        def error(x: np.ndarray, test: tuple[int, ...]) -> np.ndarray:
            rows = np.isin(self.part, test)
            return self.A[rows] @ x - self.y[rows]

        folds = [Fold(self.all_but(p), (p,)) for p in self.tested]
        blocks = held_out_errors(folds, lambda train: self.solve(strength, train), error)
        return Choice(self, strength, blocks)

    def map(self, strength: float, without: int | None = None) -> ChannelMap:
        """The map of all parts but one; its curves are 0 in the mean over the rows it is for."""
        x = self.scale * self.solve(strength, self.all_but(without))
        rises = x[1:].reshape(len(self.names), CELLS)
        means = (rises * self.mean[1:].reshape(rises.shape)).sum(1)
        values = np.pad(np.cumsum(rises, axis=1), ((0, 0), (1, 0))) - means[:, None]
        offset = self.centre + x[0] + means.sum()
        return ChannelMap(self.nodes, values, offset, self.names, self.units)


Tried: TypeAlias = Choice[_Problem]


def _chosen(problem: _Problem) -> Tried:
    """The strongest prior that is as good as the best one."""
    choices = [problem.tried(strength) for strength in (*STRAIGHT, *STRENGTHS)]
    return simplest(choices)


def _parts(record: Record, most: int) -> tuple[Int[np.ndarray, " samples"], tuple[int, ...]]:
    """Part of every row, whether it counts or not, and the parts that are held out in turn.

    Groups of sequences where several count; else cycles, of which the first `most` are never held out,
    with 0 for rows in none; else the last quarter.
    """
    part = np.zeros(len(record), int)
    counted = [rows for _, rows in record.sequences() if record.mask[rows].any()]
    if len(counted) > 1:
        for k, rows in enumerate(counted):
            part[rows] = 1 + k % GROUPS
        return part, tuple(range(1, min(len(counted), GROUPS) + 1))
    cycles = np.unique(record.cycle[record.mask & (record.cycle > 0)])
    if len(cycles) > 1:
        return record.cycle, tuple(int(c) for c in cycles if c > most)
    rows = np.flatnonzero(record.mask)
    part[rows[3 * len(rows) // 4] :] = 1
    return part, (1,)


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
