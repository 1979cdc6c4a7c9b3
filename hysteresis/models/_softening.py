"""First-cycle conditioning: what an input has never reached is stiffer than what it has."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Tree
from .._parameter import Scalar, array_module, check_range, is_concrete, parameter
from .._registry import register
from ..trees import AbstractSearchedModel, node


@register
class Softening(AbstractSearchedModel):
    """Conditioning by the largest input so far (Mullins effect), with recovery at rest:

        y = sum_{i <= j} d_ij r_i(u) S_j,
        S_j(t) = max over s <= t of r_j(u(s)) exp(-(t - s) / recovery)

    r_i(u) is 0 below cell i of an even grid on [low, high], 1 above it and a ramp within. After an input
    has reached cell j, each cell i below it gives way by d_ij more, so the output lags.

    **Arguments:**

    - `low`, `high`: the range of the input.
    - `weights`: (n, n), entries j >= i are used (row i, column j), none negative.
    - `recovery`: the time constant with which conditioning is forgotten; infinite for never.

    **Other arguments:**

    - `leading`: for an output that leads (displacement -> force), cells that the input has never reached
      resist more: y = sum_{i <= j} d_ij [r_i(u) (1 - S_j) + r_j(u)]. The last term makes y rise with u on
      the first loading.

    In both cases y never falls while u rises.

    Raises `InputError` for weights of the wrong shape or sign, a recovery time that is not positive, and
    an empty range.

    Source: the largest deformation so far, as in Ogden and Roxburgh, Proc. R. Soc. A 455 (1999).

    **Example:**

        >>> foam = hysteresis.Softening(0.0, 2.0, np.triu(np.ones((2, 2))))
        >>> foam.simulate(None, np.array([0.0, 1.0, 2.0, 1.0, 2.0])).tolist()
        [0.0, 2.0, 3.0, 1.0, 3.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    weights: Float[Array, "cells cells"] | np.ndarray = parameter(
        unit="output", bounds=(0.0, float("inf")), at=None, meaning="softening of a cell by another"
    )
    recovery: Scalar = parameter(
        float("inf"), unit="time", bounds=(0.0, float("inf")), at="high", fixed=True,
        meaning="time in which conditioning is forgotten",
    )  # fmt: skip
    leading: bool = eqx.field(default=True, static=True, kw_only=True)

    def __check_init__(self) -> None:
        check_range("cells reach", self.low, self.high)
        if self.weights.ndim != 2 or self.weights.shape[0] != self.weights.shape[1]:
            raise InputError("wrong-shape", f"weights of shape {self.weights.shape}.")
        if is_concrete(self.weights) and np.triu(np.asarray(self.weights)).min() < 0:
            raise InputError("parameter-out-of-bounds", "softening is not negative.")

    @property
    def needs_time(self) -> bool:
        return is_concrete(self.recovery) and bool(np.isfinite(self.recovery))

    def forwards(self) -> Tree:
        xp = array_module(self.weights)
        weights = xp.triu(xp.asarray(self.weights))
        n = len(weights)
        return node(
            "softening",
            {
                "cells": n, "low": self.low, "scale": n / (self.high - self.low),
                "weights": jnp.asarray(weights), "columns": jnp.asarray(weights.sum(0)),
                "forgetting": 1 / self.recovery, "leading": self.leading,
            },
            {"reached": np.zeros(n)},
        )  # fmt: skip
