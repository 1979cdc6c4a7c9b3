"""What the solvers are written in, of JAX's arrays: see `compensate.runtime._arithmetic`."""

from collections.abc import Callable, Iterable
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

clip, exp, expm1, log = jnp.clip, jnp.exp, jnp.expm1, jnp.log
isfinite, sqrt, total = jnp.isfinite, jnp.sqrt, jnp.sum
place_of_most = jnp.argmax
no, some = jnp.logical_not, jnp.any
each: Any = lambda of, *columns: jax.vmap(of)(*columns)  # noqa: E731
vector = jnp.stack


def most(values: Iterable[Any]) -> Any:
    return values.max() if isinstance(values, jax.Array) else reduce(jnp.maximum, values)


def where(test: Any, one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(test, a, b), one, other)


def when(test: Any, made: Callable[[], Any], other: Any) -> Any:
    return where(test, made(), other)


def either(test: Any, one: Callable[[], Any], other: Callable[[], Any]) -> Any:
    return where(test, one(), other())


def where_each(items: Any, test: Any, made: Any, other: Any) -> Any:
    def one(item: Any) -> Any:
        held = test(item)
        return where(held, made(item, held), other)

    return each(one, items)


def first_of_least(items: Any, cost: Any, strength: Any) -> Any:
    costs = each(cost, items)
    best = jnp.argmax(jnp.where(costs <= costs.min(), each(strength, items), -jnp.inf))
    return at(items, best)


def cell(along: Any, cells: int) -> tuple[Any, Any]:
    at = (along + 1) / 2 * cells
    first = jnp.minimum(jnp.floor(at).astype(int), cells - 1)
    return first, at - first.astype(at.dtype)


def rarely(test: Any, made: Callable[[], Any], other: Any) -> Any:
    return jax.lax.cond(test, made, lambda: other)


def at(items: Any, place: Any) -> Any:
    return jax.tree.map(lambda leaf: leaf[place], items)


def put(items: Any, place: Any, one: Any) -> Any:
    return jax.tree.map(lambda leaf, new: leaf.at[place].set(new), items, one)


def table(rows: Any) -> Any:
    return jnp.asarray(rows)


def turned(rows: Any) -> Any:
    return rows.T


def mixed(a: Any, x: Any, b: Any, y: Any) -> Any:
    return a * x + b * y


def plus_at(rows: Any, more: Any) -> Any:
    i, j, values = zip(*more, strict=True)
    return rows.at[np.array(i), np.array(j)].add(jnp.stack(values))


def times(rows: Any, h: Any) -> Any:
    return rows[:, : len(h)] @ h


def less(rows: Any, column: Any, by: Any) -> Any:
    return rows - jnp.outer(column, column) / by
