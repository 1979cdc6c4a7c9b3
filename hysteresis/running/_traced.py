"""Trees of laws inside programs of JAX: `jit`, `vmap`, `jvp`, and `vjp` by the parameters.

    d y = J(m) d m + (d y / d u) d u,      J from the marks, one column for every number that JAX has made

The compiled loop is called back from JAX's program, in double precision. Its columns are exact, and the product
with d m is JAX's, so it is transposed for reverse mode. Derivatives by the input are forward only, and second
derivatives of a law are not known.
"""

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from . import _over_time as over_time
from ._numbers import Numbers, Structure

_EACH = "expand_dims"
"""Of `vmap`: what all lanes share has one."""


def call(numbers: Numbers, x: Any, dt: Any, starts: tuple[int, ...], inverse: bool) -> Any:
    """(values, statuses, last m) of a tree over time; any of the numbers, `x` and `dt` may be traced."""
    law = _of(
        numbers.structure, tuple(numbers.n.tolist()), tuple(np.flatnonzero(numbers.free).tolist()),
        starts, inverse,
    )  # fmt: skip
    return law(jnp.asarray(numbers.m, float), jnp.asarray(x, float), jnp.asarray(dt, float))


@cache
def _of(
    structure: Structure,
    n: tuple[int, ...],
    free: tuple[int, ...],
    starts: tuple[int, ...],
    inverse: bool,
) -> Any:
    whole, index = np.array(n, np.int64), np.array(free, int)

    @jax.custom_jvp
    def law(m: Any, x: Any, dt: Any) -> Any:
        run = over_time.find if inverse else over_time.run
        host = partial(_lanes, lambda m, x, dt: run(structure, m, whole, dt, x, starts))
        own = jax.ShapeDtypeStruct(x.shape, x.dtype)
        kinds = own, jax.ShapeDtypeStruct(x.shape, int), jax.ShapeDtypeStruct(m.shape, m.dtype)
        return jax.pure_callback(host, kinds, m, x, dt, vmap_method=_EACH)

    def tangents(m: Any, x: Any, dt: Any, dx: Any) -> Any:
        dm = np.zeros((len(m), len(index) if dx is None else 1))
        if dx is None:
            dm[index, np.arange(len(index))] = 1.0
        else:
            dx = np.reshape(dx, (-1, 1))
        found = over_time.tangents(structure, m, whole, dm, dt, x, dx, starts, inverse)
        return (found.columns if dx is None else found.columns[:, 0],)

    @partial(law.defjvp, symbolic_zeros=True)
    def _(primals: Any, moved: Any) -> Any:
        m, x, dt = primals
        dm, dx, _ = moved
        out = law(m, x, dt)
        dy = jnp.zeros_like(out[0])
        if not isinstance(dm, SymbolicZero):
            host = partial(_lanes, lambda m, x, dt: tangents(m, x, dt, None))
            kind = (jax.ShapeDtypeStruct((*x.shape, len(index)), x.dtype),)
            (J,) = jax.pure_callback(host, kind, m, x, dt, vmap_method=_EACH)
            dy += J @ dm[index]
        if not isinstance(dx, SymbolicZero):
            host = partial(_lanes, tangents)
            kind = (jax.ShapeDtypeStruct(x.shape, x.dtype),)
            dy += jax.pure_callback(host, kind, m, x, dt, dx, vmap_method=_EACH)[0]
        none = np.zeros(out[1].shape, jax.dtypes.float0), jnp.zeros_like(out[2])
        return out, (dy, *none)

    return law


def _lanes(one: Any, *given: Any) -> tuple[np.ndarray, ...]:
    """`one` over all leading axes of vectors, of which some have one lane for all."""
    arrays = [np.asarray(x) for x in given]
    lanes = np.broadcast_shapes(*(x.shape[:-1] for x in arrays))
    spread = [np.broadcast_to(x, (*lanes, x.shape[-1])).reshape(-1, x.shape[-1]) for x in arrays]
    kinds = [x.dtype for x in arrays]
    each = [one(*row) for row in zip(*spread, strict=True)]
    found = [np.stack(column) for column in zip(*each, strict=True)]
    return tuple(
        x.reshape(*lanes, *x.shape[1:]).astype(kinds[0] if x.dtype == float else x.dtype)
        for x in found
    )
