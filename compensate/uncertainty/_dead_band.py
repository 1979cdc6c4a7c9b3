"""A dead band in front of an inverse: noise on the reading makes no reversals there."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar, is_concrete

from .._contract import AbstractCompensator, Found
from .._readings import reading_of, with_reading


class DeadBandState(NamedTuple):
    """The inner state, and the reading it saw last: NaN before the first."""

    inner: Any
    held: Array


class DeadBandCompensator(AbstractCompensator[DeadBandState, Found]):
    """A compensator behind a dead band on its reading.

    It is the inner inverse of v_k = clip(v_(k-1), y_k - width, y_k + width), a play behind the reading.

    What it costs: on a way up or down v lies `width` behind y, so the estimate lies width / slope
    behind the input, dy/du = slope; after a reversal it stands still until the reading has come back
    by 2 width. Then again it is off by as much the other way. What it saves: noise that stays
    within +-width makes no reversals. Three standard deviations are a sensible width; see
    `hysteresis.preisach.input_noise`. Time goes on for an inner model with rates.

    **Arguments:** `inner`: any compensator; `width`: half the band, in the output's unit.

    Raises `InputError` for a width that is negative or not finite.

    **Example:**

        >>> quiet = compensate.DeadBandCompensator(compensator, width=0.1)
        >>> quiet.simulate(t, model.simulate(t, u)).value.shape
        (13,)
    """

    inner: AbstractCompensator[Any, Found]
    width: Scalar = 0.0

    def __check_init__(self) -> None:
        if is_concrete(self.width) and not 0 <= float(self.width) < float("inf"):
            raise InputError(
                "bad-option",
                f"half a dead band is {float(self.width):g} wide.",
                fix="give 0, or three times input_noise(y).",
            )

    def init(self) -> DeadBandState:
        return DeadBandState(self.inner.init(), jnp.asarray(jnp.nan, float))

    def step(
        self, state: DeadBandState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[DeadBandState, Found]:
        y = jnp.asarray(y, float)
        held, seen = self._play(state.held, reading_of(y, 0))
        inner, estimate = self.inner.step(state.inner, t, with_reading(y, 0, seen))
        return DeadBandState(inner, held), estimate

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: DeadBandState | None = None
    ) -> Found:
        state, y = self.init() if state is None else state, jnp.asarray(y, float)
        _, seen = jax.lax.scan(lambda own, now: self._play(own, now), state.held, reading_of(y, 1))
        return self.inner.simulate(t, with_reading(y, 1, seen), state.inner)

    def _play(
        self, held: Float[Array, ""], y: Float[Array, ""]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """What is held from now on, and what the inner inverse sees: no reading where there is none."""
        valid = jnp.isfinite(y)
        moved = jnp.where(jnp.isnan(held), y, jnp.clip(held, y - self.width, y + self.width))
        return jnp.where(valid, moved, held), jnp.where(valid, moved, y)
