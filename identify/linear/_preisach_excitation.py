"""What a record can tell about a Preisach density, and the input that would tell the rest.

The output is linear in the masses w of the cells, so what it tells depends on the input and the noise
alone. With independent prior masses of variance v each and rows A of the record's design,

    posterior covariance = (A'A / sigma^2 + 1 / v)^-1,      told = 1 - posterior / prior variance:

0 for a cell the data say nothing about, 1 for one they fix. v is the square of the mean mass that a
density of the output's range has. Offset and reversible part are unknown too.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from jaxtyping import Bool, Float

from hysteresis import InputError, Preisach, Record
from hysteresis.preisach import GridDensity
from hysteresis.preisach._preisach import PreisachInput

from .._levels import AT_ONCE
from ..records._new_record import located
from ._preisach_design_matrix import (
    NodeSpace,
    design_block,
    design_blocks,
    design_rows,
    normal_equations,
)


class Identifiability(NamedTuple):
    """Which cells of a grid a record can tell about.

    - `told` (cells, cells): from 0, nothing, to 1, everything; row alpha, column beta <= alpha.
    - `excited` (cells, cells): whether the input has swept the cell at all.
    - `low`, `high`: the grid's range.
    """

    told: Float[np.ndarray, "cells cells"]
    excited: Bool[np.ndarray, "cells cells"]
    low: float
    high: float

    @property
    def share(self) -> float:
        """Share of the cells that are told by more than half."""
        used = np.tri(len(self.told), dtype=bool)
        return float((self.told[used] > 0.5).mean())


class Design(NamedTuple):
    """An input that would tell the rest.

    - `turns`: inputs to visit one after the other, at any speed, from negative saturation.
    - `after`: what is told with its data added.
    """

    turns: Float[np.ndarray, " turns"]
    after: Identifiability

    def input(self, steps: int = 50) -> Float[np.ndarray, " samples"]:
        """The path with at least `steps` samples for each way across the range."""
        width = (self.after.high - self.after.low) / steps
        return _path(self.turns, np.ceil(np.abs(np.diff(self.turns)) / width))


def identifiability(
    record: Record, cells: int = 20, *, noise: float = 0.002, initial: str = "negative"
) -> Identifiability:
    """Which cells of a `cells` x `cells` grid over the record's input the record can tell about.

    `noise`: standard deviation of the output's noise over the output's range; `initial`: the relays
    before the first sample.

    Raises `InputError` for a constant input, no noise, no cells.

    **Example:**

        >>> told = identify.identifiability(record, 6)
        >>> told.told.shape, round(told.share, 2)
        ((6, 6), 0.19)
    """
    low, high = _range(record, cells, noise)
    grid = _grid(cells, low, high, initial)
    gram, swing = _told_by(grid, record)
    return _identifiability(_covariance(gram, cells, noise), swing, grid)


def design(
    record: Record,
    cells: int = 20,
    *,
    noise: float = 0.002,
    initial: str = "negative",
    enough: float = 0.5,
    most: int = 40,
) -> Design:
    """The input sequence that would tell what the record does not.

    First-order reversal curves are chosen one after the other, from either saturation: each time the
    one whose rows A would lower the variance of the cells not told by `enough` most, the diagonal of
    S A'(A S A' + sigma^2)^-1 A S with the posterior covariance S so far; until there are no such
    cells, or after `most` curves.

    Raises `InputError` as `identifiability` does.

    **Example:**

        >>> plan = identify.design(record, 6, most=3)
        >>> plan.after.share > identify.identifiability(record, 6).share
        True
    """
    low, high = _range(record, cells, noise)
    grid = _grid(cells, low, high, initial)
    gram, swing = _told_by(grid, record)
    S = _covariance(gram, cells, noise)
    nodes = np.linspace(low, high, cells + 1)
    candidates = [np.array([low, high, turn, high]) for turn in nodes[:-1]]
    candidates += [np.array([low, high, low, turn, low]) for turn in nodes[1:]]
    virgin = _grid(cells, low, high, "negative")
    # Two samples a cell.
    paths = [
        _path(turns, np.rint(2 * cells * np.abs(np.diff(turns)) / np.ptp(turns)))
        for turns in candidates
    ]
    rows = (design_rows(virgin, virgin.located(path)).toarray() for path in paths)
    designs = [NodeSpace(cells).to_unknowns(B.T).T for B in rows]
    turns = [np.array([low])]
    told = _identifiability(S, swing, grid)
    used = np.tril_indices(cells)
    while (
        len(turns) <= most and (open_ := 1 + cells + np.flatnonzero(told.told[used] < enough)).size
    ):
        steps = [_step(S, A, noise) for A in designs]
        best = int(np.argmax([(G[:, open_] ** 2).sum() for G in steps]))
        S = S - steps[best].T @ steps[best]
        swing = _extremes(np.vstack([swing, designs[best]]))
        turns.append(candidates[best][1:] if turns[-1][-1] == low else candidates[best][2:])
        told = _identifiability(S, swing, grid)
    path = np.concatenate(turns)
    return Design(path[np.append(True, np.diff(path) != 0)], told)


def excited_cells(
    model: Preisach, record: Record, used: Bool[np.ndarray, " samples"]
) -> Bool[np.ndarray, "cells cells"]:
    """Which cells of a model's grid switched among the used rows: about the others these say nothing."""
    assert isinstance(model.density, GridDensity)
    density, cells = model.density, model.density.cells
    grid = _grid(cells, density.low, density.high, model.initial, density.nodes)
    return _swung(_swing(grid, located(grid, record), record, used), cells)


