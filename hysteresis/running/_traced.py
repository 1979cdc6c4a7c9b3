"""Trees of laws inside programs of JAX: `jit`, `vmap`, `jvp`, and `vjp` by the parameters.

    d y = J(m) d m + (d y / d u) d u,      J from the marks, one column for every number that JAX has made

The loop is called back from JAX's program, and computes in double precision. Its columns are exact, and the
product with d m is JAX's, so it is transposed for reverse mode. Derivatives by what is given over time are
forward only, and second derivatives of a law are not known.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from .._parameter import array_module, is_concrete
from . import _over_time as over_time
from . import _readings as readings
from ._numbers import Known, Numbers
from ._readings import INVALID, spread
from ._text import EACH

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


# Readings through a law around a tree, which says more than the estimate, or through one law alone.


class Told(NamedTuple):
    """Estimates, their status, and what the law says beside them, (rows, numbers); the state and the time
    of the last reading after them."""

    value: Any
    status: Any
    said: Any
    state: Any
    t: Any


def told(
    numbers: Numbers, state: Any, t: Any, held: Any, times: Any, y: Any, *, width: int
) -> Told:
    """Estimates from a `state`, behind readings y, (rows,) or beside a condition (rows, 2).

    A reading that is not finite is none: the last estimate is held, at first `held`, and its time is added
    to the next one's. `t` is that of the last reading, NaN where nothing came before. `width`: how much the
    law says. Without derivatives.
    """
    given = numbers.m, state, t, held, times, y
    return Told(*_on_host(partial(_told, numbers.known, "find_told", width), width, given))


def each(
    numbers: Numbers,
    function: str,
    *columns: Any,
    state: Any = None,
    t: Any = np.nan,
    held: Any = np.nan,
    times: Any = None,
    where: Any = None,
    keeps: tuple[str, ...] = (),
) -> Told:
    """What a function of one law gives row by row, of columns in the order of its arguments.

    As `told`, where a row without a finite number in `where` (the first column by default) is no reading.
    `keeps`: which numbers of the law's state are said.
    """
    where = columns[0] if where is None else where
    xp = array_module(numbers.m, *columns)
    times = xp.zeros(where.shape) if times is None else times
    state = numbers.state if state is None else state
    rows = xp.stack([xp.asarray(x, float) for x in columns], 1)
    given = numbers.m, state, t, held, times, where, rows
    host = partial(_told, numbers.known, EACH + "_".join([function, *keeps]), len(keeps))
    return Told(*_on_host(host, len(keeps), given))


def _on_host(host: Any, width: int, given: tuple[Any, ...]) -> Any:
    rows, state = given[5].shape[:1], given[1].shape
    shapes = (rows, rows, (*rows, width), state, ())
    kinds = [jax.ShapeDtypeStruct(*one) for one in zip(shapes, "dqddd", strict=True)]
    return on_host(host, kinds, *given)


def _told(
    known: Known, wanted: str, width: int, m: Any, state: Any, t: Any, held: Any, times: Any, y: Any,
    *columns: Any,
) -> tuple[Any, ...]:  # fmt: skip
    state, t, held, times, y = map(np.asarray, (state, t, held, times, y))
    numbers = Numbers(known, np.asarray(m, float)).with_state(state)
    reading, count = y[:, 0] if y.ndim == 2 else y, len(y)
    valid = np.isfinite(reading) & np.isfinite(times)
    rows, y = np.flatnonzero(valid), np.where(valid if y.ndim == 1 else valid[:, None], y, np.nan)
    passed, dt = np.diff(times[rows], prepend=t), np.zeros(count)
    dt[rows] = np.where(passed > 0.0, passed, 0.0)
    value, status, said = np.empty(count), np.full(count, float(INVALID)), np.empty((count, width))
    outputs = value, status, said, *(np.ascontiguousarray(x, float) for x in columns)
    m = over_time.through(wanted, numbers, y, dt, outputs)
    value = spread(value[rows], valid, held)
    last = times[rows[-1]] if len(rows) else t
    return value, status.astype(int), said, Numbers(known, m).state, np.asarray(last)
