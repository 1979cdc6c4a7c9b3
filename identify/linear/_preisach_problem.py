"""A Preisach fit of one shape: exact non-negative least squares with a smoothness prior.

With the unknowns x, z = P x the offset, reversible increments and weights, and s the output's range,

    |A x - y|^2 / (2 N s^2) + lambda/2 ( (n/20)^4 |D_w z|^2 + (n/20)^3 |D_r z|^2 )

is minimised under x >= 0 but for the offset, and C x >= 0 for a leading model. D_w are the
differences of the weights between neighbouring cells of n x n, D_r those of the increments; the powers
of n make lambda mean the same on every grid.
"""

from typing import Any

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse as sparse
from jaxtyping import Bool, Float

from hysteresis import Record

from ..records._folds import Parts, held_out_errors
from ..records._run_model import prepare
from ._correlated_noise import noise_behind, spread_over_rows
from ._cross_validation import JITTER, NormalEquations, total
from ._nnls import nonnegative_least_squares
from ._preisach_design_matrix import (
    CHUNK,
    design_rows,
    gathered,
    normal_equations,
    normal_matrix,
)
from ._preisach_unknowns import GridUnknowns

COARSE = 20
"""Cells of the grid on which the prior's strength is counted, and the first one tried."""


class PreisachProblem:
    """One kind of unknowns on one record: its normal equations, part by part.

    Built once; fits for any choice of rows and prior strength then cost a few Cholesky factors.
    """

    def __init__(self, record: Record, parts: Parts, meaning: GridUnknowns):
        self.meaning, self.parts = meaning, parts
        self.starts = record.starts
        self.y = np.where(parts.label >= 0, record.output, 0.0) / meaning.scale
        template = meaning.rising(np.zeros(meaning.count))
        self.B = design_rows(template, prepare(template, record))
        P = meaning.expansion
        self.prior = np.asarray((P.T @ smoothness(meaning) @ P).todense())
        self.normal = {
            p: normal_equations(
                meaning.space, self.B[parts.label == p], self.y[parts.label == p], P
            )
            for p in parts.all
        }

    def objective(
        self, which: tuple[int, ...], strength: float
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]]:
        """H and b of x'Hx/2 - b'x over some parts."""
        H, b = self.total(which).means
        H = H + strength * self.prior
        H[0, 0] *= 1 + JITTER
        return H, b

    def spread(
        self, which: tuple[int, ...], strength: float, x: Float[np.ndarray, " unknowns"]
    ) -> Float[np.ndarray, "unknowns unknowns"]:
        """Covariance of the b of a fit to some parts: what could as well have been measured.

            A' V A sigma^2 / N^2 + d d',      d = H (x_(lambda / 10) - x)

        The noise, AR(1), is that behind the residuals. The second term is the bias: how far the unknowns
        move under a prior of a tenth of the strength. Strengths are chosen by held-out errors, and a strong
        one that predicts well moves sums by up to two standard errors.
        """
        meaning, space, P = self.meaning, self.meaning.space, self.meaning.expansion
        chosen = np.isin(self.parts.label, which)
        B, rows = self.B[chosen].tocsc(), int(chosen.sum())
        sequences = _runs(self.starts, chosen)
        H, b = self.objective(which, strength)
        inside = np.flatnonzero((x != 0) | meaning.free)
        factor = scipy.linalg.cho_factor(H[np.ix_(inside, inside)])

        def left(noise: np.ndarray) -> np.ndarray:
            """What the fit leaves of noise, the signs of its unknowns held."""
            followed = np.zeros((len(x), noise.shape[1]))
            moved = gathered(space, B.T @ noise, P)[inside] / rows
            followed[inside] = scipy.linalg.cho_solve(factor, moved)
            nodes = [space.from_unknowns(z) for z in np.asarray(P @ followed).T]
            return noise - B @ np.stack(nodes, 1)

        residuals = self.y[chosen] - B @ space.from_unknowns(P @ x)
        noise = noise_behind(residuals, left, sequences)
        used = np.flatnonzero(np.diff(B.indptr))
        parts = [
            sparse.csc_matrix(
                B.T @ spread_over_rows(B[:, used[k : k + CHUNK]].toarray(), noise.phi, sequences)
            )
            for k in range(0, len(used), CHUNK)
        ]
        ones = np.ones(len(used)), (np.arange(len(used)), used)
        place = sparse.csc_matrix(ones, shape=(len(used), space.columns))
        spread: Any = sparse.hstack(parts) @ place
        S = normal_matrix(space, spread.tocsc(), P) / rows
        weaker = np.zeros_like(x)
        H_weaker = (H - 0.9 * strength * self.prior)[np.ix_(inside, inside)]
        weaker[inside] = scipy.linalg.solve(H_weaker, b[inside], assume_a="pos")
        bias = H @ (weaker - x)
        return noise.sigma**2 / rows * S + np.outer(bias, bias)

    def determined(
        self,
        which: tuple[int, ...],
        strength: float,
        x: Float[np.ndarray, " unknowns"],
        sums: Float[np.ndarray, "sums unknowns"],
    ) -> Bool[np.ndarray, " sums"]:
        """Which sums C x the data know rather than the prior: c'G H_d G c >= c'G c / 2.

        H_d is H without the prior, and G the inverse of H among the unknowns that are not zero.
        """
        H, _ = self.objective(which, strength)
        inside = np.flatnonzero((x != 0) | self.meaning.free)
        at, C = np.ix_(inside, inside), sums[:, inside]
        kernel = scipy.linalg.solve(H[at], C.T, assume_a="pos")
        of_prior = np.einsum("is,ij,js->s", kernel, strength * self.prior[at], kernel)
        return of_prior <= 0.5 * np.einsum("si,is->s", C, kernel)

    def held_out_errors(self, strength: float, dropped: bool) -> Float[np.ndarray, " blocks"]:
        """Mean squared errors (in s^2) over ten blocks of rows of each fold's held-out part."""
        meaning, start = self.meaning, None

        def solve(train: tuple[int, ...]) -> np.ndarray:
            nonlocal start
            # Without the slope constraints of a leading model: close enough to rank by.
            H, b = self.objective(self.parts.without_conditioning(train, dropped), strength)
            x = nonnegative_least_squares(H, b, meaning.free, start)
            start = x != 0
            return x

        def error(x: np.ndarray, test: tuple[int, ...]) -> np.ndarray:
            rows = np.isin(self.parts.label, test)
            return self.B[rows] @ meaning.space.from_unknowns(meaning.expansion @ x) - self.y[rows]

        return held_out_errors(self.parts.folds, solve, error)

    def log_evidence(
        self, strength: float, start: Bool[np.ndarray, " n"] | None = None
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Log marginal likelihood of a prior strength, but for a constant, and the x it leads to.

        For white Gaussian noise of unknown size and a Gaussian prior on the unknowns that are not held
        at zero: with J = |A x - y|^2 / N + lambda x'Kx at the minimum and both determinants over those,

            log p(y | lambda) = -(N log J + log det(A'A / N + lambda K) - log det(lambda K)) / 2.

        Source: MacKay, Bayesian interpolation, Neural Computation 4 (1992).
        """
        normal = self.total(self.parts.all)
        H, b = self.objective(self.parts.all, strength)
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
    for di, dj in ((1, 0), (0, 1)):
        here = np.flatnonzero((i + di < n) & (i + di >= j + dj))
        there = index[i[here] + di, j[here] + dj]
        row = np.tile(np.arange(len(here)), 2)
        values = np.concatenate([-density[here], density[there]])
        shape = (len(here), len(i))
        steps.append(sparse.csr_matrix((values, (row, np.concatenate([here, there]))), shape=shape))
    D_w, D_r = sparse.vstack(steps), sparse.csr_matrix(np.diff(np.eye(n), axis=0))
    weights = finer**4 * (D_w.T @ D_w) + 1e-3 * finer**2 * sparse.eye(len(i))
    increments = finer**3 * (D_r.T @ D_r) + 1e-6 * sparse.eye(n)
    # Relays that are up at first end at a staircase: hardly smooth.
    fitted = [0.01 * weights] * (meaning.initial == "fit")
    blocks = [sparse.csr_matrix((1, 1)), increments, weights, *fitted]
    return sparse.csr_matrix(sparse.block_diag(blocks))


def _runs(starts: np.ndarray, chosen: Bool[np.ndarray, " samples"]) -> list[slice]:
    """Among the chosen rows, those of one sequence that follow one another without a gap."""
    rows = np.flatnonzero(chosen)
    new = np.append(True, (np.diff(rows) > 1) | np.isin(rows[1:], starts))
    first = np.flatnonzero(new)
    return [slice(*ends) for ends in zip(first, [*first[1:], len(rows)], strict=True)]


def _log_determinant(H: np.ndarray, at: np.ndarray) -> float:
    factor = scipy.linalg.cholesky(H[np.ix_(at, at)], lower=True, check_finite=False)
    return 2 * float(np.log(np.diagonal(factor)).sum())
