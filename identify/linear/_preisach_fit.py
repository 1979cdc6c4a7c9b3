"""Fitting a Preisach model on a grid: shape, resolution and prior strength, then the weights."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse as sparse
from jaxtyping import Bool, Float

from hysteresis import Record
from hysteresis.preisach import Initial

from .._levels import COARSE, PRIOR_STRENGTHS, WORTH
from ..noise._model import noise_behind, spread_over_rows
from ..records._folds import Parts, best_of, block_errors, earned, simplest
from ..records._new_record import located
from ..records._orientation import output_falls
from ._cross_validation import Choice, NormalEquations, total
from ._linear_fit import KnownSums, LinearFit
from ._nnls import nonnegative_least_squares
from ._preisach_design_matrix import DesignBlock, design_blocks, gathered, normal_equations
from ._preisach_unknowns import GridUnknowns, refined
from ._unknown_vectors import relative

# A Preisach fit of one shape: exact non-negative least squares with a smoothness prior.
#
# With the unknowns x, z = P x the offset, reversible increments and weights, and s the output's range,
#
#     |W (A x - y)|^2 / (2 N s^2) + lambda/2 ( (n/20)^4 |D_w z|^2 + (n/20)^3 |D_r z|^2 )
#
# is minimised under x >= 0 but for the offset, and C x >= 0 for a leading model. W weighs the rows. D_w
# are the differences of the weights between neighbouring cells of n x n, mainly along the diagonal, D_r
# those of the increments; the powers of n make lambda mean the same on every grid.

ACROSS = 0.3
"""Of the differences between cells whose thresholds are not equally far apart, beside those between cells
whose thresholds are: friction acts alike everywhere. A loop of one size leaves the rest open."""


class PreisachObjective:
    """The normal equations of one kind of unknowns, part by part, with the prior.

    Fits for any choice of rows and prior strength then cost a few Cholesky factors.
    """

    def __init__(self, meaning: GridUnknowns, normal: dict[int, NormalEquations]):
        self.meaning, self.normal = meaning, normal
        P = meaning.expansion
        self.prior = np.asarray((P.T @ smoothness(meaning) @ P).todense())

    def objective(
        self, which: tuple[int, ...], strength: float
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]]:
        """H and b of x'Hx/2 - b'x over some parts."""
        H, b = self.total(which).means
        H = H + strength * self.prior
        H[0, 0] *= 1 + len(H) * np.finfo(float).eps
        return H, b

    def log_evidence(
        self, strength: float, start: Bool[np.ndarray, " n"] | None = None
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Log marginal likelihood of a prior strength, but for a constant, and the x it leads to.

        For white Gaussian noise of unknown size and a Gaussian prior on the unknowns that are not held
        at zero: with J = |A x - y|^2 / N + lambda x'Kx at the minimum and both determinants over those,

            log p(y | lambda) = -(N log J + log det(A'A / N + lambda K) - log det(lambda K)) / 2.

        Source: MacKay, Bayesian interpolation, Neural Computation 4 (1992).
        """
        normal = self.total(tuple(self.normal))
        H, b = self.objective(tuple(self.normal), strength)
        x = nonnegative_least_squares(H, b, self.meaning.free, start)
        inside = np.flatnonzero(x)
        tied = inside[inside > 0]  # the offset has a flat prior
        J = normal.yy / normal.rows - b @ x
        told = _log_determinant(H, inside) - _log_determinant(strength * self.prior, tied)
        return -0.5 * float(normal.rows * np.log(max(J, 1e-300)) + told), x

    def strength_by_evidence(self) -> float:
        """The prior strength of the greatest marginal likelihood, to a quarter of a decade."""
        start: Bool[np.ndarray, " n"] | None = None

        def loss(exponent: float) -> float:
            nonlocal start
            value, x = self.log_evidence(10.0**exponent, start)
            start = x != 0
            return -value

        found = scipy.optimize.minimize_scalar(
            loss, bounds=(-8.0, 1.0), method="bounded", options={"xatol": 0.25}
        )
        return float(10.0**found.x)

    def total(self, which: tuple[int, ...]) -> NormalEquations:
        """The normal equations over some parts, without prior."""
        return total(self.normal[p] for p in which)


