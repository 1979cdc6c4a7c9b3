"""Duhem's operator with positive slopes: the slope depends on the output and on the direction."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractSteppedModel, Tree
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..trees import node

Slopes = Float[Array, " knots"] | Any

SMALL = 1e-8
"""Of the quantities whose first terms then are a series to rounding."""


class DuhemState(NamedTuple):
    """The input and the output."""

    u: Array
    y: Array


@register
class DuhemOperator(AbstractSteppedModel[DuhemState]):
    """Duhem's operator: the slope of the output depends on the output itself and on the direction.

        dy = rising(y) du  while u rises,     dy = falling(y) du  while u falls

    Both slopes are straight between their values at even knots from `low` to `high`, constant beyond, and
    positive, so that the output rises with the input and an exact inverse exists. The path of each step is
    integrated in closed form, so the output does not depend on how the input is sampled. Its memory is the
    present output alone. Bouc-Wen's model without a spring beside it is such an operator.

    **Arguments:**

    - `rising`, `falling`: (knots,) slopes, positive, at least two.
    - `low`, `high`: the first and the last knot. A fit keeps them.
    - `offset`: the output at u = 0, where every history starts.

    Raises `InputError` for another number of slopes, slopes that are not positive, or `high` not above
    `low`.

    Source: Duhem 1897; Macki, Nistri and Zecca 1993.

    **Example:**

        >>> rubber = hysteresis.DuhemOperator([2.0, 1.0, 0.5], [0.5, 1.0, 2.0], low=-1.0, high=1.0)
        >>> np.asarray(rubber.simulate(None, np.array([0.0, 1.0, 0.0]))).round(2).tolist()
        [0.0, 0.79, -0.38]
    """

    rising: Slopes = parameter(
        unit="output / input", bounds=(0.0, float("inf")), meaning="slope while the input rises"
    )
    falling: Slopes = parameter(
        unit="output / input", bounds=(0.0, float("inf")), meaning="slope while it falls"
    )
    low: Scalar = parameter(unit="output", fixed=True, meaning="first knot")
    high: Scalar = parameter(unit="output", fixed=True, meaning="last knot")
    offset: Scalar = parameter(0.0, unit="output", meaning="output at first, where u = 0")

    def __check_init__(self) -> None:
        shapes = jnp.shape(self.rising), jnp.shape(self.falling)
        if not shapes[0] or shapes[0] != shapes[1] or shapes[0][-1] < 2:
            raise InputError(
                "length-mismatch",
                f"slopes of shapes {shapes[0]} and {shapes[1]}.",
                fix="give as many rising as falling slopes, at least two.",
            )
        for name in ("rising", "falling"):
            value = getattr(self, name)
            if is_concrete(value) and not np.all(np.asarray(value) > 0):
                raise InputError(
                    "parameter-out-of-bounds",
                    f"{name} = {np.asarray(value).tolist()}.",
                    fix="give positive slopes; DuhemForce takes slopes of either sign.",
                )
        ends = self.low, self.high
        if all(map(is_concrete, ends)) and not np.all(np.asarray(self.high) > np.asarray(self.low)):
            raise InputError(
                "parameter-out-of-bounds",
                f"knots from {self.low} to {self.high}.",
                fix="give a high end above the low one.",
            )

    def init(self, t0: Any = None, u0: Any = None) -> DuhemState:
        return DuhemState(jnp.zeros_like(self.offset), jnp.asarray(self.offset))

    def step(self, state: DuhemState, t: Any, u: Any) -> tuple[DuhemState, Float[Array, ""]]:
        u = jnp.asarray(u, state.u.dtype)
        way = u - state.u
        slopes = self.slopes(way < 0)
        y = self._reached(slopes, self._way(slopes, state.y) + way)
        y = jnp.where(way == 0, state.y, y)
        return DuhemState(u, y), y

    def laws(self, eps: float, depth: int) -> Tree:
        """Both directions' slopes, one after the other."""
        both = self.rising, self.falling
        return node(
            "duhem",
            {
                "knots": self.rising.shape[0], "low": self.low, "width": self._width,
                "slopes": jnp.stack(both), "ways": jnp.stack([self._knots(one) for one in both]),
            },
            {"u": 0.0, "y": self.offset},
        )  # fmt: skip

    def way_to(self, y: Array, target: Array) -> Array:
        """The change of the input that brings the output from y to a target."""
        slopes = self.slopes(target < y)
        return self._way(slopes, target) - self._way(slopes, y)

    def slopes(self, falls: Array) -> Slopes:
        """The slopes at the knots, of one direction."""
        return jnp.where(falls, self.falling, self.rising)

    @property
    def _width(self) -> Scalar:
        return (self.high - self.low) / (self.rising.shape[-1] - 1)

    def _knots(self, slopes: Slopes) -> Array:
        """The input's way to each knot from the first one."""
        each = _integral(slopes[:-1], slopes[1:] / slopes[:-1] - 1, self._width)
        return jnp.concatenate([jnp.zeros_like(each[:1]), jnp.cumsum(each)])

    def _way(self, slopes: Slopes, y: Array) -> Array:
        """Integral of dy / slope from the first knot to y."""
        knots, width = self._knots(slopes), self._width
        cell = jnp.clip(jnp.floor((y - self.low) / width), 0.0, slopes.shape[-1] - 2.0)
        place = cell.astype(int)
        inside = jnp.clip(y, self.low, self.high) - (self.low + cell * width)
        bend = (slopes[place + 1] / slopes[place] - 1) * inside / width
        within = knots[place] + _integral(slopes[place], bend, inside)
        below, above = jnp.minimum(y - self.low, 0.0), jnp.maximum(y - self.high, 0.0)
        return within + below / slopes[0] + above / slopes[-1]

    def _reached(self, slopes: Slopes, way: Array) -> Array:
        """y after a way from the first knot: the inverse of `_way`."""
        knots, width = self._knots(slopes), self._width
        place = jnp.sum(way >= knots[1:-1])
        inside = jnp.clip(way, 0.0, knots[-1]) - knots[place]
        x = (slopes[place + 1] - slopes[place]) / width * inside
        small = jnp.abs(x) < SMALL
        safe = jnp.where(small, 1.0, x)
        growth = jnp.where(small, 1 + x / 2, jnp.expm1(safe) / safe)
        y = self.low + place.astype(way.dtype) * width + slopes[place] * inside * growth
        below, above = jnp.minimum(way, 0.0), jnp.maximum(way - knots[-1], 0.0)
        return y + below * slopes[0] + above * slopes[-1]


def _integral(slope: Array, bend: Array, length: Scalar) -> Array:
    """Integral of dx / f over a length where f goes straight from `slope` to (1 + bend) slope."""
    small = jnp.abs(bend) < SMALL
    safe = jnp.where(small, 1.0, bend)
    return length / slope * jnp.where(small, 1 - bend / 2, jnp.log1p(safe) / safe)
