"""Compiled programs take memory maps, of which Linux gives a process 65,530."""

from pathlib import Path

import jax

MOST = 40_000
"""Memory maps from which on programs are forgotten; a fit of a composition adds one or two thousand."""


def forget_compiled() -> None:
    """Forget JAX's programs and traces where they have taken most of the maps that a process may have.

    A process that fits one record after the other would otherwise end with a segmentation fault. What is
    forgotten comes back from the cache of compiled programs, where there is one.
    """
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MOST:
        jax.clear_caches()
