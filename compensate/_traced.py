"""What the solvers are written in, of JAX's arrays: see `compensate.runtime._arithmetic`."""

from collections.abc import Callable, Iterable
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp

clip, exp, isfinite, sqrt = jnp.clip, jnp.exp, jnp.isfinite, jnp.sqrt
no, some = jnp.logical_not, jnp.any
each: Any = lambda of, *columns: jax.vmap(of)(*columns)  # noqa: E731
vector = jnp.stack


def most(values: Iterable[Any]) -> Any:
    return reduce(jnp.maximum, values)


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
    return jax.tree.map(lambda leaf: leaf[best], items)


def cell(along: Any, cells: int) -> tuple[Any, Any]:
    at = (along + 1) / 2 * cells
    first = jnp.minimum(jnp.floor(at).astype(int), cells - 1)
    return first, at - first.astype(at.dtype)
