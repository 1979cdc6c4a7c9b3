"""Fitting a Preisach model on a grid: exact non-negative least squares with a smoothness prior.

With z = (offset, reversible increments, weights), all but the offset non-negative, minimise

    |A z - y|^2 / (2 N s^2) + lambda/2 ( |D_w z|^2 + |D_r z|^2 ),     s = range of y,

D_w the differences of the density between neighbouring cells, D_r those of the reversible part's
increments, each scaled by the mean diagonal of A'A in its block. A leading model must rise on every
branch it can reach besides, for which each increment c_k is written as a slack s_k plus what the
relays of its row can take away, c_k = s_k + 2 (row_k), s_k >= 0; the same for the columns,
s_k + 2 (row_k - column_k) >= 0, are constraints.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import Record
from hysteresis.preisach import GridDensity, Preisach

from ._folds import Parts
from ._nonnegative import constrained_least_squares, nonnegative_least_squares
from ._preisach_design import NodeSpace, Normal, design_rows, normal_equations

STRENGTHS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""Prior strengths tried, the strongest first."""


class LinearFit(NamedTuple):
    """A Preisach model fitted, and what its posterior needs.

    - `unknowns`: z at the minimum, in (offset, slack or increments, weights).
    - `H`, `b`: the minimised x'Hx/2 - b'x, prior included; `constraints` C x >= 0 besides.
    - `strength`: lambda; `dropped`: whether the conditioning cycle was left out of the fit.
    - `score`: held-out mean squared error over s^2 at that choice, and its spread over `blocks`.
    """

    model: Preisach
    unknowns: Float[np.ndarray, " unknowns"]
    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    constraints: Float[np.ndarray, "constraints unknowns"]
    rows: int
    scale: float
    strength: float
    dropped: bool
    blocks: Float[np.ndarray, " blocks"]


class PreisachProblem:
    """One shape of model (cells, orientation, initial state) on one record: its normal equations.

    Built once; fits for any choice of rows and prior strength then cost a few Cholesky factors.
    """

    def __init__(self, record: Record, parts: Parts, cells: int, leading: bool, initial: str):
        counted = parts.label >= 0
        u, y = record.input, np.where(counted, record.output, 0.0)
        low, high = float(u[counted].min()), float(u[counted].max())
        self.scale = float(np.ptp(y[counted]))
        self.parts, self.cells = parts, cells
        self.template = Preisach(
            GridDensity(low, high, np.zeros((cells, cells))),
            np.zeros(cells),
            leading=leading,
            initial=initial,  # type: ignore[arg-type]
        )
        prepared = self.template.prepare(None, u, starts=tuple(record.starts.tolist()))
        self.space = NodeSpace(cells)
        self.B, self.y = design_rows(self.template, prepared), y / self.scale
        self.normal = {
            p: normal_equations(self.space, self.B[parts.label == p], self.y[parts.label == p])
            for p in parts.all
        }
        self.weights = cells * (cells + 1) // 2
        self.free = np.zeros(1 + cells + self.weights, bool)
        self.free[0] = True
        self.substitution, self.constraints = _slopes(cells, leading)
        self.smoothness = _smoothness(cells)

    def objective(
        self, which: tuple[int, ...], strength: float
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]]:
        """H and b over some parts, in the unknowns with slacks."""
        total = self._total(which)
        H, b = total.H / total.rows, total.b / total.rows
        for block, prior in zip(self._blocks, self.smoothness, strict=True):
            H[block, block] += strength * np.trace(H[block, block]) / len(prior) * prior
        H[0, 0] *= 1 + 1e-12
        return self.substitution.T @ H @ self.substitution, self.substitution.T @ b

    def solve(
        self, which: tuple[int, ...], strength: float, exact: bool = True
    ) -> Float[np.ndarray, " unknowns"]:
        """The minimum over some parts; without the column constraints unless `exact`."""
        H, b = self.objective(which, strength)
        if exact and len(self.constraints):
            return constrained_least_squares(H, b, self.constraints, self.free)
        return nonnegative_least_squares(H, b, self.free)

    def held_out_errors(self, strength: float, dropped: bool) -> Float[np.ndarray, " blocks"]:
        """Mean squared errors (in s^2) over ten blocks of rows of each fold's held-out part."""
        blocks = []
        for fold in self.parts.folds:
            train = tuple(p for p in fold.train if not (dropped and p == self.parts.conditioning))
            z = self.substitution @ self.solve(train, strength, exact=False)
            rows = np.isin(self.parts.label, fold.test)
            error = self.B[rows] @ self.space.from_unknowns(z) - self.y[rows]
            blocks += [np.mean(part**2) for part in np.array_split(error, 10) if len(part)]
        return np.array(blocks)

    def model(self, unknowns: Float[np.ndarray, "*draws unknowns"]) -> Preisach:
        """The model of a vector of unknowns, or of many: arrays then have leading draw axes."""
        z = unknowns @ self.substitution.T * self.scale
        n = self.cells
        weights = np.zeros((*z.shape[:-1], n, n))
        weights[..., *np.tril_indices(n)] = np.maximum(z[..., 1 + n :], 0.0)
        reversible = np.maximum(z[..., 1 : 1 + n], 0.0)
        like = self.template
        low, high = like.density.low, like.density.high
        if z.ndim == 1:
            return _raise_to_invertible(
                Preisach(
                    GridDensity(low, high, weights), reversible, z[0],
                    leading=like.leading, initial=like.initial,
                )  # fmt: skip
            )
        return _stack([self.model(draw) for draw in unknowns])

    @property
    def _blocks(self) -> tuple[slice, slice]:
        return slice(1, 1 + self.cells), slice(1 + self.cells, None)

    def _total(self, which: tuple[int, ...]) -> Normal:
        first, *rest = (self.normal[p] for p in which)
        return sum(rest, first)


