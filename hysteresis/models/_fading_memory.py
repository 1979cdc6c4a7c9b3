"""What is left of an input's past moves: a linear memory that fades, of either sign."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractModel, Series, before_each, is_start, time_steps
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..numerics._recurrence import linear_recurrence
from ..numerics._relaxation import decay_and_gain

Values = Float[Array, "..."] | Any


class FadingState(NamedTuple):
    """Time and input of the last sample, NaN before the first, and what is left of all moves until then."""

    t: Array
    u: Array
    left: Array


class FadingInput(NamedTuple):
    """Steps dt, moves since the sample before, starts, and what was left before the first sample."""

    dt: Array
    moved: Array
    start: Array
    left: Array


@register
class FadingMemory(AbstractModel[FadingState, FadingInput]):
    """Responses to the moves before the present one, each with a time constant, of either sign:

        y_t = offset + sum_k w_k exp(-dt / tau_k) Q_k,(t-1),     Q_k' = -Q_k / tau_k + u',   Q_k = 0 at rest

    Q_k follows a move at once and forgets it in the time tau_k. Weights of either sign describe what no sum
    of springs and dashpots does: a dead time, a response that overshoots or recovers. The output does not
    depend on the present input: beside parts that rise with it, the sum has an inverse. Steps are exact for
    inputs that are straight between samples.

    **Arguments:**

    - `times`: (K,) tau_k, positive. `weights`: (K,) w_k, of either sign.
    - `offset`: the output's constant.
    - `rest`: the input before the first sample; None for the first input itself.

    Raises `InputError` where an argument does not meet these conditions, and `no-time` without times.

    Source: the fading memory of a linear system as a sum of exponentials, e.g. Boyd and Chua, IEEE Trans.
    Circuits and Systems 32 (1985).

    **Example:**

        >>> memory = hysteresis.FadingMemory(np.array([1.0]), np.array([-2.0]))
        >>> y = memory.simulate(np.arange(4.0), np.array([0.0, 1.0, 1.0, 1.0]))
        >>> np.asarray(y).round(3).tolist()
        [0.0, 0.0, -0.465, -0.171]
    """

    times: Values = parameter(
        unit="time", bounds=(0.0, float("inf")), fixed=True, meaning="time constants"
    )
    weights: Values = parameter(unit="output/input", meaning="response to a past move")
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    rest: float | None = eqx.field(default=None, static=True, kw_only=True)

    def __check_init__(self) -> None:
        if self.weights.shape[-1:] != np.shape(self.times)[-1:]:
            raise InputError(
                "length-mismatch",
                f"{len(self.times)} times, but weights of shape {self.weights.shape}.",
                fix=f"give ({len(self.times)},) weights.",
            )
        if is_concrete(self.times) and not (np.asarray(self.times) > 0).all():
            raise InputError("parameter-out-of-bounds", "times must be positive.")

    def init(self, t0: Any = None, u0: Any = None) -> FadingState:
        left = jnp.zeros_like(jnp.asarray(self.weights, float))
        nan = jnp.full_like(left[0], jnp.nan)
        return FadingState(nan, nan, left)

    def step(self, state: FadingState, t: Any, u: Any) -> tuple[FadingState, Float[Array, ""]]:
        if t is None:
            raise _no_time()
        t, u = jnp.asarray(t, state.t.dtype), jnp.asarray(u, state.u.dtype)
        dt = jnp.where(jnp.isnan(state.t), 0.0, t - state.t)
        decay, gain = decay_and_gain(dt / jnp.asarray(self.times))
        past = decay * state.left
        moved = u - jnp.where(jnp.isnan(state.u), self._begin(u), state.u)
        return FadingState(t, u, past + gain * moved), self._output(past)

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: FadingState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> FadingInput:
        if t is None:
            raise _no_time()
        u = jnp.asarray(u)
        state = self.init() if state is None else state
        first = u[jnp.asarray(starts)]
        begin = jnp.where(jnp.isnan(state.u), self._begin(first), state.u.astype(u.dtype))
        dt = time_steps(jnp.asarray(t, u.dtype), state.t, starts)
        moved = u - before_each(u, begin, starts)
        return FadingInput(dt, moved, is_start(len(u), starts), state.left)

    def evaluate(self, prepared: FadingInput) -> Float[Array, " samples"]:
        dt, moved, start, left = prepared
        decay, gain = decay_and_gain(dt[:, None] / jnp.asarray(self.times))
        start = start[:, None]
        begun = start * decay * left
        rise = gain * moved[:, None]
        rows = linear_recurrence(tuple((decay * (1 - start)).T), tuple((rise + begun).T))
        return self._output(jnp.stack(rows, -1) - rise)

    def _begin(self, first: Array) -> Array:
        return first if self.rest is None else jnp.full_like(first, self.rest)

    def _output(self, past: Array) -> Array:
        return self.offset + past @ jnp.asarray(self.weights)


def _no_time() -> InputError:
    return InputError(
        "no-time",
        "FadingMemory depends on the rate, and this record has no time.",
        fix="name the time column (--time COL) or the sampling step (--dt SECONDS).",
    )
