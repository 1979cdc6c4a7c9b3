"""Double precision, without which fits stop early and errors come out wrong."""

import jax

from hysteresis import InputError


def require_double(allow_float32: bool) -> None:
    """Raise `InputError` where JAX's double precision is off, unless that is allowed."""
    if not jax.config.jax_enable_x64 and not allow_float32:  # type: ignore[attr-defined]
        raise InputError(
            "single-precision",
            "JAX runs in single precision, in which fits stop early and errors come out wrong.",
            fix="hysid.enable_x64()",
        )