Swing = Float[np.ndarray, "2 unknowns"]
"""The least and the greatest entry of each column of a design."""


def _extremes(A: Float[np.ndarray, "rows unknowns"]) -> Swing:
    return np.stack([A.min(0), A.max(0)])


def _swing(
    grid: Preisach, prepared: PreisachInput, record: Record, used: Bool[np.ndarray, " samples"]
) -> Swing:
    """Of the used rows of a record.

    On a branch, along which the input goes one way, each relay switches one way and at most once, so the
    first and the last used row of every branch have the extremes.
    """
    way = np.sign(np.diff(record.input, prepend=record.input[:1]))
    moved = np.where(way != 0, np.arange(len(way)), 0)
    way = way[np.maximum.accumulate(moved)]
    turned = np.append(True, way[1:] != way[:-1])
    turned[record.starts] = True
    rows = np.flatnonzero(used)
    branch = np.cumsum(turned)[rows]
    first = np.flatnonzero(np.diff(branch, prepend=0))
    ends = np.unique(np.concatenate([rows[first], rows[np.append(first[1:], len(rows)) - 1]]))
    assert isinstance(grid.density, GridDensity)
    space = NodeSpace(grid.density.cells)
    found = []
    for k in range(0, len(ends), AT_ONCE):
        B = design_block(grid, prepared, ends[k : k + AT_ONCE]).matrix
        found.append(_extremes(space.to_unknowns(B.T.toarray()).T))
    return _extremes(np.vstack(found))


def _told_by(grid: Preisach, record: Record) -> tuple[Float[np.ndarray, "n n"], Swing]:
    """A'A of the rows that count, and how far its columns swing there."""
    assert isinstance(grid.density, GridDensity)
    space, prepared = NodeSpace(grid.density.cells), located(grid, record)
    label, y = np.where(record.mask, 0, -1), np.zeros(len(record))
    count = 1 + space.cells + space.cells * (space.cells + 1) // 2
    blocks = design_blocks(grid, prepared)
    sums = dict(normal_equations(space, blocks, y, label, sparse.eye(count)))
    return sums[0].H, _swing(grid, prepared, record, record.mask)


def _swung(swing: Swing, cells: int) -> Bool[np.ndarray, "cells cells"]:
    """The cells whose relays swing at all: one that never switches adds a constant."""
    excited = np.zeros((cells, cells), bool)
    excited[np.tril_indices(cells)] = (swing[1] - swing[0])[1 + cells :] > 1e-9
    return excited


def _range(record: Record, cells: int, noise: float) -> tuple[float, float]:
    u = record.input[record.mask]
    low, high = float(u.min()), float(u.max())
    if low == high:
        raise InputError("zero-range", f"{record.input_name} never changes.")
    if cells < 1 or not 0 < noise < float("inf"):
        raise InputError("bad-option", f"cells={cells}, noise={noise:g}: at least 1, and above 0.")
    return low, high


def _grid(cells: int, low: float, high: float, initial: Any, nodes: Any = None) -> Preisach:
    density = GridDensity(low, high, np.zeros((cells, cells)), nodes=nodes)
    return Preisach(density, np.zeros(cells), initial=initial)


def _path(
    turns: Float[np.ndarray, " turns"], samples: Float[np.ndarray, " legs"]
) -> Float[np.ndarray, " samples"]:
    """So many samples from each of the turns to the next, at least one."""
    counts = np.maximum(samples, 1).astype(int).tolist()
    legs = [
        np.linspace(a, b, count, endpoint=False)
        for (a, b), count in zip(pairwise(turns), counts, strict=True)
    ]
    return np.concatenate([*legs, turns[-1:]])


def _covariance(
    gram: Float[np.ndarray, "n n"], cells: int, noise: float
) -> Float[np.ndarray, "n n"]:
    """(A'A / sigma^2 + 1 / v)^-1, in units of the output's range: of sum w = 1/2."""
    variance = np.full(len(gram), (0.5 / (cells * (cells + 1) / 2)) ** 2)
    variance[0], variance[1 : 1 + cells] = 1.0, 1.0 / cells**2
    precision = gram / noise**2 + np.diag(1 / variance)
    return scipy.linalg.inv(precision)


def _step(S: np.ndarray, A: np.ndarray, noise: float) -> Float[np.ndarray, "rows n"]:
    """G, with G'G what rows A take away from the covariance S."""
    AS = A @ S
    inner = scipy.linalg.cholesky(AS @ A.T + noise**2 * np.eye(len(A)), lower=True)
    return scipy.linalg.solve_triangular(inner, AS, lower=True)


def _identifiability(S: np.ndarray, swing: Swing, grid: Preisach) -> Identifiability:
    assert isinstance(grid.density, GridDensity)
    cells = grid.density.cells
    used = np.tril_indices(cells)
    told = np.zeros((cells, cells))
    prior = (0.5 / (cells * (cells + 1) / 2)) ** 2
    told[used] = np.clip(1 - np.diagonal(S)[1 + cells :] / prior, 0.0, 1.0)
    excited = _swung(swing, cells)
    return Identifiability(told, excited, grid.density.low, grid.density.high)
