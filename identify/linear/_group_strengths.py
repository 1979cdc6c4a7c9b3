"""Groups of columns whose prior strengths are those that predict held-out rows best.

The weights of every group g are small as far as its strength s_g says, and neighbours are alike:

    minimise |y - X w|^2 + sum_g w_g' K_g^-1 w_g / s_g

with K_g scaled so that the group brings a variance of s_g. The strengths minimise the mean logarithm of the
squared errors of folds, whose weights are in closed form: one Cholesky factorisation of p unknowns for each
fold and trial, and the gradient by log s_g is one more solution,

    d log e / d log s_g = 2 (A^-1 r)_g' P_g w_g / e,   A = X'X + P,  r = X't (X_t w - y_t)

over the trained rows and the held-out rows t. Residuals here are errors of the model, not noise: held-out
rows tell more of a strength than the likelihood of all rows does. Columns are of unit variance, and each
group is turned to where its prior is a multiple of the identity.

Cost: some hundred factorisations, p^3/3 each; for 400 unknowns and 9 folds about two seconds.

Source: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning (2009), section 7.10; Rasmussen
and Williams, Gaussian Processes for Machine Learning (2006), section 5.4.2.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int
from scipy.optimize import minimize

from .._levels import LITTLE, ROUNDING, STEPS
from ..records._folds import Fold
from ._composition_parts import (
    CELLS,
    COLUMNS,
    CURVE,
    DRIFT,
    FRICTION,
    IN_A_ROW,
    LEVELS,
    MAXWELL,
    PLACE_STOPS,
    PLAYS,
    RELAYS,
    SOFTENING,
    SPAN_STOPS,
    STOPS,
    STRENGTHS,
    THRESHOLDS,
    TIME_DRIFT,
)
from ._cross_validation import NormalEquations, total

NEIGHBOURS = 0.05
"""Share of a group's prior that each weight has for itself."""

APART = 100.0
"""Between groups of neighbours, in units of `Group.places`: they have nothing in common."""

CENTRE, EXPECTED, WIDTH = np.log(0.01), np.log(10.0), 3.0
"""Of the logarithm of a strength before any row is seen, in parts of the noise of a row."""

FOLDS_TELL = 30.0
"""What the mean logarithm of the folds' errors weighs against that."""


class Group(NamedTuple):
    """Columns that share a strength.

    - `columns`: where they stand. `places`: of each, in units in which neighbours at 1 are half alike.
    - `is_expected`: whether it is there before any row is seen, like a straight line.
    """

    columns: Int[np.ndarray, " columns"]
    places: Float[np.ndarray, "columns dimensions"]
    is_expected: bool = False


class GroupedColumns:
    """Columns turned to where the prior of each group is a multiple of the identity.

    - `even`: the prior is of weights of columns of unit variance, otherwise of those of the columns.
    - `whitened`: (rows, unknowns) with the offset last. `brought`: the variance that each group brings with
      `kernel` as its prior.
    """

    def __init__(
        self, X: Float[np.ndarray, "rows columns"], groups: Sequence[Group], even: bool = True
    ) -> None:
        self.mean, size = X.mean(0), X.std(0)
        self.told = size > LITTLE * size.max(initial=0.0)
        self.size = np.where(self.told & even, size, 1.0)
        Z = (X - self.mean) / self.size
        turned, of, brought = [], [], []
        for k, group in enumerate(groups):
            columns = group.columns[self.told[group.columns]]
            places = group.places[self.told[group.columns]]
            T, variance = _turn(Z[:, columns], places)
            turned.append((columns, T))
            brought.append(variance)
            of += [k] * T.shape[1]
        self.turned, self.of, self.count = turned, np.array(of, int), X.shape[1]
        self.brought = np.array(brought)
        self.expected = np.array([group.is_expected for group in groups])
        parts = [Z[:, columns] @ T for columns, T in turned]
        self.whitened = np.hstack([*parts, np.ones((len(X), 1))])

    def weights(
        self, unknowns: Float[np.ndarray, " unknowns"]
    ) -> tuple[Float[np.ndarray, " columns"], float]:
        """The weight of each column, and the offset."""
        found, end = np.zeros(self.count), 0
        for columns, T in self.turned:
            begin, end = end, end + T.shape[1]
            found[columns] += T @ unknowns[begin:end] / self.size[columns]
        return found, float(unknowns[-1] - found @ self.mean)


