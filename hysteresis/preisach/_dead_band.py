"""A dead band in front of the relays: noise on the input makes no reversals there."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import is_start
from ..numerics._functions import clamps


def play(
    u: Float[Array, " samples"], half_width: float, before: Any, starts: tuple[int, ...] = (0,)
) -> Float[Array, " samples"]:
    """What a play operator of half width r makes of u: v_k = clip(v_(k-1), u_k - r, u_k + r).

    v moves only where u has moved by more than r away from it, and then follows r behind.

    **Arguments:**

    - `u`: inputs, shape `(samples,)`; `half_width`: r, in the input's unit.
    - `before`: v before the first sample; NaN where there is none: v then starts at u.
    - `starts`: first samples of the independent sequences, each with `before` before it.
    """
    start, fresh = is_start(len(u), starts) > 0, jnp.isnan(before)
    r = jnp.where(start & fresh, 0.0, half_width)[:, None]
    begin = jnp.where(fresh, u[0], before)[None]
    return clamps(u[:, None] - r, u[:, None] + r, begin, start)[:, 0]


def play_step(u: Float[Array, ""], half_width: float, before: Float[Array, ""]) -> Array:
    """One sample of `play`."""
    return jnp.where(jnp.isnan(before), u, jnp.clip(before, u - half_width, u + half_width))


def input_noise(u: Float[Array, " samples"] | np.ndarray) -> float:
    """The standard deviation of white noise on u, from its second differences.

    d_k = u_(k-1) - 2 u_k + u_(k+1) of independent noise has 6 times its variance, and of a path
    sampled densely next to none of its own. The median of |d|, times 1.4826 as for a Gaussian,
    does not see the corners. A `dead_band` of three of these deviations is a sensible choice: one
    sample in 370 is further off, and loops that small are lost in the noise anyway.

    Raises `InputError` for fewer than three samples.

    **Example:**

        >>> random = np.random.default_rng(0)
        >>> noisy = np.sin(np.linspace(0, 20, 2000)) + 0.01 * random.normal(size=2000)
        >>> f"{hysteresis.preisach.input_noise(noisy):.3f}"
        '0.010'
    """
    u = np.asarray(u, float)
    if len(u) < 3:
        said = f"noise cannot be told from {len(u)} samples."
        raise InputError("too-few-rows", said, fix="give at least three.")
    return float(1.4826 * np.median(np.abs(np.diff(u, 2))) / np.sqrt(6))
