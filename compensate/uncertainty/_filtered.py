"""An inverse that knows of noise: the model inside a filter of its input."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, is_concrete

from .._contract import AbstractCompensator, Status
from .._readings import with_reading
from ..inverses import inverse_of
from ._ensemble import UncertainEstimate

KINK = 0.25 - 0.5 / math.pi
"""What a line leaves of the variance of a corner, in parts of P times the jump of its slope squared."""


class FilteredState(NamedTuple):
    """The model and its inverse after the filtered inputs, the last of these, when, and its variance.

    Before the first reading the variance is infinite and `t` NaN.
    """

    model: Any
    inverse: Any
    value: Float[Array, ""]
    variance: Float[Array, ""]
    t: Float[Array, ""]


class FilteredCompensator(AbstractCompensator[FilteredState, UncertainEstimate]):
    """An extended Kalman filter of the input, for noisy readings.

    It finds the input that is likeliest if it walks at random and the reading is noisy:

        u_k = u_(k-1) + N(0, Q),     y_k = h(u_k) + N(0, R),     R = output_sigma^2,

    with h the model's next output from where it is, and Q = input_step^2 a sample, or input_step^2 dt
    where `by_time`. A sample is one update of an extended Kalman filter, variance P:

    - P += Q, and H is the slope of the chord of h across u +- sqrt(P): a branch either way. A loop as
      wide as u was uncertain, up and back, opens by 2 d: what h owes to turns not seen, R += d^2.
    - u += k (h^-1(y) - u), k = H^2 P / (H^2 P + R), towards the raw inverse, and so onto it where R
      is small. P = 1 / (1/P + H^2 / R), H again about the new u, the lesser; there the corner between the
      branches is noise too.
    - The model and its inverse go on to the filtered u: noise makes no reversals in their memory.

    The deviation sqrt(P) says what noise does to an input that moves like that; one that moves faster
    lags behind, and what is wrong with the model is not in it. On lagging Preisach and Burgers models and
    walks of these statistics 90 % bands held 89 to 94 %, on a leading Preisach model 84 %: h after
    turns that were not seen is known to first order only. The status is the raw inverse's.

    **Arguments:**

    - `model`: as for `invert`. `input_step`: standard deviation of the input's step per sample (or per
      square root of time). `output_sigma`: of the reading's noise.

    **Other arguments:**

    - `by_time`: steps grow with the square root of the time between samples, which is then needed.
    - `inverse`: of the model, if not `invert`'s.

    Raises `InputError` for deviations that are not positive and finite, and a model without inverse.

    **Example:**

        >>> smooth = compensate.FilteredCompensator(model, input_step=1.0, output_sigma=0.01)
        >>> smooth.simulate(t, model.simulate(t, u)).deviation.shape
        (13,)
    """

    model: AbstractModel
    raw: AbstractCompensator
    input_step: Float[Array, ""]
    output_sigma: Float[Array, ""]
    by_time: bool = eqx.field(static=True)

    def __init__(
        self,
        model: AbstractModel,
        input_step: ArrayLike,
        output_sigma: ArrayLike,
        *,
        by_time: bool = False,
        inverse: Callable[[AbstractModel], AbstractCompensator] = inverse_of,
    ):
        for name, value in {"input_step": input_step, "output_sigma": output_sigma}.items():
            if is_concrete(value) and not 0 < float(np.asarray(value)) < float("inf"):
                raise InputError(
                    "parameter-out-of-bounds",
                    f"{name} is {np.asarray(value):g}, and has to be positive and finite.",
                    fix="invert(model) is the inverse that takes every reading at its word.",
                )
        self.model, self.raw, self.by_time = model, inverse(model), by_time
        self.input_step = jnp.asarray(input_step, float)
        self.output_sigma = jnp.asarray(output_sigma, float)

    def init(self) -> FilteredState:
        never, unknown = jnp.asarray(jnp.nan, float), jnp.asarray(jnp.inf, float)
        return FilteredState(
            self.model.init(), self.raw.init(), jnp.zeros_like(never), unknown, never
        )

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: FilteredState | None = None
    ) -> UncertainEstimate:
        y = jnp.asarray(y, float)
        if t is None and self.by_time:
            raise InputError("no-time", "steps by time need the times.", fix="give t.")
        t = jnp.zeros(y.shape[:1]) if t is None else jnp.asarray(t, float)
        return _filter(self, t, y, self.init() if state is None else state)

    def step(
        self, state: FilteredState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[FilteredState, UncertainEstimate]:
        y, t = jnp.asarray(y, float), jnp.asarray(0.0 if t is None else t, float)
        valid, first = jnp.isfinite(y).all() & jnp.isfinite(t), jnp.isinf(state.variance)
        reading = self.raw.step(state.inverse, t, y)[1]
        noise = self.output_sigma**2

        # Before the first reading there is nothing to predict from, and nothing to be uncertain about.
        before = jnp.where(first, reading.value, state.value)
        past = jnp.where(first, 0.0, state.variance)
        dt = jnp.where(first, 1.0, jnp.maximum(t - state.t, 0.0)) if self.by_time else 1.0
        ahead = past + self.input_step**2 * dt

        def beside(x: Array) -> Array:
            """An input or an output beside the condition, where the model depends on one."""
            return with_reading(y, 0, x)

        def out(u: Array) -> Array:
            return self.model.step(state.model, t, beside(u))[1]

        def back(u: Array) -> Array:
            there = self.model.step(state.model, t, beside(u))[0]
            return self.model.step(there, t, beside(before))[1]

        reach = jnp.stack([jnp.sqrt(past), -jnp.sqrt(past)])
        up, down = jax.vmap(back)(before + reach)
        noise += jnp.where(first, 0.0, ((up - down) / 2) ** 2)
        slope, _ = _chord(out, before, jnp.sqrt(ahead))
        left = _left(ahead, slope, noise)
        gain = jnp.where(first, 1.0, slope**2 * left / noise)
        value = before + gain * (reading.value - before)
        # Within a millionth of the step a chord would be rounding.
        reach = jnp.sqrt(jnp.where(first, ahead, jnp.maximum(left, 1e-12 * ahead)))
        again, corner = _chord(out, value, reach)
        lesser = jnp.minimum(jnp.abs(slope), jnp.abs(again))
        variance = _left(ahead, lesser, noise + KINK * (reach * corner) ** 2)
        # Of the first input no more is known than what the first reading says.
        variance = jnp.where(first, noise / again**2, variance)

        model, output = self.model.step(state.model, t, beside(value))
        inverse, _ = self.raw.step(state.inverse, t, beside(output))
        after = FilteredState(model, inverse, value, variance, t)
        after = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, state)
        # Without any reading yet the raw inverse says what it holds.
        shown = jnp.where(valid, value, jnp.where(first, reading.value, state.value))
        status = jnp.where(valid, reading.status, Status.INVALID)
        return after, UncertainEstimate(shown, status, jnp.sqrt(after.variance))


def _chord(
    out: Callable[[Array], Array], u: Float[Array, ""], reach: Float[Array, ""]
) -> tuple[Array, Array]:
    """Slope of h across u +- reach, and the difference of its slopes either side."""
    low, middle, high = jax.vmap(out)(jnp.stack([u - reach, u, u + reach]))
    return (high - low) / (2 * reach), (high + low - 2 * middle) / reach


def _left(variance: Array, slope: Array, noise: Array) -> Array:
    """1 / (1 / P + H^2 / R)."""
    return variance * noise / (slope**2 * variance + noise)


@eqx.filter_jit
def _filter(
    compensator: FilteredCompensator, t: Array, y: Array, state: FilteredState
) -> UncertainEstimate:
    return jax.lax.scan(lambda own, now: compensator.step(own, *now), state, (t, y))[1]
