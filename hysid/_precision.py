"""JAX's double precision, which fits need."""

import jax


def enable_x64() -> None:
    """Switch JAX to double precision (64 bits) for all that follows; call it before any array is made.

    JAX starts in single precision, and importing hysid does not change that. `fit`, and what is made of a
    fit, compute in double precision all the same. Your own compiled programs (`jax.jit`, `jax.vmap`) that
    hold a fitted model need this call, and say so.

    **Example:**

        >>> hysid.enable_x64()
        >>> jnp.zeros(1).dtype
        dtype('float64')
    """
    jax.config.update("jax_enable_x64", True)
