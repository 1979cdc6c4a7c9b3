"""Linear recurrences z_k = a_k z_(k-1) + b_k, one sample after the other.

Their derivative is the same recurrence, driven by da_k z_(k-1) + db_k. So forward and reverse mode need
only a and z; reverse mode runs the transposed recurrence backwards.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
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