class PreisachProblem(PreisachObjective):
    """One kind of unknowns on one record: its normal equations, and what it predicts of held-out parts."""

    def __init__(self, record: Record, parts: Parts, meaning: GridUnknowns):
        self.parts, self.starts, self.weights = parts, record.starts, record.weights
        self.y = np.where(parts.label >= 0, relative(meaning, record.output), 0.0)
        self.template = meaning.rising(np.zeros(meaning.count))
        self.prepared = located(self.template, record)
        P, blocks = meaning.expansion, self.blocks()
        w = None if record.sigma is None else self.weights
        normal = normal_equations(meaning.space, blocks, self.y, parts.label, P, w)
        super().__init__(meaning, dict(normal))

    def blocks(self) -> Iterator[DesignBlock]:
        """The design, block by block: it is made anew each time, which takes less than to keep it."""
        return design_blocks(self.template, self.prepared)

    def outputs(self, unknowns: Float[np.ndarray, "unknowns batch"]) -> np.ndarray:
        """The output of every sample, over `scale`, for columns of unknowns."""
        nodes = self.nodes(unknowns)
        return np.concatenate([block.product(nodes) for block in self.blocks()])

    def nodes(self, unknowns: Float[np.ndarray, "unknowns batch"]) -> np.ndarray:
        """Columns of unknowns in node space."""
        z = np.asarray(self.meaning.expansion @ unknowns)
        return np.stack([self.meaning.space.from_unknowns(one) for one in z.T], 1)

    def held_out_errors(self, strengths: Sequence[float]) -> list[Float[np.ndarray, " blocks"]]:
        """Mean squared errors (in s^2) over ten blocks of rows of each fold's held-out part.

        All prior strengths share one pass over the rows.
        """
        folds, columns = self.parts.folds, []
        for strength in strengths:
            start: Bool[np.ndarray, " n"] | None = None
            for fold in folds:
                # Without the slope constraints of a leading model: close enough to rank by.
                H, b = self.objective(fold.train, strength)
                x = nonnegative_least_squares(H, b, self.meaning.free, start)
                columns.append(x)
                start = x != 0
        nodes = self.nodes(np.stack(columns, 1))
        # Of each fold, the columns of all that is tried.
        of_fold = [slice(k, None, len(folds)) for k in range(len(folds))]
        errors = [[np.zeros((0, len(strengths)))] for _ in folds]
        for block in self.blocks():
            label, y, w = (x[block.rows] for x in (self.parts.label, self.y, self.weights))
            for fold, at, found in zip(folds, of_fold, errors, strict=True):
                if (rows := np.isin(label, fold.test)).any():
                    found.append(
                        w[rows, None] * (block.product(nodes[:, at])[rows] - y[rows, None])
                    )
        each = [np.concatenate(found) for found in errors]
        return [
            np.concatenate([block_errors(error[:, k]) for error in each])
            for k in range(len(strengths))
        ]


def smoothness(meaning: GridUnknowns) -> sparse.csr_matrix:
    """K, sparse, in the space of z: x'P'KPx is what the prior weighs with lambda.

    A trace of ridge makes it definite.
    """
    n = meaning.cells
    finer = n / COARSE
    i, j = np.tril_indices(n)
    index = np.full((n + 1, n + 1), -1)
    index[i, j] = np.arange(len(i))
    density = np.where(i == j, 2.0, 1.0)  # mass to density: half cells have half the area
    steps = []
    for di, dj, size in ((1, 1, 1.0), (1, 0, ACROSS), (0, 1, ACROSS)):
        here = np.flatnonzero((i + di < n) & (i + di >= j + dj))
        there = index[i[here] + di, j[here] + dj]
        row = np.tile(np.arange(len(here)), 2)
        values = size * np.concatenate([-density[here], density[there]])
        shape = (len(here), len(i))
        steps.append(sparse.csr_matrix((values, (row, np.concatenate([here, there]))), shape=shape))
    D_w, D_r = sparse.vstack(steps), sparse.csr_matrix(np.diff(np.eye(n), axis=0))
    weights = finer**4 * (D_w.T @ D_w) + 1e-3 * finer**2 * sparse.eye(len(i))
    increments = finer**3 * (D_r.T @ D_r) + 1e-6 * sparse.eye(n)
    # Relays that are up at first end at a staircase: hardly smooth.
    fitted = [0.01 * weights] * (meaning.initial == "fit")
    blocks = [sparse.csr_matrix((1, 1)), increments, weights, *fitted]
    return sparse.csr_matrix(sparse.block_diag(blocks))


def _log_determinant(H: np.ndarray, at: np.ndarray) -> float:
    factor = scipy.linalg.cholesky(H[np.ix_(at, at)], lower=True, check_finite=False)
    return 2 * float(np.log(np.diagonal(factor)).sum())


# What a Preisach fit says of the sums of its weights: their covariance, and which the data determine.


