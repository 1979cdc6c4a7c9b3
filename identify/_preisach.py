"""Fitting a Preisach model on a grid: exact non-negative least squares with a smoothness prior.

With z = (offset, reversible increments, weights), all but the offset non-negative, minimise

    |A z - y|^2 / (2 N s^2) + lambda/2 ( |D_w z|^2 + |D_r z|^2 ),     s = range of y,

D_w the differences of the density between neighbouring cells, D_r those of the reversible part's
increments, each scaled by the mean diagonal of A'A in its block. A leading model must rise on every
branch it can reach besides, for which each increment c_k is written as a slack s_k plus what the
relays of its row can take away, c_k = s_k + 2 (row_k), s_k >= 0; the same for the columns,
s_k + 2 (row_k - column_k) >= 0, are constraints.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from jaxtyping import Bool, Float

from hysteresis import Record
from hysteresis.preisach import GridDensity, Preisach

from ._folds import Parts, block_errors
from ._noise import Noise
from ._nonnegative import constrained_least_squares, nonnegative_least_squares
from ._preisach_design import NodeSpace, Normal, design_rows, normal_equations
from ._result import prepare

STRENGTHS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""Prior strengths tried, the strongest first."""

TOTALS = ("offset", "reversible.rise", "density.mass")
"""The figures a grid model is summed up in: constant, rise of the memoryless part, relays' mass."""


class Unknowns(NamedTuple):
    """What a vector of unknowns stands for: (offset, increments or slacks, weights), over `scale`."""

    cells: int
    low: float
    high: float
    leading: bool
    initial: str
    scale: float

    @property
    def count(self) -> int:
        return 1 + self.cells + self.cells * (self.cells + 1) // 2

    @property
    def free(self) -> Bool[np.ndarray, " unknowns"]:
        """Which may be negative: the offset."""
        return np.arange(self.count) == 0

    @property
    def totals(self) -> Float[np.ndarray, "3 unknowns"]:
        """Rows that sum up the unknowns to `TOTALS`, over `scale`."""
        sums = np.zeros((3, self.count))
        sums[0, 0], sums[1, 1 : 1 + self.cells], sums[2, 1 + self.cells :] = 1.0, 1.0, 1.0
        return sums @ _slopes(self.cells, self.leading)[0]

    def model(self, unknowns: Float[np.ndarray, "*draws unknowns"]) -> Preisach:
        """The model of a vector of unknowns; of many, one whose arrays have leading draw axes."""
        if unknowns.ndim > 1:
            models = [self.model(draw) for draw in unknowns]
            return jax.tree.map(lambda *leaves: jnp.stack(leaves), *models)
        z = self.scale * (_slopes(self.cells, self.leading)[0] @ unknowns)
        weights = np.zeros((self.cells, self.cells))
        weights[np.tril_indices(self.cells)] = np.maximum(z[1 + self.cells :], 0.0)
        reversible = np.maximum(z[1 : 1 + self.cells], 0.0)
        model = Preisach(
            GridDensity(self.low, self.high, weights), reversible, z[0],
            leading=self.leading, initial=self.initial,  # type: ignore[arg-type]
        )  # fmt: skip
        if not self.leading:
            return model
        # Lift the increments by what rounding left the slopes below zero.
        width = (self.high - self.low) / self.cells
        lifted = reversible + np.maximum(-np.asarray(model.least_slope()) * width, 0.0)
        return Preisach(model.density, lifted, z[0], leading=True, initial=model.initial)


class LinearFit(NamedTuple):
    """A Preisach model fitted, and what its posterior needs.

    - `at`: the unknowns at the minimum, `meaning` what they stand for.
    - `H`, `b`: the minimised x'Hx/2 - b'x over `rows` rows, prior included.
    - `strength`: lambda; `dropped`: whether the conditioning cycle was left out of the fit.
    - `blocks`: held-out mean squared errors, over scale^2, at that choice.
    """

    at: Float[np.ndarray, " unknowns"]
    meaning: Unknowns
    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    rows: int
    strength: float
    dropped: bool
    blocks: Float[np.ndarray, " blocks"]

    @property
    def model(self) -> Preisach:
        return self.meaning.model(self.at)

    def draws(
        self,
        noise: Noise,
        count: int,
        random: np.random.Generator,
        tell: Callable[[int], None] = lambda done: None,
    ) -> Float[np.ndarray, "count unknowns"]:
        """Draws from the projected Gaussian posterior: independent, and each a model there can be.

        x = argmin over those models of (x - z)'Q(x - z), z Gaussian about the unconstrained minimum
        with precision Q = rows H / (sigma^2 correlation_time). That moves b by a Gaussian with
        covariance H sigma^2 correlation_time / rows, and the solver of the fit projects.

        Source: Everink, Dong, Andersen, Bayesian inference with projected densities, SIAM/ASA J.
        Uncertainty Quantification 11 (2023).
        """
        variance = noise.sigma**2 * noise.correlation_time / self.meaning.scale**2 / self.rows
        factor = scipy.linalg.cholesky(self.H, lower=True) * np.sqrt(variance)
        found = np.empty((count, len(self.b)))
        for k in range(count):
            moved = self.b + factor @ random.normal(size=len(self.b))
            found[k] = _minimum(self.meaning, self.H, moved, self.at != 0)
            tell(k + 1)
        return found


