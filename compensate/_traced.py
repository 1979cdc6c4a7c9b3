"""What the solvers are written in, of JAX's arrays: see `compensate.runtime._arithmetic`."""

from collections.abc import Callable
from functools import reduce

import jax
import jax.numpy as jnp
import numpy as np

from .runtime._arithmetic import Items, Numbers, Real, State, Test

Of = Callable[[State], State]
Made = Callable[[], State]

clip, exp, expm1, log = jnp.clip, jnp.exp, jnp.expm1, jnp.log
isfinite, sqrt, total = jnp.isfinite, jnp.sqrt, jnp.sum
place_of_most, rarely = jnp.argmax, jax.lax.cond
no, some = jnp.logical_not, jnp.any
vector = jnp.array


def each(of: Of, items: Items) -> Items:
    return jax.vmap(of)(items)


def most(values: Items) -> Real:
    return values.max() if isinstance(values, jax.Array) else reduce(jnp.maximum, values)


def where(test: Test, one: State, other: State) -> State:
    return jax.tree.map(lambda a, b: jnp.where(test, a, b), one, other)


def either(test: Test, one: Made, other: Made) -> State:
    return where(test, one(), other())


def where_each(items: Items, test: Of, made: Callable[..., State], other: State) -> Items:
    def one(item: State) -> State:
        held = test(item)
        return where(held, made(item, held), other)

    return each(one, items)


def first_of_least(items: Items, cost: Of, strength: Of) -> State:
    costs = each(cost, items)
    best = jnp.argmax(jnp.where(costs <= costs.min(), each(strength, items), -jnp.inf))
    return at(items, best)


def at(items: Items, place: Real) -> State:
    return jax.tree.map(lambda leaf: leaf[place], items)


def put(items: Items, place: Real, one: State) -> Items:
    return jax.tree.map(lambda leaf, new: leaf.at[place].set(new), items, one)


def turned(rows: Items) -> Items:
    return rows.T


def mixed(a: Real, x: Numbers, b: Real, y: Numbers) -> Numbers:
    return a * x + b * y


def plus_at(rows: Items, more: Items) -> Items:
    i, j, values = zip(*more, strict=True)
    return rows.at[np.array(i), np.array(j)].add(jnp.stack(values))


def times(rows: Items, h: Numbers) -> Numbers:
    return rows[:, : len(h)] @ h


def less(rows: Items, column: Numbers, by: Real) -> Items:
    return rows - jnp.outer(column, column) / by
