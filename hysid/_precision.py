"""JAX's double precision, which fits need."""

import jax


def enable_x64() -> None:
    """Switch JAX to double precision (64 bits), which fits need; call it before any array is made.

    JAX starts in single precision, and importing hysid does not change that. `fit` refuses single
    precision, because solvers stop early in it and errors come out wrong.

    **Example:**

        >>> hysid.enable_x64()
        >>> jnp.zeros(1).dtype
        dtype('float64')
    """
    jax.config.update("jax_enable_x64", True)
