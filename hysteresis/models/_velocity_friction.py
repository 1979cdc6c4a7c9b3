"""Friction and damping that depend on the velocity and on the place."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Tree
from .._parameter import NOT_NEGATIVE, POSITIVE, Scalar, check_increasing, check_shapes, parameter
from .._registry import register
from ..trees import AbstractSearchedModel, node

Values = Float[Array, "..."] | Any


@register
class VelocityFriction(AbstractSearchedModel):
    """Viscous and Coulomb friction with a velocity v that is filtered causally:

        y_t = offset + sum_k h_k(u_(t-1)) (c_k v_t + sum_j w_jk tanh(v_t / f_j)),
        v = q / tau,    q' = u' - q / tau

    v is the derivative of the input behind a first-order low-pass filter of time constant tau, exact for
    inputs that are straight between samples. White noise of deviation sigma in the input, sampled every
    dt < tau, becomes noise of about sigma (2 dt / tau)^0.5 / dt in v at dt << tau. tanh(v / f) is Coulomb
    friction, rounded below the speed f; several f together make any friction that rises with the speed and
    levels off. h_k are hat functions of the place before on `levels`, so that friction may differ along the
    stroke. With c, w >= 0, y rises with the present input, and has an inverse.

    **Arguments:**

    - `low`, `high`: the range of the input.
    - `speeds`: (J,) f_j, positive. `levels`: (K,) places, increasing; beyond them the end ones count.
    - `weights`: (J, K) w_jk, none negative. `viscous`: (K,) c_k, none negative.
    - `smoothing`: tau, positive. `offset`: the output's constant.

    Raises `InputError` where an argument does not meet these conditions, and `no-time` without times.

    Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994), without the Stribeck fall,
    which has no inverse.

    **Example:**

        >>> slider = hysteresis.VelocityFriction(
        ...     0.0, 4.0, np.array([0.1]), np.array([0.0, 4.0]), np.full((1, 2), 3.0), np.zeros(2),
        ...     smoothing=0.01,
        ... )
        >>> u = np.array([0.0, 1.0, 2.0, 1.0])
        >>> np.asarray(slider.simulate(np.arange(4.0), u)).round(3).tolist()
        [0.0, 3.0, 3.0, -3.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    speeds: Values = parameter(
        unit="input / time", **POSITIVE, fixed=True, meaning="speeds of the rounding"
    )
    levels: Values = parameter(unit="input", fixed=True, meaning="places of the hats")
    weights: Values = parameter(unit="output", **NOT_NEGATIVE, meaning="Coulomb friction")
    viscous: Values = parameter(
        unit="output * time / input", **NOT_NEGATIVE, meaning="viscous damping"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    smoothing: float = eqx.field(static=True, converter=float, kw_only=True)

    def __check_init__(self) -> None:
        if not (self.low < self.high and self.smoothing > 0):
            raise InputError(
                "zero-range",
                f"the input reaches from {self.low:g} to {self.high:g}, smoothed over {self.smoothing:g}.",
            )
        check_shapes(
            speeds=(self.speeds, "J"), levels=(self.levels, "K"), weights=(self.weights, "J K"),
            viscous=(self.viscous, "K"),
        )  # fmt: skip
        check_increasing("levels", self.levels)

    needs_time = True

    def forwards(self) -> Tree:
        return node(
            "friction",
            {
                "speeds_count": len(self.speeds), "count": len(self.levels), "speeds": self.speeds,
                "levels": self.levels, "weights": self.weights, "viscous": self.viscous,
                "rate": 1 / self.smoothing, "offset": self.offset,
            },
            {"begun": 0, "u": 0.0, "lead": 0.0, "dt": -1.0, "decay": 0.0, "gain": 0.0},
        )  # fmt: skip
