"""A guard around a compensator: estimates limited to the trained inputs, and a status while it runs in."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import InputError, is_concrete, register

from .._contract import AbstractCompensator, Found, Status
from .._readings import reading_of, with_reading
from ._run_in import RunIn

BEYOND = ("limit", "nan", "free")
"""What becomes of an estimate beyond the trained inputs."""

ROUNDING = 1e-6
"""Part of the trained range. Just after a reversal 1e-14 of the output is 1e-7 of the input, so an estimate
closer than that to an end is at the end."""


class GuardedState(NamedTuple):
    """The inner state; which ends of the range estimates have seen; the first time, NaN before it."""

    inner: Any
    bottom: Array
    top: Array
    t: Array


@register
class GuardedCompensator(AbstractCompensator[GuardedState, Found]):
    """A compensator whose estimates stay within the inputs that its model was trained on.

    ```math
    \\hat u = \\mathrm{clip}(\\hat u_\\text{inner}, low, high)
    ```

    Every estimate beyond is `EXTRAPOLATED`, or `SATURATED` where the inner compensator says so; an estimate
    less than a millionth of the range beyond is rounding and is not told. The memory goes on with what the
    inner compensator found: an excursion of the input beyond the range, and back, is remembered as it was.

    With `run_in`, the state before the first sample is not known. The status is `RUN_IN`, in place of `OK`
    and `FLAT`, until one estimate was at `run_in.bottom` or below, another at `run_in.top` or above, and
    `run_in.time` has passed since the first reading.

    The deviation is that of the inner compensator; beyond the range it does not say how far beyond the
    input is.

    **Arguments:**

    - `inner`: any compensator. `low`, `high`: the trained inputs, in the input's unit.
    - `beyond`: `"limit"` as above; `"nan"`: an estimate beyond is NaN; `"free"`: only the status tells.
    - `run_in`: None: the first state is known, and is the model's.
    - `readings`: readings beyond these are taken for the nearer end, `EXTRAPOLATED`; as exports do.

    **Raises:** `InputError` `zero-range` for limits that are not low < high, `bad-option` for another
    `beyond`.

    **Example:**

        >>> guarded = compensate.GuardedCompensator(compensator, 0.0, 4.0)
        >>> float(guarded.simulate(t, model.simulate(t, u)).value.max())
        4.0
    """

    inner: AbstractCompensator[Any, Found]
    low: Float[Array, ""]
    high: Float[Array, ""]
    beyond: str = eqx.field(static=True)
    run_in: RunIn | None
    readings: tuple[float, float] | None = eqx.field(static=True)

    def __init__(
        self,
        inner: AbstractCompensator[Any, Found],
        low: ArrayLike,
        high: ArrayLike,
        beyond: str = "limit",
        run_in: RunIn | None = None,
        readings: tuple[float, float] | None = None,
    ):
        if beyond not in BEYOND:
            raise InputError(
                "bad-option", f"beyond={beyond!r} is unknown.", fix='give "limit", "nan" or "free".'
            )
        self.low, self.high = jnp.asarray(low, float), jnp.asarray(high, float)
        if is_concrete(self.low) and not bool(self.low < self.high):
            raise InputError(
                "zero-range",
                f"the trained inputs reach from {float(self.low):g} to {float(self.high):g}.",
                fix="give low < high, the least and the greatest input of the training rows.",
            )
        self.inner, self.beyond, self.run_in = inner, beyond, run_in
        self.readings = None if readings is None else (float(readings[0]), float(readings[1]))

    def init(self) -> GuardedState:
        unseen = jnp.asarray(False)
        return GuardedState(self.inner.init(), unseen, unseen, jnp.asarray(jnp.nan, float))

    def step(
        self, state: GuardedState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[GuardedState, Found]:
        y = jnp.asarray(y, float)
        reading = reading_of(y, 0)
        t = jnp.zeros_like(reading) if t is None else jnp.asarray(t, float)
        seen = self._clipped(reading)
        inner, found = self.inner.step(state.inner, t, with_reading(y, 0, seen))
        (bottom, top, first), found = self._judged(
            state, t[None], reading[None], seen[None], _rows(found)
        )
        after = GuardedState(inner, bottom[0], top[0], first)
        return after, jax.tree.map(lambda a: a[..., 0], found)

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: GuardedState | None = None
    ) -> Found:
        y = jnp.asarray(y, float)
        state = self.init() if state is None else state
        reading = reading_of(y, 1)
        seen = self._clipped(reading)
        found = self.inner.simulate(t, with_reading(y, 1, seen), state.inner)
        t = jnp.zeros_like(reading) if t is None else jnp.asarray(t, float)
        return self._judged(state, t, reading, seen, found)[1]

    def _clipped(self, y: Array) -> Array:
        if self.readings is None:
            return y
        return jnp.where(jnp.isfinite(y), jnp.clip(y, *self.readings), y)

    @eqx.filter_jit
    def _judged(self, state: GuardedState, t: Array, y: Array, seen: Array, found: Any) -> Any:
        """What has been seen up to every sample, and the estimates as they are given out."""
        value, status = found.value, found.status
        valid = status != Status.INVALID
        sound = (status == Status.OK) | (status == Status.FLAT)
        run_in = self.run_in or RunIn(jnp.inf, -jnp.inf, 0.0)
        bottom = state.bottom | _ever(valid & (value <= run_in.bottom))
        top = state.top | _ever(valid & (value >= run_in.top))
        first = jnp.where(valid.any(), t[jnp.argmax(valid)], jnp.nan)
        first = jnp.where(jnp.isnan(state.t), first, state.t)
        known = bottom & top & ((t - first >= run_in.time) | (run_in.time == 0))
        status = jnp.where(sound & ~known, Status.RUN_IN, status)

        slack = ROUNDING * (self.high - self.low)
        beyond = (value < self.low - slack) | (value > self.high + slack)
        clipped = jnp.isfinite(y) & (seen != y)
        status = jnp.where((beyond | clipped) & sound, Status.EXTRAPOLATED, status)
        found = found._replace(value=self._limited(value), status=status)
        if getattr(found, "draws", None) is not None:
            found = found._replace(draws=self._limited(found.draws))
        return (bottom, top, first), found

    def _limited(self, value: Array) -> Array:
        if self.beyond == "free":
            return value
        if self.beyond == "limit":
            return jnp.clip(value, self.low, self.high)
        slack = ROUNDING * (self.high - self.low)
        beyond = (value < self.low - slack) | (value > self.high + slack)
        return jnp.where(beyond, jnp.nan, value)


def _ever(now: Array) -> Array:
    """Whether it was so at a sample or before."""
    return jax.lax.cummax(now.astype(int)) > 0


def _rows(found: Any) -> Any:
    """One estimate as a series of one."""
    return jax.tree.map(lambda a: a[..., None], found)
