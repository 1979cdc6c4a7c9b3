"""The prior of a composition's unknowns: neighbours are alike.

Of unknowns none of which is negative, neighbouring increments are alike and strengths bend little. Those of
either sign are, of each part,

    w_part ~ normal(0, s K),   K_ij = exp(-|p_i - p_j|^2 / 2) + 1/20 if i = j

with p the places of the weights: cells of a curve, thresholds, levels, times. A curve is a line besides.
Cost: the inverse of one matrix for each part.
"""

from functools import lru_cache

import numpy as np
import scipy.linalg
from jaxtyping import Float

from ._composition_parts import (
    CELLS,
    CURVE,
    DRIFT,
    FRICTION,
    IN_A_ROW,
    MAXWELL,
    RELAYS,
    SOFTENING,
    STRENGTHS,
    TIME_DRIFT,
)
from ._group_strengths import APART, kernel
from ._sliders import COLUMNS, LEVELS, PLACE_STOPS, PLAYS, SPAN_STOPS, STOPS, THRESHOLDS

Matrix = Float[np.ndarray, "unknowns unknowns"]

FIRMNESS = {
    CURVE: 1.0, MAXWELL: 10.0, STRENGTHS: 0.1, SOFTENING: 10.0, RELAYS: 10.0,
    PLAYS: 1.0, STOPS: 1.0, PLACE_STOPS: 1.0, SPAN_STOPS: 1.0, FRICTION: 1.0, DRIFT: 1.0,
    TIME_DRIFT: 1.0,
}  # fmt: skip
"""How much stronger the prior holds a part than the curve."""

BAND_FIRMNESS = 30.0
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