def fit_preisach(
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    initials: tuple[str, ...],
    cells: tuple[int, ...] = (20, 40),
) -> tuple[LinearFit, PreisachProblem]:
    """Fit every shape, choose shape and prior strength on the held-out parts, refit on all of them.

    Among the choices whose held-out error is above the best one's by less than the standard error
    of that difference, paired by blocks of rows, the simplest is taken: fewer cells, then a stronger prior.
    A conditioning cycle is left out of the fit where that predicts the held-out one better.
    """
    drops = (False,) if parts.conditioning is None else (False, True)

    def tried(problem: PreisachProblem) -> list[_Choice]:
        return [
            _Choice(problem, strength, dropped, problem.held_out_errors(strength, dropped))
            for strength in STRENGTHS
            for dropped in drops
        ]

    coarse, *finer = cells
    shapes = [(leading, initial) for leading in leadings for initial in initials]
    first = [c for shape in shapes for c in tried(PreisachProblem(record, parts, coarse, *shape))]
    # Orientation and initial state show on the coarse grid already; ties go to the first named.
    shape = _best(first).problem.template
    choices = [c for c in first if c.problem.template is shape]
    for n in finer:
        choices += tried(PreisachProblem(record, parts, n, shape.leading, shape.initial))
    best = _best(choices)

    def as_good(choice: _Choice) -> bool:
        worse = choice.blocks - best.blocks
        return bool(worse.mean() <= np.std(worse) / np.sqrt(len(worse)))

    problem, strength, dropped, blocks = next(
        c for c in choices if c.dropped == best.dropped and as_good(c)
    )
    which = tuple(p for p in parts.all if not (dropped and p == parts.conditioning))
    unknowns = problem.solve(which, strength)
    H, b = problem.objective(which, strength)
    rows = int(np.isin(parts.label, which).sum())
    return LinearFit(
        problem.model(unknowns), unknowns, H, b, problem.constraints, rows, problem.scale,
        strength, dropped, blocks,
    ), problem  # fmt: skip


class _Choice(NamedTuple):
    problem: PreisachProblem
    strength: float
    dropped: bool
    blocks: Float[np.ndarray, " blocks"]


def _best(choices: list[_Choice]) -> _Choice:
    """The least held-out error; within a thousandth of it the first one named."""
    least = min(c.blocks.mean() for c in choices)
    return next(c for c in choices if c.blocks.mean() <= 1.001 * least)


def _slopes(cells: int, leading: bool) -> tuple[np.ndarray, np.ndarray]:
    """Substitution and constraints that keep every branch of a leading model from falling."""
    i, j = np.tril_indices(cells)
    weight = 1 + cells + np.arange(len(i))
    substitution = np.eye(1 + cells + len(i))
    if not leading:
        return substitution, np.zeros((0, len(substitution)))
    # A half cell on the diagonal is swept twice as fast at its end: dE/df = 2 w f.
    substitution[1 + i, weight] = np.where(i == j, 4.0, 2.0)
    constraints = np.zeros((cells, len(substitution)))
    constraints[np.arange(cells), 1 + np.arange(cells)] = 1.0
    beside = i != j
    constraints[i[beside], weight[beside]] += 2.0
    constraints[j[beside], weight[beside]] -= 2.0
    return substitution, constraints


def _smoothness(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """D'D of the reversible increments and of the density, and a trace of ridge for definiteness."""
    i, j = np.tril_indices(cells)
    index = np.full((cells + 1, cells + 1), -1)
    index[i, j] = np.arange(len(i))
    density = np.where(i == j, 2.0, 1.0)  # mass to density: half cells have half the area
    steps = []
    for di, dj in ((1, 0), (0, 1)):
        here = np.flatnonzero((i + di < cells) & (i + di >= j + dj))
        there = index[i[here] + di, j[here] + dj]
        D = np.zeros((len(here), len(i)))
        D[np.arange(len(here)), here] -= density[here]
        D[np.arange(len(here)), there] += density[there]
        steps.append(D)
    D_w, D_r = np.vstack(steps), np.diff(np.eye(cells), axis=0)
    return D_r.T @ D_r + 1e-6 * np.eye(cells), D_w.T @ D_w + 1e-3 * np.eye(len(i))


def _raise_to_invertible(model: Preisach) -> Preisach:
    """Lift the increments by what rounding left the slopes below zero."""
    if not model.leading or model.reversible is None:
        return model
    width = (model.density.high - model.density.low) / len(model.reversible)
    lift = jnp.maximum(-model.least_slope() * width, 0.0)
    return Preisach(
        model.density, model.reversible + lift, model.offset,
        leading=True, initial=model.initial, capacity=model.capacity,
    )  # fmt: skip


def _stack(models: list[Preisach]) -> Preisach:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *models)
