"""The sums over a memory tree: what the relays have done between its root and each of its anchors."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._everett import materialise, read
from ._memory import MemoryTree


def anchor_levels(
    tree: MemoryTree, rise: Float[Array, " anchors"], runtime_true: Any
) -> Float[Array, " anchors"]:
    """The sum of the rises of all anchors on the stack when each was pushed, its own included.

    `rise` is the change from an anchor's parent to the anchor. A push adds one, a pop takes an
    anchor's and its parent's: a cumulative sum over the events. `runtime_true` as in `materialise`.
    """
    rise = materialise(rise, runtime_true)  # it is read twice
    change = jnp.concatenate([rise, -rise - read(rise, tree.parent), jnp.zeros(1, rise.dtype)])
    change = materialise(change, runtime_true)
    return materialise(read(_running_sum(read(change, tree.event)), tree.position), runtime_true)


@jax.jit
def _running_sum(terms: Float[Array, " terms"]) -> Float[Array, " terms"]:
    """Cumulative sum: on a CPU one addition after the other is twice as fast as `jnp.cumsum`."""

    def add(total: Array, term: Array) -> tuple[Array, Array]:
        total = total + term
        return total, total

    def scan(terms: Array) -> Array:
        return jax.lax.scan(add, jnp.zeros_like(terms[0]), terms)[1]

    return jax.lax.platform_dependent(terms, cpu=scan, default=jnp.cumsum)
