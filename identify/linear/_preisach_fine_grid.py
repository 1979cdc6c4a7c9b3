"""Non-negative least squares on a grid too fine for a normal matrix: by products through the tree.

The product of the normal matrix with a vector is one `evaluate` and one transposed `evaluate`. Block
principal pivoting needs the minimum over the variables inside its set; conjugate gradients find it,
preconditioned by the diagonal and by the same problem on a coarse grid, whose solution is the start.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from jaxtyping import Bool, Float
from scipy.sparse.linalg import LinearOperator, cg

from hysteresis import Preisach
from hysteresis.preisach import GridDensity
from hysteresis.preisach._preisach import PreisachInput

from ._nnls import nonnegative_least_squares
from ._preisach_problem import smoothness
from ._preisach_unknowns import GridUnknowns

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
