"""Trees of laws inside programs of JAX: `jit`, `vmap`, `jvp`, and `vjp` by the parameters.

    d y = J(m) d m + (d y / d u) d u,      J from the marks, one column for every number that JAX has made

The loop is called back from JAX's program, and computes in double precision. Its columns are exact, and the
product with d m is JAX's, so it is transposed for reverse mode. Derivatives by what is given over time are
forward only, and second derivatives of a law are not known.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from .._parameter import is_concrete
from . import _over_time as over_time
from . import _readings as readings
from ._numbers import Known, Numbers

_WORD = np.uint32
_EACH = "expand_dims"
"""Of `vmap`: what all lanes share has one."""


def outputs(numbers: Numbers, x: Any, dt: Any) -> tuple[Any, Any]:
    """Outputs of a tree at the inputs x, (rows,) or (rows, 2), and the numbers m after the last one."""
    given = numbers.m, x, dt
    if all(map(is_concrete, given)):
        found = over_time.run(numbers, x, dt)
        return found.value, found.m
    return _outputs(numbers.known)(*(jnp.asarray(z, float) for z in given))


def estimates(numbers: Numbers, y: Any, dt: Any, held: Any) -> readings.Estimated:
    """Estimates, their status and the last m, as `estimated` says."""
    given = numbers.m, y, dt, held
    if all(map(is_concrete, given)):
        return readings.estimated(numbers, y, dt, held)
    law = _estimates(numbers.known)
    value, m, status = law(*(jnp.asarray(z, float) for z in given))
    return readings.Estimated(value, status, m)


def on_host(run: Callable[..., Any], kinds: Any, *given: Any) -> Any:
    """`run` of NumPy's arrays, at once, or called back from JAX's program. Its derivatives are not known:
    NaN, because without a rule JAX would take them for 0."""
    if all(map(is_concrete, given)):
        return run(*given)

    @jax.custom_jvp
    def called(*given: Any) -> Any:
        return tuple(_called_back(run, kinds, *given))

    @called.defjvp
    def _(primals: Any, moved: Any) -> Any:
        out, unknown = called(*primals), jnp.nan * sum(map(jnp.sum, moved), jnp.zeros(()))
        return out, tuple(
            jnp.broadcast_to(unknown.astype(x.dtype), x.shape)
            if jnp.issubdtype(x.dtype, jnp.floating)
            else np.zeros(x.shape, jax.dtypes.float0)
            for x in out
        )

    return called(*(jnp.asarray(z, float) for z in given))


def _called_back(run: Callable[..., Any], kinds: Any, *given: Any) -> Any:
    """`run` of NumPy's arrays, over lanes where `vmap` has put some before the arrays' own axes.

    Doubles go as pairs of words: JAX brings numbers to the precision of the thread that calls back, which
    may be another one, and single.
    """
    host = partial(_lanes, run, tuple(x.ndim for x in given))
    if given[0].dtype != float:
        return jax.pure_callback(host, kinds, *given, vmap_method=_EACH)

    def of_words(*words: Any) -> list[np.ndarray]:
        found = host(*(np.ascontiguousarray(x).view(float)[..., 0] for x in words))
        return [np.array(x, order="C")[..., None].view(_WORD) for x in found]

    words = (jax.lax.bitcast_convert_type(x, _WORD) for x in given)
    pairs = [jax.ShapeDtypeStruct((*kind.shape, 2), _WORD) for kind in kinds]
    found = jax.pure_callback(of_words, pairs, *words, vmap_method=_EACH)
    return tuple(
        jax.lax.bitcast_convert_type(x, kind.dtype) for x, kind in zip(found, kinds, strict=True)
    )


@cache
def _outputs(known: Known) -> Callable[..., Any]:
    def run(m: Any, x: Any, dt: Any) -> Any:
        found = over_time.run(Numbers(known, m), x, dt)
        return found.value, found.m

    def tangents(dm: Any, m: Any, x: Any, dt: Any, dx: Any) -> Any:
        return over_time.tangents(Numbers(known, m), dm, x, dt, dx).columns

    return _differentiable(known, run, tangents)


@cache
def _estimates(known: Known) -> Callable[..., Any]:
    def run(m: Any, y: Any, dt: Any, held: Any) -> Any:
        found = readings.estimated(Numbers(known, m), y, dt, held)
        return found.value, found.m, found.status

    def tangents(dm: Any, m: Any, y: Any, dt: Any, dy: Any) -> Any:
        return readings.tangents_of(Numbers(known, m), dm, y, dt, dy)

    return _differentiable(known, run, tangents)


def _differentiable(known: Known, run: Callable[..., Any], tangents: Callable[..., Any]) -> Any:
    """`run` of (m, x, dt, ...) to (value, last m, ...) with derivatives of the value by m and x."""
    index = np.array(known.free, int)

    @jax.custom_jvp
    def law(*given: Any) -> Any:
        m, dt = given[0], given[2]
        kinds = (jax.ShapeDtypeStruct(dt.shape, dt.dtype), jax.ShapeDtypeStruct(m.shape, m.dtype))
        if len(given) > 3:
            kinds = (*kinds, jax.ShapeDtypeStruct(dt.shape, jnp.zeros(0, int).dtype))
        return _called_back(run, kinds, *given)

    def by_numbers(m: Any, x: Any, dt: Any) -> Any:
        dm = np.zeros((len(m), len(index)))
        dm[index, np.arange(len(index))] = 1.0
        return (tangents(dm, m, x, dt, None),)

    def by_given(m: Any, x: Any, dt: Any, dx: Any) -> Any:
        own = dx[:, 0] if dx.ndim == 2 else dx
        return (tangents(np.zeros((len(m), 1)), m, x, dt, own[:, None])[:, 0],)

    @partial(law.defjvp, symbolic_zeros=True)
    def _(primals: Any, moved: Any) -> Any:
        (m, x, dt), (dm, dx) = primals[:3], moved[:2]
        out = law(*primals)
        dy = jnp.zeros_like(out[0])
        if not isinstance(dm, SymbolicZero):
            kind = (jax.ShapeDtypeStruct((*dt.shape, len(index)), dt.dtype),)
            dy += _called_back(by_numbers, kind, m, x, dt)[0] @ dm[index]
        if not isinstance(dx, SymbolicZero):
            kind = (jax.ShapeDtypeStruct(dt.shape, dt.dtype),)
            dy += _called_back(by_given, kind, m, x, dt, dx)[0]
        rest = [jnp.zeros_like(out[1]), *(np.zeros(o.shape, jax.dtypes.float0) for o in out[2:])]
        return out, (dy, *rest)

    return law


def _lanes(one: Callable[..., Any], axes: tuple[int, ...], *given: Any) -> tuple[np.ndarray, ...]:
    """`one` over what `vmap` has put before the arguments' own axes: some have one lane for all."""
    arrays = [np.asarray(x) for x in given]
    own = [x.shape[x.ndim - k :] for x, k in zip(arrays, axes, strict=True)]
    before = [x.shape[: x.ndim - k] for x, k in zip(arrays, axes, strict=True)]
    lanes = np.broadcast_shapes(*before)
    spread = [
        np.broadcast_to(x, (*lanes, *shape)).reshape(-1, *shape)
        for x, shape in zip(arrays, own, strict=True)
    ]
    each = [one(*row) for row in zip(*spread, strict=True)]
    found = [np.stack(column) for column in zip(*each, strict=True)]
    single = arrays[0].dtype == np.float32
    with np.errstate(over="ignore"):  # beyond single precision is infinite, as JAX has it
        return tuple(
            x.reshape((*lanes, *x.shape[1:])).astype(
                x.dtype if not single else np.float32 if x.dtype == float else np.int32
            )
            for x in found
        )