def _minimum(
    meaning: Unknowns,
    H: Float[np.ndarray, "unknowns unknowns"],
    b: Float[np.ndarray, " unknowns"],
    start: Bool[np.ndarray, " unknowns"] | None = None,
) -> Float[np.ndarray, " unknowns"]:
    constraints = _slopes(meaning.cells, meaning.leading)[1]
    if len(constraints):
        return constrained_least_squares(H, b, constraints, meaning.free, start)
    return nonnegative_least_squares(H, b, meaning.free, start)


class PreisachProblem:
    """One shape of model (cells, orientation, initial state) on one record: its normal equations.

    Built once; fits for any choice of rows and prior strength then cost a few Cholesky factors.
    """

    def __init__(self, record: Record, parts: Parts, cells: int, leading: bool, initial: str):
        counted = parts.label >= 0
        u, y = record.input, np.where(counted, record.output, 0.0)
        low, high = float(u[counted].min()), float(u[counted].max())
        scale = float(np.ptp(y[counted]))
        self.meaning = Unknowns(cells, low, high, leading, initial, scale)
        self.parts, self.space, self.y = parts, NodeSpace(cells), y / scale
        self.substitution = _slopes(cells, leading)[0]
        self.smoothness = _smoothness(cells)
        template = self.meaning.model(np.zeros(self.meaning.count))
        self.B = design_rows(template, prepare(template, record))
        self.normal = {
            p: normal_equations(self.space, self.B[parts.label == p], self.y[parts.label == p])
            for p in parts.all
        }

    def objective(
        self, which: tuple[int, ...], strength: float
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]]:
        """H and b over some parts, in the unknowns with slacks."""
        total = self._total(which)
        H, b = total.H / total.rows, total.b / total.rows
        for block, prior in zip(self._blocks, self.smoothness, strict=True):
            H[block, block] += strength * np.trace(H[block, block]) / len(prior) * prior
        H[0, 0] *= 1 + 1e-12
        turned = self.substitution.T
        return np.asarray(turned @ (turned @ H).T), turned @ b

    def held_out_errors(self, strength: float, dropped: bool) -> Float[np.ndarray, " blocks"]:
        """Mean squared errors (in s^2) over ten blocks of rows of each fold's held-out part."""
        blocks = []
        for fold in self.parts.folds:
            train = self.parts.without_conditioning(fold.train, dropped)
            # Without the slope constraints of a leading model: close enough to rank by.
            H, b = self.objective(train, strength)
            z = self.substitution @ nonnegative_least_squares(H, b, self.meaning.free)
            rows = np.isin(self.parts.label, fold.test)
            error = self.B[rows] @ self.space.from_unknowns(z) - self.y[rows]
            blocks += block_errors(error)
        return np.array(blocks)

    @property
    def _blocks(self) -> tuple[slice, slice]:
        cells = self.meaning.cells
        return slice(1, 1 + cells), slice(1 + cells, None)

    def _total(self, which: tuple[int, ...]) -> Normal:
        first, *rest = (self.normal[p] for p in which)
        return sum(rest, first)


def fit_preisach(
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    initials: tuple[str, ...],
    cells: tuple[int, ...] = (20, 40),
) -> LinearFit:
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
    coarse_best = _best(first).problem
    shape = coarse_best.meaning
    choices = [c for c in first if c.problem is coarse_best]
    for n in finer:
        choices += tried(PreisachProblem(record, parts, n, shape.leading, shape.initial))
    best = _best(choices)

    def as_good(choice: _Choice) -> bool:
        worse = choice.blocks - best.blocks
        return bool(worse.mean() <= np.std(worse) / np.sqrt(len(worse)))

    problem, strength, dropped, blocks = next(
        c for c in choices if c.dropped == best.dropped and as_good(c)
    )
    which = parts.without_conditioning(parts.all, dropped)
    H, b = problem.objective(which, strength)
    rows = int(np.isin(parts.label, which).sum())
    at = _minimum(problem.meaning, H, b)
    return LinearFit(at, problem.meaning, H, b, rows, strength, dropped, blocks)


class _Choice(NamedTuple):
    problem: PreisachProblem
    strength: float
    dropped: bool
    blocks: Float[np.ndarray, " blocks"]


def _best(choices: list[_Choice]) -> _Choice:
    """The least held-out error; within a thousandth of it the first one named."""
    least = min(c.blocks.mean() for c in choices)
    return next(c for c in choices if c.blocks.mean() <= 1.001 * least)


@lru_cache(maxsize=8)
def _slopes(cells: int, leading: bool) -> tuple[Any, np.ndarray]:
    """Substitution (sparse) and constraints that keep every branch of a leading model from falling."""
    i, j = np.tril_indices(cells)
    weight = 1 + cells + np.arange(len(i))
    count = 1 + cells + len(i)
    identity = sparse.eye(count, format="csr")
    if not leading:
        return identity, np.zeros((0, count))
    # A half cell on the diagonal is swept twice as fast at its end: dE/df = 2 w f.
    swept = sparse.csr_matrix((np.where(i == j, 4.0, 2.0), (1 + i, weight)), shape=(count, count))
    substitution = (identity + swept).tocsr()
    constraints = np.zeros((cells, count))
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
