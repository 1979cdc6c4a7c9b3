"""Other ways to the outputs of a Preisach model on a grid, for comparison.

The relay of cell (i, j) stands at the cell's centre: u >= c_i turns it up, u <= c_j down. On inputs
that are grid nodes it is its whole cell, and all outputs agree. Each peer is the fastest of the
variants tried:

- `dense_scan`: the lower triangle as one row of booleans; the square, states of -1 and +1, and
  unrolled steps take 1.1 to 7 times as long.
- `dense_loop`: the same, states and sum in two passes, with bytes twice as fast as in one (with
  doubles 7 % slower); states of -1 and +1 take 1.2 times as long.
- `swept_loop`: sorted thresholds; a sweep of a row or column ends at the first relay that already
  is as it should be, since the boundary between up and down is a staircase.

On a uniform grid of at most 127 cells the dense ones may compare bytes, the numbers of the cells,
instead of thresholds: `byte_peers`.
"""

import importlib.util
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

DENSE_SCAN = "dense relay scan in JAX"
DENSE_LOOP = "dense compiled relay loop"
SWEPT_LOOP = "compiled loop over the relays swept"
"""Names of the peers."""

Peer = Callable[[], Any]
HAS_NUMBA = importlib.util.find_spec("numba") is not None


def centres(cells: int) -> np.ndarray:
    """Thresholds (cells,) of the relays over [0, 1]."""
    return (np.arange(cells) + 0.5) / cells


def triangle(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masses, switch-up and switch-down thresholds of the relays j <= i, each (relays,)."""
    i, j = np.tril_indices(len(weights))
    c = centres(len(weights))
    return weights[i, j], c[i], c[j]


def peers(weights: np.ndarray, u: np.ndarray) -> dict[str, Peer]:
    """Every peer that can run here, as a call that returns the outputs (samples,)."""
    calls = _dense_peers(*triangle(weights), u)
    if HAS_NUMBA:
        square = np.ascontiguousarray(weights), np.ascontiguousarray(weights.T)
        calls[SWEPT_LOOP] = partial(compiled(swept_loop), *square, centres(len(weights)), u)
    return calls


def byte_peers(weights: np.ndarray, u: np.ndarray) -> dict[str, Peer]:
    """The dense ones that compare how many centres are below an input with the numbers of cells."""
    i, j = np.tril_indices(len(weights))
    below = np.searchsorted(centres(len(weights)), u, side="right")
    return _dense_peers(weights[i, j], *(x.astype(np.int8) for x in (i + 1, j, below)))


def _dense_peers(
    mass: np.ndarray, up_at: np.ndarray, down_at: np.ndarray, u: np.ndarray
) -> dict[str, Peer]:
    relays = mass, up_at, down_at, u
    calls = {DENSE_SCAN: partial(dense_scan, *map(jnp.asarray, relays))}
    if HAS_NUMBA:
        calls[DENSE_LOOP] = partial(compiled(dense_loop, True), *relays)
    return calls


@cache
def compiled(loop: Callable[..., Any], reorder: bool = False) -> Callable[..., Any]:
    """`loop` compiled for one thread; `reorder` lets sums be taken in any order, for vectors."""
    import numba  # pyright: ignore[reportMissingImports]  (an extra)

    return numba.njit(fastmath=reorder)(loop)


@jax.jit
def dense_scan(mass: jax.Array, up_at: jax.Array, down_at: jax.Array, u: jax.Array) -> jax.Array:
    def step(up: jax.Array, x: jax.Array) -> tuple[jax.Array, jax.Array]:
        up = (x >= up_at) | (up & (x > down_at))
        return up, jnp.vdot(up.astype(mass.dtype), mass)

    raised = jax.lax.scan(step, jnp.zeros(mass.shape, bool), u)[1]
    return 2 * raised - mass.sum()


def dense_loop(mass, up_at, down_at, u):
    up = np.zeros(len(mass), np.int8)
    y = np.empty(len(u))
    for t in range(len(u)):
        x = u[t]
        for k in range(len(mass)):
            up[k] = (up[k] & (x > down_at[k])) | (x >= up_at[k])
        raised = 0.0
        for k in range(len(mass)):
            raised += mass[k] * up[k]
        y[t] = 2 * raised
    return y - mass.sum()


def swept_loop(mass, transposed, threshold, u):
    cells = len(threshold)
    up = np.zeros((cells, cells), np.bool_)
    y = np.empty(len(u))
    total = 0.0
    for i in range(cells):
        total -= mass[i, : i + 1].sum()
    passed = 0  # thresholds below the input
    for t in range(len(u)):
        x = u[t]
        while passed < cells and x >= threshold[passed]:
            for j in range(passed, -1, -1):
                if up[passed, j]:
                    break
                up[passed, j] = True
                total += 2 * mass[passed, j]
            passed += 1
        while passed > 0 and x < threshold[passed - 1]:
            passed -= 1
            for i in range(passed, cells):
                if not up[i, passed]:
                    break
                up[i, passed] = False
                total -= 2 * transposed[passed, i]
        y[t] = total
    return y


def look_up_loop(
    node, nodes, diagonal, corner, cell, cell_b, fraction, fraction_b, anchor, sign, level
):
    """What `evaluate` does for each sample once the Everett table and the levels are there."""
    y = np.empty(len(corner))
    for t in range(len(corner)):
        c, f, g = corner[t], fraction[t], fraction_b[t]
        at_a = node[c] * (1 - g) + node[c + 1] * g
        beyond_a = node[c + nodes] * (1 - g) + node[c + nodes + 1] * g
        half = diagonal[cell[t]] * f * (f - 1) + diagonal[cell_b[t]] * g * (g - 1)
        y[t] = level[anchor[t]] + sign[t] * (at_a * (1 - f) + beyond_a * f + half)
    return y
