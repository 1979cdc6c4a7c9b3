"""The weights of one grid from any history: prior strength by marginal likelihood, then the minimum."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import InputError, Preisach, Record
from hysteresis.preisach import Initial

from ..records._folds import Parts
from ..records._run_model import predict, prepare
from ._preisach_fine_grid import Coarse, solve_fine
from ._preisach_problem import PreisachProblem
from ._preisach_unknowns import GridUnknowns

DENSE = 60
"""Cells up to which the normal matrix is formed; finer grids are solved by products."""


class DensityFit(NamedTuple):
    """A Preisach model whose weights were fitted.

    - `model`, `unknowns`: the model; its unknowns in units of the output's range.
    - `strength`: the prior's lambda.
    - `residuals`: model less output at the rows that count, (rows,).
    """

    model: Preisach
    unknowns: Float[np.ndarray, " unknowns"]
    strength: float
    residuals: Float[np.ndarray, " rows"]


def fit_density(
    record: Record,
    cells: int = 50,
    *,
    strength: float | None = None,
    low: float | None = None,
    high: float | None = None,
    leading: bool = False,
    initial: Initial | str = "negative",
    dead_band: float = 0.0,
) -> DensityFit:
    """Fit offset, reversible part and all weights of one `cells` x `cells` grid to a record.

    Minimises |A x - y|^2 / (2 N s^2) + lambda/2 |D x|^2 with x >= 0, see `PreisachProblem`: exactly, by
    pivoting, and on fine grids by products that never form a matrix. Nothing is held out and
    nothing is chosen but lambda; `fit` chooses the rest.

    **Arguments:** `cells` along each threshold; `strength`, the prior's lambda, by the greatest marginal
    likelihood if None (for residuals that are white noise; on a grid of at most 60 cells, since it means
    the same on every one).

    **Other arguments:** `low`, `high`, the density's support, by default the input's range; `leading`,
    `initial` and `dead_band` as in `Preisach`, or `initial="fit"`.

    Raises `InputError` for a support that does not cover the data, a constant input or output, a
    leading model or a fitted first state on a fine grid.

    **Example:**

        >>> found = identify.fit_density(record, cells=6, strength=1e-3)
        >>> found.model.density.cells, round(float(np.std(found.residuals)), 2)
        (6, 0.44)
    """
    u, y = record.input[record.mask], record.output[record.mask]
    low = float(u.min()) if low is None else low
    high = float(u.max()) if high is None else high
    _check(u, y, cells, low, high, leading, initial)
    scale = float(np.ptp(y))
    whole = Parts(np.where(record.mask, 0, -1), (), None, "nothing held out")

    def problem(n: int) -> PreisachProblem:
        return PreisachProblem(
            record, whole, GridUnknowns(n, low, high, leading, initial, scale, dead_band)
        )

    if cells <= DENSE:
        dense = problem(cells)
        strength = dense.strength_by_evidence() if strength is None else strength
        meaning = dense.meaning
        unknowns = meaning.minimum(*dense.objective((0,), strength))
    else:
        grids = [problem(max(cells // 4, 8)), problem(cells // 2 if cells // 2 <= DENSE else DENSE)]
        strength = grids[-1].strength_by_evidence() if strength is None else strength
        coarse = tuple(Coarse(p.meaning, *p.objective((0,), strength)) for p in grids)
        meaning = GridUnknowns(cells, low, high, leading, initial, scale, dead_band)
        prepared = prepare(meaning.rising(np.zeros(meaning.count)), record)
        unknowns = solve_fine(
            meaning, prepared, record.output[record.mask] / scale, record.mask, strength, coarse
        )
    model = meaning.rising(unknowns)
    residuals = predict(model, record)[record.mask] - y
    return DensityFit(model, unknowns, strength, residuals)


def _check(
    u: np.ndarray, y: np.ndarray, cells: int, low: float, high: float, leading: bool, initial: Any
) -> None:
    if u.min() < low or u.max() > high:
        raise InputError(
            "out-of-range",
            f"the density reaches from {low:g} to {high:g}, the input from {u.min():g} to {u.max():g}.",
            fix="give low and high that enclose the input, or leave them out.",
        )
    if not (np.ptp(u) > 0 and np.ptp(y) > 0):
        raise InputError("zero-range", "the input or the output never changes.")
    if cells < 1:
        raise InputError("bad-option", f"a grid of {cells} cells.", fix="give 1 or more.")
    if cells > DENSE and (leading or initial == "fit"):
        raise InputError(
            "bad-option",
            f"a leading model, or a fitted first state, on {cells} x {cells} cells.",
            fix=f"give at most {DENSE} cells.",
        )
