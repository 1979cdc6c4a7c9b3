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
from jaxtyping import Bool, Float

from hysteresis import InputError, Preisach, Record
from hysteresis.preisach import GridDensity

from ..records._run_model import located
from ._preisach_design_matrix import NodeSpace, design_rows
from ._preisach_normal_equations import CHUNK


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

    **Example:**

        >>> identify.design(record, 6, most=3).input(10).shape
        (67,)
    """

    turns: Float[np.ndarray, " turns"]
    after: Identifiability

    def input(self, steps: int = 50) -> Float[np.ndarray, " samples"]:
        """The path with at least `steps` samples for each way across the range."""
        width = (self.after.high - self.after.low) / steps
        legs = [
            np.linspace(a, b, max(int(np.ceil(abs(b - a) / width)), 1), endpoint=False)
            for a, b in pairwise(self.turns)
        ]
        return np.concatenate([*legs, self.turns[-1:]])


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
    A = _rows(grid, located(grid, record))[record.mask]
    return _identifiability(_covariance(A, cells, noise), A, grid)


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
    rows = [_rows(grid, located(grid, record))[record.mask]]
    S = _covariance(rows[0], cells, noise)
    nodes = np.linspace(low, high, cells + 1)
    candidates = [np.array([low, high, turn, high]) for turn in nodes[:-1]]
    candidates += [np.array([low, high, low, turn, low]) for turn in nodes[1:]]
    virgin = _grid(cells, low, high, "negative")
    designs = [_rows(virgin, virgin.located(_path(turns, cells))) for turns in candidates]
    turns = [np.array([low])]
    told = _identifiability(S, rows[0], grid)
    used = np.tril_indices(cells)
    while (
        len(turns) <= most and (open_ := 1 + cells + np.flatnonzero(told.told[used] < enough)).size
    ):
        steps = [_step(S, A, noise) for A in designs]
        best = int(np.argmax([(G[:, open_] ** 2).sum() for G in steps]))
        S = S - steps[best].T @ steps[best]
        rows.append(designs[best])
        turns.append(candidates[best][1:] if turns[-1][-1] == low else candidates[best][2:])
        told = _identifiability(S, np.vstack(rows), grid)
    path = np.concatenate(turns)
    return Design(path[np.append(True, np.diff(path) != 0)], told)


def excited_cells(
    model: Preisach, record: Record, used: Bool[np.ndarray, " samples"]
) -> Bool[np.ndarray, "cells cells"]:
    """Which cells of a model's grid switched among the used rows: about the others these say nothing.

    **Example:**

        >>> cells = identify.excited_cells(grid_fit.model, grid_fit.train, grid_fit.used)
        >>> cells.shape, int(cells.sum())
        ((6, 6), 21)
    """
    assert isinstance(model.density, GridDensity)
    cells = model.density.cells
    grid = _grid(cells, model.density.low, model.density.high, model.initial)
    B = design_rows(grid, located(grid, record))[used]
    steps = range(0, B.shape[0], CHUNK)
    columns = [NodeSpace(cells).to_unknowns(B[k : k + CHUNK].toarray().T) for k in steps]
    most, least = (np.max([c.max(1) for c in columns], 0), np.min([c.min(1) for c in columns], 0))
    return _swung(most - least, cells)


def _swung(swing: Float[np.ndarray, " unknowns"], cells: int) -> Bool[np.ndarray, "cells cells"]:
    """The cells whose relays swing at all: one that never switches adds a constant."""
    excited = np.zeros((cells, cells), bool)
    excited[np.tril_indices(cells)] = swing[1 + cells :] > 1e-9
    return excited


def _range(record: Record, cells: int, noise: float) -> tuple[float, float]:
    u = record.input[record.mask]
    low, high = float(u.min()), float(u.max())
    if low == high:
        raise InputError("zero-range", f"{record.input_name} never changes.")
    if cells < 1 or not 0 < noise < float("inf"):
        raise InputError("bad-option", f"cells={cells}, noise={noise:g}: at least 1, and above 0.")
    return low, high


def _grid(cells: int, low: float, high: float, initial: Any) -> Preisach:
    weights = np.zeros((cells, cells))
    return Preisach(GridDensity(low, high, weights), np.zeros(cells), initial=initial)


def _path(turns: np.ndarray, cells: int) -> np.ndarray:
    """Two samples a cell between the turns."""
    step = np.ptp(turns) / (2 * cells)
    legs = [
        np.linspace(a, b, max(round(abs(b - a) / step), 1), endpoint=False)
        for a, b in pairwise(turns)
    ]
    return np.concatenate([*legs, turns[-1:]])


def _rows(grid: Preisach, prepared: object) -> Float[np.ndarray, "rows unknowns"]:
    assert isinstance(grid.density, GridDensity)
    B = design_rows(grid, prepared)  # type: ignore[arg-type]
    return NodeSpace(grid.density.cells).to_unknowns(B.toarray().T).T


def _covariance(A: np.ndarray, cells: int, noise: float) -> Float[np.ndarray, "n n"]:
    """(A'A / sigma^2 + 1 / v)^-1, in units of the output's range: of sum w = 1/2."""
    variance = np.full(A.shape[1], (0.5 / (cells * (cells + 1) / 2)) ** 2)
    variance[0], variance[1 : 1 + cells] = 1.0, 1.0 / cells**2
    precision = A.T @ A / noise**2 + np.diag(1 / variance)
    return scipy.linalg.inv(precision)


def _step(S: np.ndarray, A: np.ndarray, noise: float) -> Float[np.ndarray, "rows n"]:
    """G, with G'G what rows A take away from the covariance S."""
    AS = A @ S
    inner = scipy.linalg.cholesky(AS @ A.T + noise**2 * np.eye(len(A)), lower=True)
    return scipy.linalg.solve_triangular(inner, AS, lower=True)


def _identifiability(S: np.ndarray, A: np.ndarray, grid: Preisach) -> Identifiability:
    assert isinstance(grid.density, GridDensity)
    cells = grid.density.cells
    used = np.tril_indices(cells)
    told = np.zeros((cells, cells))
    prior = (0.5 / (cells * (cells + 1) / 2)) ** 2
    told[used] = np.clip(1 - np.diagonal(S)[1 + cells :] / prior, 0.0, 1.0)
    excited = _swung(np.ptp(A, axis=0), cells)
    return Identifiability(told, excited, grid.density.low, grid.density.high)
