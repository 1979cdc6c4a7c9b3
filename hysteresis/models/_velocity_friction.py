"""Friction and damping that depend on the velocity and on the place."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Series, Tree, before_each, is_start, time_steps
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..numerics._hats import hats
from ..numerics._recurrence import linear_recurrence
from ..numerics._relaxation import decay_and_gain
from ..trees import AbstractSearchedModel, node

Values = Float[Array, "..."] | Any


class FrictionState(NamedTuple):
    """Time and input of the last sample, NaN before the first, and the filter's q."""

    t: Array
    u: Array
    lead: Array


class FrictionInput(NamedTuple):
    """Steps dt, input rises since the sample before, inputs before, starts, and the first state."""

    dt: Array
    rise: Array
    before: Array
    start: Array
    state: FrictionState


@register
class VelocityFriction(AbstractSearchedModel[FrictionState, FrictionInput]):
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
        unit="input / time",
        bounds=(0.0, float("inf")),
        fixed=True,
        meaning="speeds of the rounding",
    )
    levels: Values = parameter(unit="input", fixed=True, meaning="places of the hats")
    weights: Values = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="Coulomb friction"
    )
    viscous: Values = parameter(
        unit="output * time / input", bounds=(0.0, float("inf")), meaning="viscous damping"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    smoothing: float = eqx.field(static=True, converter=float, kw_only=True)

    def __check_init__(self) -> None:
        if not (self.low < self.high and self.smoothing > 0):
            raise InputError(
                "zero-range",
                f"the input reaches from {self.low:g} to {self.high:g}, smoothed over {self.smoothing:g}.",
            )
        J, K = len(self.speeds), len(self.levels)
        if self.weights.shape[-2:] != (J, K) or self.viscous.shape[-1:] != (K,):
            raise InputError(
                "length-mismatch",
                f"{J} speeds and {K} levels, but weights of shape {self.weights.shape} and viscous of shape"
                f" {self.viscous.shape}.",
                fix=f"give ({J}, {K}) weights and ({K},) viscous coefficients.",
            )
        given = self.speeds, self.levels, self.weights, self.viscous
        if not all(map(is_concrete, given)):
            return
        speeds, levels, weights, viscous = map(np.asarray, given)
        ordered = bool((np.diff(levels) > 0).all() and (speeds > 0).all())
        if not ordered or min(weights.min(initial=0.0), viscous.min()) < 0:
            raise InputError(
                "parameter-out-of-bounds",
                "speeds must be positive, levels increase, weights and viscous not be negative.",
            )

    def init(self, t0: Any = None, u0: Any = None) -> FrictionState:
        zero = jnp.zeros_like(jnp.asarray(self.viscous)[0])
        return FrictionState(zero + jnp.nan, zero + jnp.nan, zero)

    def step(self, state: FrictionState, t: Any, u: Any) -> tuple[FrictionState, Float[Array, ""]]:
        t, u = jnp.asarray(t, state.t.dtype), jnp.asarray(u, state.u.dtype)
        first = jnp.isnan(state.t)
        before = jnp.where(first, u, state.u)
        decay, gain = decay_and_gain(jnp.where(first, 0.0, t - state.t) / self.smoothing)
        lead = decay * state.lead + gain * (u - before)
        return FrictionState(t, u, lead), self._output(lead / self.smoothing, before)

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: FrictionState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> FrictionInput:
        if t is None:
            raise InputError(
                "no-time",
                "VelocityFriction depends on the rate, and this record has no time.",
                fix="name the time column (--time COL) or the sampling step (--dt SECONDS).",
            )
        state = self.init() if state is None else state
        u = jnp.asarray(u, state.u.dtype)
        begin = jnp.where(jnp.isnan(state.u), u[jnp.asarray(starts)], state.u)
        before = before_each(u, begin, starts)
        dt = time_steps(jnp.asarray(t, u.dtype), state.t, starts)
        return FrictionInput(dt, u - before, before, is_start(len(u), starts), state)

    def evaluate(self, prepared: FrictionInput) -> Float[Array, " samples"]:
        return jax.vmap(self._output)(self.velocity(prepared), prepared.before)

    def velocity(self, prepared: FrictionInput) -> Float[Array, " samples"]:
        """v at every sample."""
        dt, rise, _, start, state = prepared
        decay, gain = decay_and_gain(dt / self.smoothing)
        drive = gain * rise + start * decay * state.lead
        (lead,) = linear_recurrence((decay * (1 - start),), (drive,))
        return lead / self.smoothing

    def law(self) -> Tree:
        return node(
            "friction",
            {
                "speeds_count": len(self.speeds), "count": len(self.levels), "speeds": self.speeds,
                "levels": self.levels, "weights": self.weights, "viscous": self.viscous,
                "rate": 1 / self.smoothing, "offset": self.offset,
            },
            {"begun": 0, "u": 0.0, "lead": 0.0, "dt": -1.0, "decay": 0.0, "gain": 0.0},
        )  # fmt: skip

    def _output(self, v: Array, before: Array) -> Array:
        sliding = jnp.tanh(v / jnp.asarray(self.speeds)) @ jnp.asarray(self.weights)
        felt = sliding + v * jnp.asarray(self.viscous)
        return self.offset + jnp.dot(felt, hats(before, jnp.asarray(self.levels)))