def known_sums(
    problem: PreisachProblem,
    which: tuple[int, ...],
    strength: float,
    x: Float[np.ndarray, " unknowns"],
) -> KnownSums:
    """What a fit of some parts knows of the sums C x of its unknowns.

        covariance = K' (A' W V W A sigma^2 / N^2 + d d') K,      K = G C',      d = H (x_(lambda / 10) - x)

    W weighs the rows, G is the inverse of H among the unknowns that are not zero. The noise, AR(1) with the
    correlations V, is that behind the residuals. The second term is the bias: how far the unknowns move
    under a prior of a tenth of the strength. Strengths are chosen by held-out errors, and a strong one that
    predicts well moves sums by up to two standard errors.

    A sum is determined if c'G H_d G c >= c'G c / 2, with H_d the H without the prior.
    """
    meaning = problem.meaning
    chosen = np.isin(problem.parts.label, which)
    w = problem.weights[chosen, None]
    rows = int(chosen.sum())
    H, b = problem.objective(which, strength)
    inside = np.flatnonzero((x != 0) | meaning.free)
    at = np.ix_(inside, inside)
    factor = scipy.linalg.cho_factor(H[at])
    C = meaning.sums[:, inside]
    K = scipy.linalg.cho_solve(factor, C.T, check_finite=False)

    def over_all(among: Float[np.ndarray, "inside batch"]) -> np.ndarray:
        found = np.zeros((len(x), among.shape[1]))
        found[inside] = among
        return found

    def left(noise: np.ndarray) -> np.ndarray:
        """What the fit leaves of noise, the signs of its unknowns held."""
        values, turned = np.zeros((len(chosen), noise.shape[1])), 0.0
        values[chosen] = w * noise
        for block in problem.blocks():
            turned = turned + block.transposed(values[block.rows])
        moved = gathered(meaning.space, turned, meaning.expansion)[inside] / rows
        followed = problem.outputs(over_all(scipy.linalg.cho_solve(factor, moved)))
        return noise - w * followed[chosen]

    # One pass over the rows: the fit itself, and what each sum reads of them.
    found = w * problem.outputs(np.hstack([x[:, None], over_all(K)]))[chosen]
    sequences = runs(problem.starts, chosen)
    noise = noise_behind(w[:, 0] * problem.y[chosen] - found[:, 0], left, sequences)
    read = found[:, 1:]
    spread = noise.sigma**2 / rows**2 * (read.T @ spread_over_rows(read, noise.phi, sequences))
    H_weaker = H[at] - 0.9 * strength * problem.prior[at]
    weaker = over_all(scipy.linalg.solve(H_weaker, b[inside], assume_a="pos")[:, None])[:, 0]
    bias = K.T @ (H @ (weaker - x))[inside]
    of_prior = np.einsum("is,ij,js->s", K, strength * problem.prior[at], K)
    determined = (of_prior <= 0.5 * np.einsum("si,is->s", C, K))[: len(meaning.totals)]
    return KnownSums(spread + np.outer(bias, bias), determined, bias)


def runs(starts: np.ndarray, chosen: Bool[np.ndarray, " samples"]) -> list[slice]:
    """Among the chosen rows, those of one sequence that follow one another without a gap."""
    rows = np.flatnonzero(chosen)
    new = np.append(True, (np.diff(rows) > 1) | np.isin(rows[1:], starts))
    first = np.flatnonzero(new)
    return [slice(*ends) for ends in zip(first, [*first[1:], len(rows)], strict=True)]


Tried: TypeAlias = Choice[PreisachProblem]
NodesOf: TypeAlias = Callable[[int], tuple[float, ...] | None]
"""The nodes of a grid of so many cells; None for cells of one width."""

GRIDS = (COARSE, 2 * COARSE, 4 * COARSE)
"""Cells of the grids tried, each of the later ones refined where the one before has its mass."""


def steep_nodes(
    u: Float[np.ndarray, " rows"], y: Float[np.ndarray, " rows"], cells: int
) -> tuple[float, ...]:
    """Nodes of a grid whose cells are small where the output is steep.

    Half of them are even over the inputs, half over the mean way of the output, so no cell is wider than
    two of one width. Those of a grid with twice the cells lie between them.
    """
    ends = np.sort([u[:-1], u[1:]], axis=0)
    inputs = np.unique(u)
    begin, end = np.searchsorted(inputs, ends)
    moved = end > begin
    slope = np.abs(np.diff(y))[moved] / np.diff(ends, axis=0)[0, moved]
    # Of every step between neighbouring inputs: the sum of the slopes across it, and of how many pairs.
    passes = np.zeros((2, len(inputs)))
    for one, size in zip(passes, (slope, np.ones_like(slope)), strict=True):
        np.add.at(one, begin[moved], size)
        np.add.at(one, end[moved], -size)
    total, count = np.cumsum(passes, axis=1)[:, :-1]
    passed = np.append(0.0, np.cumsum(total / np.maximum(count, 1.0) * np.diff(inputs)))
    even = (inputs - inputs[0]) / (inputs[-1] - inputs[0])
    steep = passed / passed[-1] if passed[-1] > 0 else even
    return tuple(np.interp(np.linspace(0, 1, cells + 1), (even + steep) / 2, inputs).tolist())


