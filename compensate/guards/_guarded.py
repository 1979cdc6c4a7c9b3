"""A guard around a compensator: estimates limited to the trained inputs, and a status while it runs in."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import InputError, is_concrete, register

from .._contract import AbstractCompensator, Found, Status
from .._readings import reading_of, with_reading
from ..runtime._file import LONGEST
from ._run_in import RunIn

BEYOND = ("limit", "nan", "free")
"""What becomes of an estimate beyond the trained inputs."""

ROUNDING = 1e-6
"""Part of the trained range. Just after a reversal 1e-14 of the output is 1e-7 of the input, so an estimate
closer than that to an end is at the end."""


LASTING = 1000.0
"""Durations of the readings that one step may take."""


def longest_step(t: ArrayLike) -> float:
    """The longest time between two samples of a compensator that was made for readings at the times `t`.

    Beyond, a free dashpot would flow so far that nothing of the readings is left in the numbers.
    """
    return min(LASTING * (float(np.ptp(np.asarray(t, float))) or 1.0), LONGEST)


class GuardedState(NamedTuple):
    """The inner state; which ends of the range estimates have seen; the inner clock's first time; the time
    of the last reading; what long steps have taken off the clock. NaN before the first reading."""

    inner: Any
    bottom: Array
    top: Array
    first: Array
    last: Array
    removed: Array


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
    - `longest`: the longest time between two readings, in the unit of `t`; a longer one is taken for it,
      `EXTRAPOLATED`, as exports do. None: a step of any length is taken as it is.

    **Raises:** `InputError` `zero-range` for limits that are not low < high, `bad-option` for another
    `beyond`, and for a `longest` that is not positive.

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
    longest: Float[Array, ""] | None

    def __init__(
        self,
        inner: AbstractCompensator[Any, Found],
        low: ArrayLike,
        high: ArrayLike,
        beyond: str = "limit",
        run_in: RunIn | None = None,
        readings: tuple[float, float] | None = None,
        longest: ArrayLike | None = None,
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
        if (
            longest is not None
            and is_concrete(longest)
            and not bool(np.all(np.asarray(longest) > 0))
        ):
            raise InputError(
                "bad-option", f"longest={longest!r} is not a time.", fix="give a positive time."
            )
        self.longest = None if longest is None else jnp.asarray(longest, float)

    def init(self) -> GuardedState:
        unseen, none = jnp.asarray(False), jnp.asarray(jnp.nan, float)
        return GuardedState(self.inner.init(), unseen, unseen, none, none, jnp.zeros_like(none))

    def step(
        self, state: GuardedState, t: ArrayLike | None, y: ArrayLike
    ) -> tuple[GuardedState, Found]:
        y = jnp.asarray(y, float)
        reading = reading_of(y, 0)
        t = jnp.zeros_like(reading) if t is None else jnp.asarray(t, float)
        seen = self._clipped(reading)
        clock, late, last, removed = self._clock(state, t[None], y[None])
        inner, found = self.inner.step(state.inner, clock[0], with_reading(y, 0, seen))
        (bottom, top, first), found = self._judged(
            state, clock, late, reading[None], seen[None], _rows(found)
        )
        after = GuardedState(inner, bottom[0], top[0], first, last, removed)
        return after, jax.tree.map(lambda a: a[..., 0], found)

    def simulate(
        self, t: ArrayLike | None, y: ArrayLike, state: GuardedState | None = None
    ) -> Found:
        y = jnp.asarray(y, float)
        state = self.init() if state is None else state
        reading = reading_of(y, 1)
        seen = self._clipped(reading)
        given = jnp.zeros_like(reading) if t is None else jnp.asarray(t, float)
        clock, late, _, _ = self._clock(state, given, y)
        if t is not None and self.longest is not None:
            t = clock
        found = self.inner.simulate(t, with_reading(y, 1, seen), state.inner)
        return self._judged(state, clock, late, reading, seen, found)[1]

    def _clock(self, state: GuardedState, t: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """The inner clock, in which no step is longer than `longest`; which samples come after a longer
        one; the time of the last reading, and what long steps have taken off the clock up to there."""
        if self.longest is None:
            return t, jnp.zeros(t.shape, bool), state.last, state.removed
        finite = jnp.isfinite(y)
        valid = finite if y.ndim == 1 else finite.all(axis=-1)
        at = jax.lax.cummax(jnp.where(valid, jnp.arange(t.shape[0]), -1))
        before = jnp.concatenate([jnp.full(1, -1), at[:-1]])
        wait = t - jnp.where(before < 0, state.last, t[before])
        late = valid & (wait >= self.longest)
        removed = state.removed + jnp.cumsum(jnp.where(late, wait - self.longest, 0.0))
        last = jnp.where(at[-1] < 0, state.last, t[at[-1]])
        return t - removed, late, last, removed[-1]

    def _clipped(self, y: Array) -> Array:
        if self.readings is None:
            return y
        return jnp.where(jnp.isfinite(y), jnp.clip(y, *self.readings), y)

    @eqx.filter_jit
    def _judged(
        self,
        state: GuardedState,
        t: Array,
        late: Array,
        y: Array,
        seen: Array,
        found: Any,
    ) -> Any:
        """What has been seen up to every sample, and the estimates as they are given out."""
        value, status = found.value, found.status
        valid = status != Status.INVALID
        sound = (status == Status.OK) | (status == Status.FLAT)
        status, sound = jnp.where(late & sound, Status.EXTRAPOLATED, status), sound & ~late
        run_in = self.run_in or RunIn(jnp.inf, -jnp.inf, 0.0)
        bottom = state.bottom | _ever(valid & (value <= run_in.bottom))
        top = state.top | _ever(valid & (value >= run_in.top))
        first = jnp.where(valid.any(), t[jnp.argmax(valid)], jnp.nan)
        first = jnp.where(jnp.isnan(state.first), first, state.first)
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
