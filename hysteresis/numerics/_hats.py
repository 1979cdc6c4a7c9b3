"""Hat functions: the weights of linear interpolation."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def hats(x: Float[Array, "*x"], nodes: Float[Array, " nodes"]) -> Float[Array, "*x nodes"]:
    """h_k(x): 1 at node k, 0 at the others, straight between, constant beyond the ends; their sum is 1."""
    first, width = (
        jnp.broadcast_to(each, (*x.shape, len(each))) for each in (nodes[:-1], jnp.diff(nodes))
    )
    rise = jnp.clip((x[..., None] - first) / width, 0.0, 1.0)
    # Up to node k its rise is that to it, after it the next one takes away.
    one = jnp.ones((*x.shape, 1), rise.dtype)
    return jnp.concatenate([one, rise], -1) - jnp.concatenate([rise, 0 * one], -1)


def hats_of(
    x: Float[np.ndarray, " samples"], nodes: np.ndarray
) -> Float[np.ndarray, "samples nodes"]:
    """h_k of many numbers, in NumPy."""
    return np.column_stack([np.interp(x, nodes, each) for each in np.eye(len(nodes))])
