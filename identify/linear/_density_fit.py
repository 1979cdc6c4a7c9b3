"""The weights of one grid from any history: prior strength by marginal likelihood, then the minimum.

Rows that memory does not hold come in blocks: sums are kept, and the extrema that the relays remember.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from jaxtyping import Bool, Float
from scipy.sparse.linalg import LinearOperator, cg

from hysteresis import InputError, Preisach, Record
from hysteresis.preisach import GridDensity, Initial
from hysteresis.preisach._preisach import PreisachInput

from ..records._folds import Parts
from ..records._new_record import predict, prepare
from ._nnls import nonnegative_least_squares
from ._preisach_design_matrix import NodeSums, design_blocks
from ._preisach_fit import PreisachObjective, PreisachProblem, smoothness
from ._preisach_unknowns import GridUnknowns
from ._unknown_vectors import in_units, relative

# Non-negative least squares on a grid too fine for a normal matrix: by products through the tree.
#
# The product of the normal matrix with a vector is one `evaluate` and one transposed `evaluate`. Block
# principal pivoting needs the minimum over the variables inside its set; conjugate gradients find it,
# preconditioned by the diagonal and by the same problem on a coarse grid, whose solution is the start.

Vector = Float[np.ndarray, " n"]


class Coarse(NamedTuple):
    """The problem on a coarse grid: objective x'Hx/2 - b'x of its own unknowns."""

    meaning: GridUnknowns
    H: Float[np.ndarray, "n n"]
    b: Vector


def solve_fine(
    meaning: GridUnknowns,
    prepared: PreisachInput,
    y: Float[np.ndarray, " samples"],
    counted: Bool[np.ndarray, " samples"],
    strength: float,
    coarse: tuple[Coarse, ...],
    tolerance: float = 1e-11,
) -> Vector:
    """The unknowns at the minimum, one for each cell, from coarser problems, the coarsest first.

    `tolerance` is that of the gradient over b's norm on the last set; the objective's error goes with
    its square.
    """
    K, rows = smoothness(meaning), jnp.asarray(np.flatnonzero(counted))
    template, like = meaning.rising(np.zeros(meaning.count)), jnp.zeros(meaning.count)

    def gathered(r: Any) -> Vector:
        return np.asarray(_transposed(template, prepared, rows, jnp.asarray(r), like)) / len(rows)

    def product(v: Vector) -> Vector:
        return gathered(_outputs(template, prepared, rows, jnp.asarray(v))) + strength * (K @ v)

    b = gathered(y)

    spreads = [_spread(c.meaning, meaning) for c in coarse]
    start = nonnegative_least_squares(coarse[0].H, coarse[0].b, coarse[0].meaning.free)
    for k in range(1, len(coarse)):
        inside = (spreads[k].T @ (spreads[k - 1] @ start)) != 0
        start = nonnegative_least_squares(coarse[k].H, coarse[k].b, coarse[k].meaning.free, inside)
    first = coarse[0]
    near = np.diagonal(first.H) - strength * smoothness(first.meaning).diagonal()
    diagonal = (spreads[0] > 0) @ near + strength * K.diagonal()
    factor = scipy.linalg.cho_factor(first.H)
    return _pivot(
        product, b, meaning.free, spreads[-1] @ start,
        lambda r: r / diagonal + spreads[0] @ scipy.linalg.cho_solve(factor, spreads[0].T @ r),
        tolerance,
    )  # fmt: skip


def _pivot(
    product: Callable[[Vector], Vector],
    b: Vector,
    free: Bool[np.ndarray, " n"],
    x: Vector,
    precondition: Callable[[Vector], Vector],
    tolerance: float,
) -> Vector:
    """Block principal pivoting by products; the accuracy grows as the set settles."""
    n = len(b)
    inside, scale = (x > 0) | free, float(np.abs(b).max())
    accuracy, fewest, patience = 1e-4, n + 1, 3
    while True:
        at = inside.astype(float)
        masked: Any = partial(LinearOperator, (n, n), dtype=float)
        x, _ = cg(
            masked(lambda v, at=at: at * product(at * v) + (1 - at) * v),
            at * b, at * x, rtol=accuracy, maxiter=10 * n,
            M=masked(lambda r, at=at: at * precondition(at * r)),
        )  # fmt: skip
        gradient = product(x) - b
        wrong = np.where(inside, (x < 0) & ~free, gradient < -accuracy * scale)
        count = int(wrong.sum())
        if count == 0 and accuracy <= tolerance:
            return np.where(free, x, np.maximum(x, 0.0))
        if count <= n // 100:
            accuracy = max(accuracy / 100, tolerance)
        if count < fewest or patience:
            patience = 3 if count < fewest else patience - 1
            fewest = min(fewest, count) or n + 1  # a finer accuracy starts anew
            inside = inside ^ wrong
        else:
            last = np.flatnonzero(wrong)[-1]
            inside[last] = not inside[last]


@jax.jit
def _outputs(template: Preisach, prepared: PreisachInput, rows: Any, v: Any) -> Any:
    assert isinstance(template.density, GridDensity)
    low, high, n = template.density.low, template.density.high, template.density.cells
    used = np.tril_indices(n)
    weights = jnp.zeros((n, n)).at[used].set(v[1 + n :], unique_indices=True)
    model = Preisach(
        GridDensity(low, high, weights, signed=True), v[1 : 1 + n], v[0],
        leading=template.leading, initial=template.initial, dead_band=template.dead_band,
    )  # fmt: skip
    return model.evaluate(prepared)[rows]


@jax.jit
def _transposed(template: Preisach, prepared: PreisachInput, rows: Any, r: Any, like: Any) -> Any:
    return jax.linear_transpose(lambda v: _outputs(template, prepared, rows, v), like)(r)[0]


def _spread(coarse: GridUnknowns, fine: GridUnknowns) -> Any:
    """(fine, coarse), sparse: coarse increments and masses over the finer cells, by area."""
    m, n = coarse.cells, fine.cells
    i, j = np.tril_indices(n)
    parent = np.arange(n) * m // n
    column = np.concatenate([[0], 1 + parent, 1 + m + parent[i] * (parent[i] + 1) // 2 + parent[j]])
    size = np.concatenate([np.ones(1 + n), np.where(i == j, 0.5, 1.0)])
    share = size / np.bincount(column, size)[column]
    return sparse.csr_matrix((share, (np.arange(len(column)), column)))


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
    scale, centre = float(np.ptp(y)), float(y.mean())
    whole = Parts(np.where(record.mask, 0, -1), (), None, "nothing held out")

    def meaning_of(n: int) -> GridUnknowns:
        return GridUnknowns(n, low, high, leading, initial, scale, dead_band, centre=centre)

    def problem(n: int) -> PreisachProblem:
        return PreisachProblem(record, whole, meaning_of(n))

    if cells <= DENSE:
        dense = problem(cells)
        strength = dense.strength_by_evidence() if strength is None else strength
        meaning = dense.meaning
        unknowns = meaning.minimum(*dense.objective((0,), strength))
    else:
        grids = [problem(max(cells // 4, 8)), problem(cells // 2 if cells // 2 <= DENSE else DENSE)]
        strength = grids[-1].strength_by_evidence() if strength is None else strength
        coarse = tuple(Coarse(p.meaning, *p.objective((0,), strength)) for p in grids)
        meaning = meaning_of(cells)
        prepared = prepare(meaning.rising(np.zeros(meaning.count)), record)
        unknowns = solve_fine(
            meaning, prepared, relative(meaning, y), record.mask, strength, coarse
        )
    model = meaning.rising(unknowns)
    residuals = predict(model, record)[record.mask] - y
    return DensityFit(model, in_units(meaning, unknowns) / scale, strength, residuals)


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


class BlockDensityFit(NamedTuple):
    """A Preisach model whose weights were fitted to blocks of rows.

    - `model`, `unknowns`: the model; its unknowns in units of the output's range.
    - `strength`: the prior's lambda. `rows`: how many there were.
    - `rmse`: the root of the mean squared residual, in the unit of the output.
    """

    model: Preisach
    unknowns: Float[np.ndarray, " unknowns"]
    strength: float
    rows: int
    rmse: float


def fit_density_in_blocks(
    blocks: Iterable[tuple[Float[np.ndarray, " rows"], ...]],
    cells: int = 50,
    *,
    low: float,
    high: float,
    strength: float | None = None,
    leading: bool = False,
    initial: Initial = "negative",
) -> BlockDensityFit:
    """`fit_density` for one long sequence of rows that come block by block, in bounded memory.

    The output is linear in the weights, so a block leaves nothing behind but sums of the size of the grid,
    and the extrema of the input that the relays remember. The blocks are gone through once. The result is
    that of `fit_density` on all rows together, to rounding.

    **Arguments:** `blocks`, pairs of inputs and outputs, in the order of time, such as slices of
    `np.load(path, mmap_mode="r")` or Parquet's `iter_batches`; `cells` along each threshold, at most 60;
    `low`, `high`, the density's support, which no input may leave.

    **Other arguments:** `strength`, `leading` and `initial` as in `fit_density`.

    Raises `InputError` `out-of-range` for an input outside of the support, `not-numbers` for one that is
    not finite, `zero-range` where input or output never change, and for other settings as `fit_density`.

    **Example:**

        >>> halves = zip(np.split(u, [50]), np.split(u**3, [50]))
        >>> found = identify.fit_density_in_blocks(halves, 6, low=u.min(), high=u.max(), strength=1e-3)
        >>> found.rows == len(u)
        True
    """
    if not 1 <= cells <= DENSE:
        raise InputError(
            "bad-option", f"a grid of {cells} cells.", fix=f"give 1 to {DENSE} of them."
        )
    if not low < high:
        raise InputError("zero-range", f"the density reaches from {low:g} to {high:g}.")
    meaning = GridUnknowns(cells, low, high, leading, initial, 1.0)
    grid, sums = meaning.rising(np.zeros(meaning.count)), NodeSums(meaning.space)
    least, most, centre = np.full(2, np.inf), np.full(2, -np.inf), 0.0
    for u, y in blocks:
        if not len(u):
            continue
        _check_block(u, y, sums.rows, low, high)
        centre = centre if sums.rows else float(np.mean(y))
        least = np.minimum(least, [u.min(), y.min()])
        most = np.maximum(most, [u.max(), y.max()])
        located = grid.located(np.asarray(u, float))
        for block in design_blocks(grid, located):
            sums.add(block, np.asarray(y[block.rows], float) - centre)
        grid = replace(grid, initial=_remembered(located, u))
    span, scale = (most - least).tolist()
    if not (sums.rows and span > 0 and scale > 0):
        raise InputError("zero-range", "the input or the output never changes.")
    meaning = GridUnknowns(cells, low, high, leading, initial, scale, centre=centre)
    normal = sums.equations(meaning.expansion, scale)
    problem = PreisachObjective(meaning, {0: normal})
    strength = problem.strength_by_evidence() if strength is None else strength
    unknowns = meaning.minimum(*problem.objective((0,), strength))
    rmse = scale * float(np.sqrt(normal.squared_error(unknowns) / normal.rows))
    model, unknowns = meaning.rising(unknowns), in_units(meaning, unknowns) / scale
    return BlockDensityFit(model, unknowns, strength, normal.rows, rmse)


def _remembered(located: PreisachInput, u: Float[np.ndarray, " rows"]) -> tuple[float, ...]:
    """Inputs that lead from all relays down to their state behind a block: open extrema, and the last."""
    tree, past = located.tree, len(located.before)
    found, anchor = [float(u[-1])], int(tree.anchor[-1])
    while anchor:
        place = int(located.place[anchor])
        found.append(float(located.before[place] if place < past else u[place - past]))
        anchor = int(tree.parent[anchor])
    return tuple(reversed(found))


def _check_block(u: np.ndarray, y: np.ndarray, rows: int, low: float, high: float) -> None:
    if len(u) != len(y):
        raise InputError("length-mismatch", f"a block of {len(u)} inputs and {len(y)} outputs.")
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        row = rows + int(np.flatnonzero(~(np.isfinite(u) & np.isfinite(y)))[0])
        raise InputError(
            "not-numbers", f"row {row} is not finite.", fix="leave such rows out of the blocks."
        )
    if u.min() < low or u.max() > high:
        raise InputError(
            "out-of-range",
            f"the density reaches from {low:g} to {high:g}, the input from {u.min():g} to {u.max():g}.",
            fix="give low and high that enclose the input.",
        )
