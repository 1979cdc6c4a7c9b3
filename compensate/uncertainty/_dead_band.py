"""A dead band in front of an inverse: noise on the reading makes no reversals there."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar
from hysteresis._once import once
from hysteresis._parameter import is_concrete
from hysteresis.running import Numbers, each, numbers_of
from hysteresis.trees import Tree, node

from .._contract import AbstractCompensator, Found
from .._readings import reading_of, with_reading


class DeadBandState(NamedTuple):
    """The inner state, and what the law of the dead band keeps."""

    inner: Any
    play: Float[Array, " state"]


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
        first = jnp.asarray(self._numbers.state, float)
        return DeadBandState(self.inner.init(), first)

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: DeadBandState
    ) -> tuple[DeadBandState, Found]:
        y = jnp.asarray(y, float)
        reading = reading_of(y, 1)
        held = each(self._numbers, "move", reading, state=state.play)
        # No reading is passed on as none.
        seen = jnp.where(jnp.isfinite(reading), held.value, reading)
        inner, found = self.inner.stream(t, with_reading(y, 1, seen), state.inner)
        return DeadBandState(inner, jnp.asarray(held.state)), found

    @once
    def _numbers(self) -> Numbers:
        return numbers_of(self.law())

    def law(self) -> Tree:
        """See `hysteresis/laws/dead_band.py`."""
        return node("dead_band", {"width": self.width}, {"begun": 0, "held": 0.0})