def kernel(places: Float[np.ndarray, "columns dimensions"]) -> Float[np.ndarray, "columns columns"]:
    """How alike weights are: half at a distance of 1, and each a little by itself."""
    apart = ((places[:, None] - places[None]) ** 2).sum(-1)
    return np.exp(-apart / 2) + NEIGHBOURS * np.eye(len(places))


def _turn(
    Z: Float[np.ndarray, "rows columns"], places: np.ndarray
) -> tuple[Float[np.ndarray, "columns unknowns"], float]:
    if not Z.shape[1]:
        return np.zeros((0, 0)), 1.0
    K, G = kernel(places), Z.T @ Z / len(Z)
    variance = float(np.trace(K @ G))
    root = np.real(scipy.linalg.sqrtm(K / variance))
    value, vector = np.linalg.eigh(root @ G @ root)
    return root @ vector[:, value > ROUNDING * value.max()], variance


class Strengths:
    """The search for the strengths, and the weights that follow.

    - `normal`: the normal equations of each part of the rows; `held`: of those that are judged, if others.
    - `folds`: which parts are left out when.
    """

    def __init__(
        self,
        columns: GroupedColumns,
        normal: dict[int, NormalEquations],
        folds: Sequence[Fold],
        held: dict[int, NormalEquations] | None = None,
    ) -> None:
        self.columns, self.normal = columns, normal
        held = normal if held is None else held
        self.sides = [
            (total(normal[p] for p in fold.train), total(held[p] for p in fold.test))
            for fold in folds
        ]
        self.before = np.where(columns.expected, EXPECTED, CENTRE)
        self.logs = minimize(
            self.objective, self.before, jac=True, method="L-BFGS-B", options={"maxiter": STEPS},
            bounds=[(-30.0, 8.0)] * len(self.before),
        ).x  # fmt: skip

    def _precision(self, logs: np.ndarray) -> np.ndarray:
        return np.append(np.exp(-logs)[self.columns.of], 1e-2)

    def solution(self, which: Sequence[int]) -> Float[np.ndarray, " unknowns"]:
        """The unknowns from some parts, with the strengths found."""
        normal = total(self.normal[p] for p in which)
        A = normal.H + np.diag(self._precision(self.logs))
        return scipy.linalg.solve(A, normal.b, assume_a="pos")

    def objective(self, logs: np.ndarray) -> tuple[float, np.ndarray]:
        """What the strengths minimise, by their logarithms, and its gradient."""
        precision = self._precision(logs)
        away = (logs - self.before) / WIDTH
        value, slope = away @ away / 2, away / WIDTH
        share = FOLDS_TELL / len(self.sides)
        for normal, held in self.sides:
            factor = scipy.linalg.cho_factor(
                normal.H + np.diag(precision), lower=True, check_finite=False
            )
            w = scipy.linalg.cho_solve(factor, normal.b, check_finite=False)
            r = held.H @ w - held.b
            error = held.squared_error(w) / held.rows + 1e-7
            back = scipy.linalg.cho_solve(factor, r, check_finite=False)
            each = 2 * back * precision * w / held.rows / error
            value += share * np.log(error)
            slope = slope + share * np.bincount(self.columns.of, each[:-1], minlength=len(logs))
        return float(value), slope


