"""Linear recurrences z_k = a_k z_(k-1) + b_k, one sample after the other.

Their derivative is the same recurrence, driven by da_k z_(k-1) + db_k. So forward and reverse mode need
only a and z; reverse mode runs the transposed recurrence backwards.
"""

from functools import partial
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

Rows = tuple[Float[Array, " samples"], ...]
Numbers = tuple[Float[Array, ""], ...]

AT_ONCE = 3
"""Recurrences in one loop on a CPU. Each of three takes 2 ns a sample, a single one 4, and each of many 50,
because XLA calls the operations of a large loop body one by one."""


@jax.custom_jvp
def linear_recurrence(a: Rows, b: Rows) -> Rows:
    """z_k = a_k z_(k-1) + b_k with z_(-1) = 0, for scalars: several independent recurrences, each with
    arrays of its own."""
    return _solve(a, b)


@linear_recurrence.defjvp
def _derivative(primals: tuple[Rows, Rows], tangents: tuple[Rows, Rows]) -> tuple[Rows, Rows]:
    (a, b), (da, db) = primals, tangents
    z = linear_recurrence(a, b)
    rows = zip(da, z, db, strict=True)
    return z, _solve(a, tuple(slope * _before(x) + drive for slope, x, drive in rows))


@jax.custom_jvp
def even_recurrence(
    steps: tuple[Numbers, ...], inputs: Rows, goes_on: Float[Array, " samples"]
) -> Float[Array, " samples"]:
    """Sum of z_k = goes_on_k (a z_(k-1) + b before_k + c now_k) over steps (a, b, c) that are scalars.

    Mapped over many steps, the loop moves all of them side by side, and the inputs are read once. Of the
    derivatives with respect to steps, only that for a takes another recurrence, the same for all tangents:

        z = b v + c w,    dz = s da + v db + w dc,    s_k = goes_on_k (a s_(k-1) + z_(k-1)).

    **Arguments:** `steps`; `inputs`, before and now; `goes_on`, 0 where a sequence begins, else 1.
    """

    def move(z: Numbers, row: Numbers) -> tuple[Numbers, Array]:
        before, now, on = row
        moved = zip(steps, z, strict=True)
        z = tuple(on * a * x + b * before + c * now for (a, b, c), x in moved)
        return z, sum(z, start=jnp.zeros_like(now))

    inputs = tuple(goes_on * u for u in inputs)
    rest = tuple(jnp.zeros_like(a) for a, _, _ in steps)
    return jax.lax.scan(move, rest, (*inputs, goes_on))[1]


@partial(even_recurrence.defjvp, symbolic_zeros=True)
def _even_derivative(primals: Any, tangents: Any) -> tuple[Array, Array]:
    # goes_on is 0 or 1, so it has no derivative. The responses to unit steps serve every tangent: a fit's
    # forward mode has one for each parameter, and each then costs a row of a product of matrices.
    (steps, inputs, goes_on), (d_steps, d_inputs, _) = primals, tangents
    responses = [_responses(step, inputs, goes_on) for step in steps]
    rows = zip(steps, responses, strict=True)
    z = sum((b * v + c * w for (_, b, c), (_, v, w) in rows), start=jnp.zeros_like(goes_on))
    # One product of matrices: mapped over walkers and tangents, sums of rows would read them across.
    slopes = jnp.stack([_filled(slope) for step in d_steps for slope in step])
    dz = slopes @ jnp.stack([row for rows in responses for row in rows])
    # The inputs of a fit are data: the recurrence of their tangents is left out where they have none.
    if not all(isinstance(du, SymbolicZero) for du in d_inputs):
        dz = dz + even_recurrence(steps, tuple(map(_filled, d_inputs)), goes_on)
    return z, dz


def _filled(tangent: Any) -> Array:
    if isinstance(tangent, SymbolicZero):
        return jnp.zeros(tangent.shape, str(tangent.dtype))
    return tangent


def _responses(step: Numbers, inputs: Rows, goes_on: Array) -> Rows:
    """s, v and w."""
    a, b, c = step

    def move(response: Numbers, row: Numbers) -> tuple[Numbers, Numbers]:
        (s, v, w), (before, now, on) = response, row
        response = on * (a * s + b * v + c * w), on * a * v + before, on * a * w + now
        return response, response

    inputs = tuple(goes_on * u for u in inputs)
    return jax.lax.scan(move, (jnp.zeros_like(a),) * 3, (*inputs, goes_on))[1]


def _before(z: Array) -> Array:
    return jnp.concatenate([jnp.zeros_like(z[:1]), z[:-1]])


@jax.jit
def _solve(a: Rows, b: Rows) -> Rows:
    # Neither one loop for all nor one each: see `AT_ONCE`.
    groups = [slice(k, k + AT_ONCE) for k in range(0, len(a), AT_ONCE)]
    return tuple(z for group in groups for z in _scan(a[group], b[group]))


