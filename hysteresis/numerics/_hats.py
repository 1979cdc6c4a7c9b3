"""Hat functions: the weights of linear interpolation."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def hats(x: Float[Array, ""], nodes: Float[Array, " nodes"]) -> Float[Array, " nodes"]:
    """h_k(x): 1 at node k, 0 at the others, straight between, constant beyond the ends; their sum is 1."""
    rise = jnp.clip((x - nodes[:-1]) / jnp.diff(nodes), 0.0, 1.0)
    # Up to node k its rise is that to it, after it the next one takes away.
    return jnp.append(jnp.ones_like(rise[:1]), rise) - jnp.append(rise, jnp.zeros_like(rise[:1]))


def hats_of(
    x: Float[np.ndarray, " samples"], nodes: np.ndarray
) -> Float[np.ndarray, "samples nodes"]:
    """h_k of many numbers, in NumPy."""
    return np.column_stack([np.interp(x, nodes, each) for each in np.eye(len(nodes))])
