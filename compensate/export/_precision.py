"""Double precision, without which a file's golden values are too far off for the file to load."""

import jax

from hysteresis import InputError


def require_double() -> None:
    """Raise `InputError` where JAX's double precision is off.

    Files are replayed when they are loaded, to 1e-9 of their range. Single precision is 1e-8 off at best.
    """
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise InputError(
            "single-precision",
            "JAX runs in single precision, and a file written so would be refused when it is loaded.",
            cause="The golden values of the file would be 1e-8 off, and have to be right to 1e-9.",
            fix="Call hysid.enable_x64() before any array is made, and make the model again.",
        )
