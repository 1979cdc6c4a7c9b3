"""Generalised Prandtl-Ishlinskii operator: a curve of every play."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractSteppedModel
from .._parameter import as_float, is_concrete, parameter
from .._registry import register


@register
class GeneralizedPlays(AbstractSteppedModel[Array]):
    """Generalised Prandtl-Ishlinskii operator: a sum of curves, each of the play of one radius.

        y = sum of g_j(p_j),     p_j the play of radius r_j of the input

    g_j is straight between its values at even knots from -reach_j to reach_j, and on beyond them. Straight
    curves of falling slope beside a spring are stops, an Iwan model; with bent curves it approximates a
    Preisach operator whose density is continuous. Every play starts at 0.

    **Arguments:**

    - `radii`: (plays,), not negative.
    - `reach`: (plays,), positive.
    - `values`: (plays, knots), at least two knots; or those of one play after the other, with the number of
      `knots` of each.

    Raises `InputError` where their shapes differ or an entry is out of bounds.

    Source: Al Janaideh, Rakheja and Su 2011; Krasnosel'skii and Pokrovskii 1989.

    **Example:**

        >>> plays = hysteresis.GeneralizedPlays([0.0, 1.0], [2.0, 2.0], [[-2.0, 2.0], [1.0, -1.0]])
        >>> np.asarray(plays.simulate(None, np.array([0.0, 2.0, 1.0]))).tolist()
        [0.0, 1.5, 0.5]
    """

    radii: Float[Array, " plays"] = parameter(
        unit="input", fixed=True, meaning="radii of the plays"
    )
    reach: Float[Array, " plays"] = parameter(unit="input", fixed=True, meaning="outermost knots")
    values: Float[Array, " values"] = parameter(unit="output", meaning="curves of the plays")
    knots: tuple[int, ...] = eqx.field(static=True, default=())

    def __init__(self, radii: Any, reach: Any, values: Any, knots: Sequence[int] | None = None):
        self.radii, self.reach = as_float(radii), as_float(reach)
        values = as_float(values)
        if knots is None:
            knots = (values.shape[-1],) * len(values) if values.ndim == 2 else ()
        self.values, self.knots = values.reshape(-1), tuple(int(k) for k in knots)

    def __check_init__(self) -> None:
        plays = len(self.knots)
        sizes = jnp.shape(self.radii), jnp.shape(self.reach), jnp.shape(self.values)
        if sizes != ((plays,), (plays,), (sum(self.knots),)) or min(self.knots, default=0) < 2:
            raise InputError(
                "length-mismatch",
                f"radii, reach and values have the shapes {', '.join(map(str, sizes))}, knots are"
                f" {self.knots}.",
                fix="give one radius, one reach and two values or more of each play.",
            )
        known = is_concrete(self.radii) and is_concrete(self.reach)
        if known and not (np.all(self.radii >= 0) and np.all(self.reach > 0)):
            raise InputError(
                "parameter-out-of-bounds", "a radius is negative, or a reach is not positive."
            )

    def init(self, t0: Any = None, u0: Any = None) -> Array:
        return jnp.zeros_like(self.radii)

    def step(self, state: Array, t: Any, u: Any) -> tuple[Array, Float[Array, ""]]:
        plays = jnp.clip(state, u - self.radii, u + self.radii)
        knots = np.array(self.knots)
        cells = jnp.asarray(knots - 1, plays.dtype)
        place = (plays + self.reach) * cells / (2 * self.reach)
        cell = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0.0, cells - 1.0)
        lower = cell.astype(int) + (np.cumsum(knots) - knots)
        rise = self.values[lower + 1] - self.values[lower]
        return plays, jnp.sum(self.values[lower] + rise * (place - cell))
