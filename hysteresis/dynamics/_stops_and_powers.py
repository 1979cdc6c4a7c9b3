"""Stops and powers: the reaction of a channel, without the straight line that a linear system has
itself."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import POSITIVE, as_float, check_shapes, parameter
from .._registry import register
from ..trees import node

POWERS = 3


@register
class StopsAndPowers(AbstractLawModel):
    """Stops of any sign, and powers of the input: what a spring has beside its straight line.

        y = sum_j weights_j s_j + powers_0 u^2 + powers_1 u^3 + powers_2 u |u|
        s_j,t = clip(s_j,t-1 + u_t - u_(t-1), -r_j, r_j),   s_0 = 0

    **Arguments:** `thresholds` (stops,) the r_j > 0, in the unit of the input; `weights` (stops,);
    `powers` (3,), none unless given.

    Raises `InputError` for other shapes, or a threshold that is not positive.

    Source: Iwan 1966.

    **Example:**

        >>> spring = hysteresis.StopsAndPowers([1.0], [2.0])
        >>> spring.simulate(None, np.array([0.5, 2.0, 1.5])).tolist()
        [1.0, 2.0, 1.0]
    """

    thresholds: Float[Array, " stops"] = parameter(
        unit="input", **POSITIVE, fixed=True, meaning="strain at which a stop slides"
    )
    weights: Float[Array, " stops"] = parameter(
        unit="output / input", meaning="stiffnesses of the stops"
    )
    powers: Float[Array, " powers"] = parameter(meaning="of u^2, u^3 and u |u|")

    def __init__(self, thresholds: Any, weights: Any, powers: Any = (0.0,) * POWERS):
        self.thresholds, self.weights = as_float(thresholds), as_float(weights)
        self.powers = as_float(powers)

    def __check_init__(self) -> None:
        check_shapes(
            0, False, thresholds=(self.thresholds, "stops"), weights=(self.weights, "stops"),
            powers=(self.powers, f"{POWERS}"),
        )  # fmt: skip

    def laws(self, eps: float, depth: int) -> Tree:
        stops = len(self.thresholds)
        return node(
            "stops_and_powers",
            {
                "stops": stops, "thresholds": self.thresholds,
                "weights": self.weights, "powers": self.powers,
            },
            {"u": 0.0, "strain": np.zeros(stops)},
        )  # fmt: skip