# The prior of a composition's unknowns: neighbours are alike.
#
# Of unknowns none of which is negative, neighbouring increments are alike and strengths bend little.
# Those of either sign are, of each part,
#
#     w_part ~ normal(0, s K),   K_ij = exp(-|p_i - p_j|^2 / 2) + 1/20 if i = j
#
# with p the places of the weights: cells of a curve, thresholds, levels, times. A curve is a line besides.
# Cost: the inverse of one matrix for each part.

Matrix = Float[np.ndarray, "unknowns unknowns"]

FIRMNESS = {
    CURVE: 1.0, MAXWELL: 10.0, STRENGTHS: 0.1, SOFTENING: 10.0, RELAYS: 10.0,
    PLAYS: 1.0, STOPS: 1.0, PLACE_STOPS: 1.0, SPAN_STOPS: 1.0, FRICTION: 1.0, DRIFT: 1.0,
    TIME_DRIFT: 1.0,
}  # fmt: skip
"""How much stronger the prior holds a part than the curve."""

BAND_FIRMNESS = 10.0
"""How much stronger the prior holds a band alone than a stop. It lets branches yield and stiffen again."""

RIDGE = 1e-7
"""Pulls what the data leave open to 0; in squares of the output's range. Strengths are pulled ten times as
hard: at rates that were not tried they say what the curve does not."""

LENGTH = 4.0
"""Of a row of levels, in units in which neighbours at 1 are half alike."""


def prior(
    parts: tuple[str, ...], sizes: tuple[int, ...], shares: tuple[float, ...], strength: float
) -> Matrix:
    """The matrix of the prior's squares, the offset first, which is free.

    `shares`: of a line and of each part, how large weights of either sign are expected; () where no unknown
    is negative.
    """
    blocks = [np.zeros((1, 1))]
    if not shares:
        blocks += [_rising(part, size, strength) for part, size in zip(parts, sizes, strict=True)]
    else:
        for part, size, share in zip(parts, sizes, shares[1:], strict=True):
            line = shares[0] if part == CURVE else 0.0
            blocks.append(strength * _of_either_sign(part, size, share, line))
    return np.asarray(scipy.linalg.block_diag(*blocks))


def _rising(part: str, size: int, strength: float) -> Matrix:
    n = CELLS.get(part, 0)
    if part in (CURVE, MAXWELL):
        D = np.diff(np.eye(n), axis=0)
        each = n * D.T @ D
    elif part == STRENGTHS:
        D = n * np.diff(np.eye(n + 1), 2, axis=0)
        each = D.T @ D / (n + 1)
    elif part in LEVELS:
        firm = np.ones((COLUMNS[part], len(LEVELS[part])))
        firm[len(THRESHOLDS) : 2 * len(THRESHOLDS)] = BAND_FIRMNESS
        each = np.diag(firm.ravel())
    else:
        each = np.eye(size)
    ridge = 10 * RIDGE if part == STRENGTHS else RIDGE
    own = strength * FIRMNESS[part] * each + ridge * np.eye(len(each))
    return np.kron(np.eye(size // len(each)), own)


@lru_cache(maxsize=32)  # several folds have the same prior
def _of_either_sign(part: str, size: int, share: float, line: float) -> Matrix:
    covariance = share * kernel(places_of(part, size)) + line
    factor = scipy.linalg.cho_factor(covariance, lower=True)
    return scipy.linalg.cho_solve(factor, np.eye(size))


def places_of(part: str, size: int) -> Float[np.ndarray, "size dimensions"]:
    """Where the weights of a part stand."""
    k = np.arange(size)
    if part == CURVE:
        return k[:, None] / 4
    if part in (SOFTENING, RELAYS):
        return np.column_stack(np.tril_indices(CELLS[part])) / 2
    levels = IN_A_ROW.get(part, 1)
    outer, inner = np.divmod(k, levels)
    along = LENGTH * inner / max(levels - 1, 1)
    if part not in LEVELS:
        return np.column_stack([outer, along])
    kind, threshold = np.divmod(outer, len(THRESHOLDS))
    return np.column_stack([threshold / 1.5, along, APART * kind])
