"""The sum of densities."""

from functools import reduce
from operator import add
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._registry import register
from ._density import AbstractDensity


@register
class SumDensity(AbstractDensity[tuple[Any, ...], tuple[Any, ...]]):
    """The sum of several densities, each on its own triangle: E(a, b) = sum of E_k(a, b).

    **Arguments:**

    - `parts`: the densities. [low, high] encloses all of theirs; beyond its own a part is saturated.

    Raises `InputError` where there is no part.

    **Example:**

        >>> parts = [hysteresis.preisach.GridDensity(0.0, high, np.tri(2)) for high in (5.0, 10.0)]
        >>> density = hysteresis.internal.SumDensity(parts)
        >>> hysteresis.Preisach(density).simulate(None, np.array([0.0, 5.0, 10.0, 5.0])).tolist()
        [-6.0, 2.0, 6.0, 4.0]
    """

    parts: tuple[AbstractDensity, ...]

    def __init__(self, parts: Any):
        self.parts = tuple(parts)

    def __check_init__(self) -> None:
        if not self.parts:
            raise InputError("bad-parts", "there is no density to add up.", fix="give one or more.")

    @property
    def low(self) -> float:
        """The least input of any part."""
        return min(part.low for part in self.parts)

    @property
    def high(self) -> float:
        """The greatest input of any part."""
        return max(part.high for part in self.parts)

    def pair(self, a: Any, b: Any) -> tuple[Any, ...]:
        xp = jnp if isinstance(a, jax.Array) or isinstance(b, jax.Array) else np
        return tuple(
            part.pair(*(xp.clip(u, part.low, part.high) for u in (a, b))) for part in self.parts
        )

    def tabulate(self) -> tuple[Any, ...]:
        return tuple(part.tabulate() for part in self.parts)

    def everett(self, table: tuple[Any, ...], pairs: tuple[Any, ...]) -> Float[Array, "*pairs"]:
        parts = zip(self.parts, table, pairs, strict=True)
        return reduce(add, (part.everett(own, at) for part, own, at in parts))

    def mass(self, table: tuple[Any, ...]) -> Float[Array, ""]:
        parts = zip(self.parts, table, strict=True)
        return reduce(add, (part.mass(own) for part, own in parts))
