"""Duhem's operator with positive slopes: the slope depends on the output and on the direction."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import POSITIVE, Scalar, check_shapes, is_concrete, parameter
from .._registry import register
from ..trees import node

Slopes = Float[Array, " knots"] | Any

SMALL = 1e-8
"""Of the quantities whose first terms then are a series to rounding."""


@register
class DuhemOperator(AbstractLawModel):
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
        unit="output / input", **POSITIVE, meaning="slope while the input rises"
    )
    falling: Slopes = parameter(unit="output / input", **POSITIVE, meaning="slope while it falls")
    low: Scalar = parameter(unit="output", fixed=True, meaning="first knot")
    high: Scalar = parameter(unit="output", fixed=True, meaning="last knot")
    offset: Scalar = parameter(0.0, unit="output", meaning="output at first, where u = 0")

    def __check_init__(self) -> None:
        check_shapes(2, rising=(self.rising, "knots"), falling=(self.falling, "knots"))
        ends = self.low, self.high
        if all(map(is_concrete, ends)) and not np.all(np.asarray(self.high) > np.asarray(self.low)):
            said = f"knots from {self.low} to {self.high}."
            mend = "give a high end above the low one."
            raise InputError("parameter-out-of-bounds", said, fix=mend)

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

    @property
    def _width(self) -> Scalar:
        return (self.high - self.low) / (self.rising.shape[-1] - 1)

    def _knots(self, slopes: Slopes) -> Array:
        """The input's way to each knot from the first one."""
        each = _integral(slopes[:-1], slopes[1:] / slopes[:-1] - 1, self._width)
        return jnp.concatenate([jnp.zeros_like(each[:1]), jnp.cumsum(each)])


def _integral(slope: Array, bend: Array, length: Scalar) -> Array:
    """Integral of dx / f over a length where f goes straight from `slope` to (1 + bend) slope."""
    small = jnp.abs(bend) < SMALL
    safe = jnp.where(small, 1.0, bend)
    return length / slope * jnp.where(small, 1 - bend / 2, jnp.log1p(safe) / safe)
