"""Loads, stores and marks of compiled laws.

`get(m, i)`, `put(m, i, x)`, `whole(n, i)`: the i-th number at an address, without a check of bounds.

`mark k(t, x, a_1, d_1, ..., a_k, d_k)`: the tangents of the real x are the sum of d_i times those of a_i.
At the address t stand the address of the table of tangents (reals, columns), its number of columns, a
multiple of four, and the address of SPOTS. numba makes no vectors of loops this short, so they are written
here.

`spot(t, x, a, d)`: x depends on the parameter a, too. A parameter mostly is a direction of its own, so its
only tangent is 1 in one column. SPOTS says in which; NONE where there is none, and WIDELY where a has
others.

Nothing here knows a law, so that all laws share it.
"""

from typing import Any, no_type_check

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from ._memory_sizes import MOST, WIDE, WIDELY

_REAL, _WORD = ir.DoubleType(), ir.IntType(64)
_VECTOR = ir.VectorType(_REAL, WIDE)


def _at(builder: Any, base: Any, index: Any, kind: Any) -> Any:
    return builder.gep(builder.inttoptr(base, kind.as_pointer()), [index])


@intrinsic
def get(typing: Any, m: Any, i: Any) -> Any:
    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.load(_at(builder, given[0], given[1], _REAL))

    return types.float64(types.int64, types.int64), make


@intrinsic
def whole(typing: Any, n: Any, i: Any) -> Any:
    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        found = builder.load(_at(builder, given[0], given[1], _WORD))
        found.set_metadata("invariant.load", builder.module.add_metadata([]))  # n never changes
        return found

    return types.int64(types.int64, types.int64), make


@intrinsic
def put(typing: Any, m: Any, i: Any, x: Any) -> Any:
    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        builder.store(given[2], _at(builder, given[0], given[1], _REAL))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), make


def _row(builder: Any, base: Any, number: Any, columns: Any, column: Any) -> Any:
    """Where four columns of a real's tangents begin."""
    place = _at(builder, base, builder.add(builder.mul(number, columns), column), _REAL)
    return builder.bitcast(place, _VECTOR.as_pointer())


def _four_times(builder: Any, value: Any) -> Any:
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.IntType(32)(0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDE), [0] * WIDE)
    return builder.shuffle_vector(first, first, mask)


def _mark(count: int) -> Any:
    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        t, x, values = given[0], given[1], given[2:]
        rows, columns = (builder.load(_at(builder, t, _WORD(k), _WORD)) for k in (0, 1))
        factors = [_four_times(builder, value) for value in values[1::2]]
        with cgutils.for_range_slice(builder, _WORD(0), columns, _WORD(WIDE), _WORD) as (at, _):
            total = ir.Constant(_VECTOR, [0.0] * WIDE)
            for other, by in zip(values[::2], factors, strict=True):
                tangents = builder.load(_row(builder, rows, other, columns, at), align=8)
                total = builder.fadd(total, builder.fmul(by, tangents))
            builder.store(total, _row(builder, rows, x, columns, at), align=8)
        return context.get_dummy_value()

    # numba asks for a function of as many arguments as the call has.
    names = ", ".join(f"a{k}, d{k}" for k in range(count))
    kinds = types.void(*[types.int64] * 2, *[types.int64, types.float64] * count)
    space: dict[str, Any] = {"__name__": __name__, "kinds": kinds, "make": make}
    exec(f"def mark{count}(typing, t, x, {names}):\n    return kinds, make", space)
    return intrinsic(space[f"mark{count}"])


_two = _mark(2)


@njit(error_model="numpy")
@no_type_check
def spot(t: Any, x: Any, a: Any, d: Any) -> None:
    column = whole(whole(t, 2), a)
    if column >= 0:
        place = x * whole(t, 1) + column
        put(whole(t, 0), place, get(whole(t, 0), place) + d)
    elif column == WIDELY:
        _two(t, x, x, 1.0, a, d)


MARKS = {"spot": spot} | {f"mark{count}": _mark(count) for count in range(MOST + 1)}
