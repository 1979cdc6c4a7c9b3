"""Compiled programs take memory maps, of which Linux gives a process 65,530."""

from pathlib import Path
from time import monotonic

import jax

MOST = 40_000
"""Memory maps from which on programs are forgotten; a fit of a composition adds one or two thousand."""

EVERY = 5.0
"""Seconds between two looks, which take up to 30 ms each: compiling adds less than 1,000 maps a second."""

_looked = [-EVERY]


def forget_compiled() -> None:
    """Forget JAX's programs and traces where they have taken most of the maps that a process may have.

    A process that fits one record after the other would otherwise end with a segmentation fault. What is
    forgotten comes back from the cache of compiled programs, where there is one.
    """
    if monotonic() < _looked[0] + EVERY:
        return
    _looked[0], maps = monotonic(), Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MOST:
        jax.clear_caches()