def _scan(a: Rows, b: Rows) -> Rows:
    def move(z: Numbers, ab: tuple[Numbers, Numbers]) -> tuple[Numbers, Numbers]:
        z = tuple(factor * x + drive for factor, x, drive in zip(ab[0], z, ab[1], strict=True))
        return z, z

    return jax.lax.scan(move, tuple(jnp.zeros_like(drive[0]) for drive in b), (a, b))[1]


# Recurrences over many rows in NumPy, compiled for no length.
#
# The rows are cut into as many segments as each has rows. All segments run side by side, from an unknown
# state; a second, short loop then hands the state from one segment to the next. A million rows take two
# loops of a thousand steps instead of one of a million.

Columns = Float[np.ndarray, "rows columns"]


def relaxed(
    decay: Float[np.ndarray, "rows times"],
    drive: Float[np.ndarray, "rows times columns"],
    state: Float[np.ndarray, "times columns"],
) -> Float[np.ndarray, "rows times columns"]:
    """x_k = decay_k x_(k-1) + drive_k, with x before the first row = `state`."""
    rows = len(drive)
    if not drive.size:
        return drive
    steps = _segment(rows)
    x, kept = _cut(drive, steps, 0.0), _cut(decay, steps, 1.0)[..., None]
    for k in range(1, steps):
        x[:, k] += kept[:, k] * x[:, k - 1]
        kept[:, k] *= kept[:, k - 1]
    for one, share in zip(x, kept, strict=True):
        one += share * state
        state = one[-1]
    return x.reshape(-1, *drive.shape[1:])[:rows]


def clamped(low: Columns, high: Columns, state: Float[np.ndarray, " columns"]) -> Columns:
    """z_k = clip(z_(k-1), low_k, high_k), with z before the first row = `state`.

    Two clamps one after the other are one clamp. The upper end counts where `low` is above it.
    """
    rows = len(low)
    if not low.size:
        return low
    steps = _segment(rows)
    low, high = _cut(low, steps, -np.inf), _cut(high, steps, np.inf)
    for k in range(1, steps):
        least, most = low[:, k].copy(), high[:, k].copy()
        low[:, k] = np.minimum(np.maximum(low[:, k - 1], least), most)
        high[:, k] = np.minimum(np.maximum(high[:, k - 1], least), most)
    z = np.empty_like(low)
    for one, least, most in zip(z, low, high, strict=True):
        np.minimum(np.maximum(state, least), most, out=one)
        state = one[-1]
    return z.reshape(-1, low.shape[-1])[:rows]


def running(
    extreme: np.ufunc, x: Float[np.ndarray, " rows"], first: np.ndarray, state: float
) -> Float[np.ndarray, " rows"]:
    """The extreme (np.maximum or np.minimum) so far, anew at the rows `first`; `state` before row 0."""
    found = np.concatenate([[state], x])
    edges = np.unique(np.concatenate([[0], first[first > 0] + 1, [len(found)]]))
    if (first == 0).any():
        found[0] = x[0]
    for a, b in pairwise(edges):
        extreme.accumulate(found[a:b], out=found[a:b])
    return found[1:]


def _segment(rows: int) -> int:
    return int(np.ceil(np.sqrt(rows)))


def _cut(x: np.ndarray, steps: int, fill: float) -> np.ndarray:
    """(segments, steps, ...), a copy, padded with `fill`."""
    segments = -(-len(x) // steps)
    found = np.full((segments * steps, *x.shape[1:]), fill)
    found[: len(x)] = x
    return found.reshape(segments, steps, *x.shape[1:])


# What an input leaves behind: stop operators, and what is left of it less its exponential averages.
#
#     stop_k = u_k - play_k,  play_k = max(u_k - r, min(u_k + r, play_(k-1))),  play_0 = u_1
#     slow' = u' - slow / time,  slow at the first row = 0, exact for an input that jumps at the rows
#
# Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.1.

Column = Float[np.ndarray, " rows"]


def stops(u: Column, radii: Float[np.ndarray, " stops"], out: Columns | None = None) -> Columns:
    """Stop operators of these radii, which begin at rest."""
    found = np.empty((len(u), len(radii))) if out is None else out
    for k, r in enumerate(radii):  # one after the other: each takes six columns of memory
        found[:, k] = u - clamped(u[:, None] - r, u[:, None] + r, u[:1])[:, 0]
    return found


def slow_states(
    u: Column, t: Column, times: Float[np.ndarray, " states"], out: Columns | None = None
) -> Columns:
    """The input less its exponential averages over these times, which begin at the first input."""
    found = np.empty((len(u), len(times))) if out is None else out
    step, rise = np.diff(t, prepend=t[0]), np.diff(u, prepend=u[0])
    for k, time in enumerate(times):  # as above
        keep = np.exp(-step / time)[:, None]
        # What is left over of each rise of the input.
        drive = (keep[:, 0] * rise)[:, None, None]
        found[:, k] = relaxed(keep, drive, np.zeros((1, 1)))[:, 0, 0]
    return found
