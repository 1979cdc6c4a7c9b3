"""Drifts of the output: with the path that the input has travelled, and with the time."""

import math
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from .._errors import InputError
from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import POSITIVE, Scalar, check_increasing, check_shapes, parameter
from .._registry import register
from ..trees import node

Values = Float[Array, "..."] | Any


@register
class CyclicDrift(AbstractLawModel):
    """Softening, hardening or creep from cycle to cycle, by the logarithm of the path travelled:

        y_t = offset + sum_k d_k h_k(u_(t-1)) log((length + clip(P_(t-1), least, most)) / (length + least)),
        P_t = P_(t-1) + |u_t - u_(t-1)|,   P_0 = 0

    h_k are hat functions of the place before on `levels`: each is 1 at its level and 0 at the others, and
    they add up to 1. A drift that differs between them is a change of stiffness. It does not depend on the
    rate, nor on the present input: beside parts that rise with it, the sum has an inverse. From the tenth
    cycle to the hundredth the logarithm changes as much as from the first to the tenth. Until the path
    `least` nothing drifts, where first cycles were not measured or differ from later ones; from `most` on
    the output stays where it drifted to, because no longer path was measured.

    **Arguments:**

    - `low`, `high`: the range of the input.
    - `levels`: (K,) places, increasing; beyond them the end ones count.
    - `rates`: (K,) d_k, of either sign. `length`: a path, positive. `least`: a path, not negative;
      `most`: a path not below it, infinite by default.
    - `offset`: the output's constant.

    Raises `InputError` where an argument does not meet these conditions.

    Source: the logarithm of cycles in Mullins softening and cyclic creep, e.g. Diani, Fayolle, Gilormini,
    European Polymer Journal 45 (2009).

    **Example:**

        >>> levels, rates = np.array([0.0, 1.0]), np.array([0.0, -1.0])
        >>> drift = hysteresis.CyclicDrift(0.0, 1.0, levels, rates, length=1.0)
        >>> np.asarray(drift.simulate(None, np.array([0.0, 1.0, 1.0, 0.0, 1.0]))).round(3).tolist()
        [0.0, 0.0, -0.693, -0.693, 0.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    levels: Values = parameter(unit="input", fixed=True, meaning="places of the hats")
    rates: Values = parameter(unit="output", meaning="drift at each place")
    length: float = eqx.field(static=True, converter=float, kw_only=True)
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    least: float = eqx.field(default=0.0, static=True, converter=float)
    most: float = eqx.field(default=math.inf, static=True, converter=float)

    def __check_init__(self) -> None:
        if not (self.low < self.high and self.length > 0 and 0 <= self.least <= self.most):
            raise InputError(
                "zero-range",
                f"the input reaches from {self.low:g} to {self.high:g}, over paths of {self.length:g} from"
                f" {self.least:g} to {self.most:g}.",
            )
        check_shapes(levels=(self.levels, "K"), rates=(self.rates, "K"))
        check_increasing("levels", self.levels)

    def laws(self, eps: float, depth: int) -> Tree:
        """Part of a sum: alone it has no inverse."""
        return node(
            "drift",
            {
                "count": len(self.levels), "levels": self.levels, "drift": self.rates,
                "least": self.least, "most": min(self.most - self.least, 1e30),
                "length": self.length + self.least, "offset": self.offset,
            },
            {"begun": 0, "u": 0.0, "path": 0.0, "gained": 0.0},
        )  # fmt: skip


@register
class TimeDrift(AbstractLawModel):
    """Warming up, aging or a creeping zero: a drift that goes on whatever the input does.

        y_t = offset + sum_k d_k (1 - exp(-min(s, most) / tau_k)),    s = time since the first sample

    It does not depend on the input: beside parts that rise with it, the sum has an inverse. A sequence
    that begins anew drifts anew, so it describes runs that begin alike, from the same rest.

    **Arguments:**

    - `times`: (K,) tau_k, positive. `rates`: (K,) d_k, of either sign.
    - `offset`: the output's constant. `most`: a time after which the output stays where it drifted to,
      infinite by default.

    Raises `InputError` where an argument does not meet these conditions, and `no-time` without times.

    Source: the response of a zero to a step of temperature, e.g. Doebelin, Measurement Systems (2003).

    **Example:**

        >>> drift = hysteresis.TimeDrift(np.array([1.0]), np.array([2.0]))
        >>> np.asarray(drift.simulate(np.array([3.0, 4.0]), np.zeros(2))).round(3).tolist()
        [0.0, 1.264]
    """

    times: Values = parameter(
        unit="time", **POSITIVE, fixed=True, meaning="time constants of the drift"
    )
    rates: Values = parameter(unit="output", meaning="drift of each time constant in the end")
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    most: float = eqx.field(default=math.inf, static=True, converter=float)

    def __check_init__(self) -> None:
        check_shapes(times=(self.times, "K"), rates=(self.rates, "K"))
        if not self.most >= 0:
            raise InputError("parameter-out-of-bounds", f"most={self.most:g} is a time below 0.")

    needs_time = True

    def laws(self, eps: float, depth: int) -> Tree:
        """Part of a sum: alone it has no inverse."""
        return node(
            "time_drift",
            {
                "count": len(self.times), "rates": 1 / self.times, "ends": self.rates,
                "most": min(self.most, 1e30), "offset": self.offset,
            },
            {"begun": 0, "elapsed": 0.0, "gained": 0.0},
        )  # fmt: skip