def fit_preisach(
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    initials: tuple[Initial | str, ...],
    cells: tuple[int, ...] = GRIDS,
    dead_band: float = 0.0,
) -> tuple[LinearFit[GridUnknowns], Parts]:
    """Fit every shape, choose shape, grid and prior strength, refit on all the training parts.

    Orientation and initial state show on the first, coarse grid. Each finer one has twice the cells
    and splits only those that hold a share of the mass; it is tried as long as the one before lowered the
    held-out error by a tenth and the rows outnumber its unknowns two to one. Where the output is three
    times as steep as on average, and a coarse grid of `steep_nodes` has an error a tenth below that of all
    of them, it is refined instead.

    Among the choices whose held-out error is above the best one's by less than the standard error
    of that difference, paired by blocks of rows, the simplest is taken: fewer cells, then a stronger prior.
    A conditioning cycle is left out of the fit where that takes away a part of the held-out error, see
    `earned`: the parts that are given back say so.
    """
    merged = parts.merged
    counted = merged.label >= 0
    u, y = record.input[counted], record.output[counted]
    low, high = float(u.min()), float(u.max())
    scale, centre = float(np.ptp(y)) * (-1 if output_falls(record) else 1), float(y.mean())

    def tried(problem: PreisachProblem, strengths: Iterable[float]) -> list[Tried]:
        strengths = list(strengths)
        blocks = problem.held_out_errors(strengths)
        return [
            Choice(problem, strength, own) for strength, own in zip(strengths, blocks, strict=True)
        ]

    coarse, *finer = cells
    shapes = [
        GridUnknowns(coarse, low, high, leading, initial, scale, dead_band, centre=centre)
        for leading in leadings
        for initial in initials
    ]
    choices = [
        choice
        for shape in shapes
        for choice in tried(PreisachProblem(record, merged, shape), PRIOR_STRENGTHS)
    ]
    best = _best(choices)
    shape = best.problem.meaning

    def path(choices: list[Tried], nodes_of: NodesOf) -> list[Tried]:
        """These choices of a coarse grid, and those of the finer ones that are tried after it."""
        best = _best(choices)
        for n in finer:
            before, meaning = best, best.problem.meaning
            block = refined(meaning.block, meaning.masses(_fitted(best).unknowns))
            meaning = shape._replace(cells=n, blocks=block, nodes=nodes_of(n))
            if n > 2 * coarse and 2 * meaning.count > len(u):
                break
            problem = PreisachProblem(record, merged, meaning)
            choices = choices + tried(problem, (best.strength * k for k in (10.0, 1.0, 0.1, 0.01)))
            best = _best(choices)
            if best.blocks.mean() > (1 - WORTH) * before.blocks.mean():
                break
        return choices

    choices = path([c for c in choices if c.problem is best.problem], lambda n: None)
    best = _best(choices)
    nodes = steep_nodes(u, y, coarse)
    # Where no cell is half as wide as an even one, the next even grid does the same.
    if finer and 2 * coarse * np.diff(nodes).min() < high - low:
        problem = PreisachProblem(record, merged, shape._replace(nodes=nodes))
        steep = tried(problem, PRIOR_STRENGTHS)
        if _best(steep).blocks.mean() < (1 - WORTH) * best.blocks.mean():
            choices = path(steep, lambda n: steep_nodes(u, y, n))
            best = _best(choices)
    chosen = simplest(choices, best)
    if parts.conditioning is not None:
        later = copy(chosen.problem)
        later.parts = merged.conditioned
        (fewer,) = tried(later, [chosen.strength])
        if earned(chosen.blocks, fewer.blocks):
            chosen, parts = fewer, parts.conditioned
    return _fitted(chosen, final=True), parts


def _best(choices: list[Tried]) -> Tried:
    """The least held-out error; within a thousandth of it the first one named."""
    least = best_of(choices).blocks.mean()
    return next(c for c in choices if c.blocks.mean() <= 1.001 * least)


def _fitted(choice: Tried, final: bool = False) -> LinearFit[GridUnknowns]:
    """A choice, fitted to all the training parts; the `final` one with what it knows of sums."""
    problem, meaning = choice.problem, choice.problem.meaning
    which = problem.parts.fitted
    H, b = problem.objective(which, choice.strength)
    unknowns = meaning.minimum(H, b)
    fit = LinearFit(
        unknowns, meaning, H, b, problem.total(which).rows,
        choice.strength, choice.blocks,
    )  # fmt: skip
    if not final:
        return fit
    return replace(fit, known=known_sums(problem, which, choice.strength, unknowns))
