"""A Preisach fit of one shape: exact non-negative least squares with a smoothness prior.

With the unknowns x, z = P x the offset, reversible increments and weights, and s the output's range,

    |W (A x - y)|^2 / (2 N s^2) + lambda/2 ( (n/20)^4 |D_w z|^2 + (n/20)^3 |D_r z|^2 )

is minimised under x >= 0 but for the offset, and C x >= 0 for a leading model. W weighs the rows. D_w are
the differences of the weights between neighbouring cells of n x n, mainly along the diagonal, D_r those of
the increments; the powers of n make lambda mean the same on every grid.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse as sparse
from jaxtyping import Bool, Float

from hysteresis import Record

from ..records._folds import Parts, block_errors
from ..records._run_model import located
from ._cross_validation import NormalEquations, total
from ._nnls import nonnegative_least_squares
from ._preisach_design_matrix import DesignBlock, design_blocks
from ._preisach_normal_equations import normal_equations
from ._preisach_unknowns import GridUnknowns
from ._unknown_vectors import relative

COARSE = 20
"""Cells of the grid on which the prior's strength is counted, and the first one tried."""

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
