"""From converter counts to the relative change of each channel of a soft sensor."""

from enum import IntEnum
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar, parameter, register
from hysteresis._parameter import as_float, is_concrete

from .._contract import AbstractStreamed, scanned

Values = Float[Array, "..."] | Any
"""Numbers, kept as an array."""


class ChannelStatus(IntEnum):
    """What a sample of a channel is worth. Only the first is to be used without a thought."""

    OK = 0
    GAP = 1
    """More time than `longest_gap` since the last sample, or time went backwards: memory is in doubt."""
    STUCK = 2
    """The same reading again and again, where noise alone would change it."""
    SATURATED = 3
    """At an end of the converter's range: the change is at least this."""
    MISSING = 4
    """The reading or its time was NaN or infinite: the last change is held, the state untouched."""


class Changes(NamedTuple):
    """Relative changes (..., channels), and a `ChannelStatus` for each."""

    value: Float[Array, "*samples channels"]
    status: Int[Array, "*samples channels"]


class ReadoutState(NamedTuple):
    """Each channel's change behind the low-pass, reading and time of its last sound sample (NaN before
    the first), and how many times that reading has come again."""

    held: Array
    reading: Array
    time: Array
    repeats: Array


@register
class Readout(AbstractStreamed[ReadoutState, Changes]):
    """The electronics behind a soft channel, run backwards:

        c = (reading - zero)/(gain I R_0) = (R - R_0)/R_0,    V_0 = I R_0
        reading = low + (high - low) counts/(2^bits - 1) in V, if counts are given

    and c behind a low-pass, y <- y + (1 - exp(-dt/tau)) (c - y), if there is one. With a capacitive sensor
    take `scale` = C_0 and readings in its unit: the change is (C - C_0)/C_0.

    **Arguments:** (one value for all channels or one for each; `None` and 0 leave a check or stage out)

    - `channels`: how many. `scale`: reading for a change of 1; gain I R_0 unless given.
    - `zero`: the reading at rest, V; see `at_rest`.
    - `resistance`, ohm, `current`, A, `gain`: R_0, I and the amplifier's.

    **Other arguments:**

    - `low`, `high`: ends of the converter's range, V. `bits`: of the counts; None: volts are given.
    - `time_constant`, s: tau of the low-pass.
    - `longest_gap`, s: beyond it a sample is told GAP, and the low-pass starts anew.
    - `stuck_after`: so many equal readings in a row are told STUCK. Right where the noise is near a
      count or above: equal neighbours have a chance of 0.28 at a deviation of one count.

    Raises `InputError` for numbers out of range.

    Source: Kim and Park (2018), section II and fig 2.

    **Example:**

        >>> readout = compensate.internal.Readout(channels=2)
        >>> readout.channels
        2
    """

    scale: Values = parameter(meaning="reading for a relative change of 1")
    zero: Values = parameter(meaning="reading at rest")
    low: Scalar = parameter(fixed=True, meaning="low end of the converter's range")
    high: Scalar = parameter(fixed=True, meaning="high end of the converter's range")
    time_constant: Scalar = parameter(unit="s", fixed=True, meaning="of the low-pass")
    longest_gap: Scalar = parameter(unit="s", fixed=True, meaning="from sample to sample")
    bits: int | None = eqx.field(default=None, static=True)
    stuck_after: int = eqx.field(default=0, static=True)
    along = 0

    def __init__(
        self,
        channels: int = 2,
        *,
        scale: ArrayLike | None = None,
        zero: ArrayLike = 0.0,
        resistance: ArrayLike = 5.8,
        current: ArrayLike = 0.075,
        gain: ArrayLike = 20.0,
        low: ArrayLike = float("-inf"),
        high: ArrayLike = float("inf"),
        bits: int | None = None,
        time_constant: ArrayLike = 0.0,
        longest_gap: ArrayLike = float("inf"),
        stuck_after: int = 0,
    ):
        if scale is None:
            scale = np.asarray(gain) * np.asarray(current) * np.asarray(resistance, float)
        self.scale, self.zero = (
            jnp.full(channels, v) if v.ndim == 0 else v for v in map(as_float, (scale, zero))
        )
        self.low, self.high, self.bits = as_float(low), as_float(high), bits
        self.time_constant, self.longest_gap = as_float(time_constant), as_float(longest_gap)
        self.stuck_after = stuck_after

    def __check_init__(self) -> None:
        if jnp.ndim(self.scale) != 1 or jnp.shape(self.scale) != jnp.shape(self.zero):
            raise _fault("scale and zero differ in their channels.", "give one value for each.")
        if self.bits is not None and not (1 <= self.bits <= 32):
            raise _fault(f"counts of {self.bits} bits.", "1 to 32.")
        if self.stuck_after < 0 or self.stuck_after == 1:
            raise _fault(f"stuck_after = {self.stuck_after}.", "2 or more, 0 not to look for it.")
        numbers = (self.scale, self.zero, self.low, self.high, self.time_constant, self.longest_gap)
        if not all(map(is_concrete, numbers)):
            return
        if not (np.all(np.isfinite(self.zero)) and np.all(np.isfinite(self.scale))):
            raise _fault("scale or zero is not finite.", "take zero from `at_rest`.")
        if np.any(np.asarray(self.scale) == 0):
            raise _fault("a scale is 0: no change can show.", "gain I R_0, or C_0.")
        if not self.low < self.high:
            raise _fault(f"a range from {self.low} to {self.high}.", "low below high.")
        if self.bits is not None and not np.isfinite(self.high - self.low):
            raise _fault("counts without the converter's range.", "give low and high.")
        if not (self.time_constant >= 0 and self.longest_gap > 0):
            raise _fault("a time is out of range.", "time_constant >= 0 s, longest_gap > 0 s.")

    @property
    def channels(self) -> int:
        """How many."""
        return self.scale.shape[0]

    def at_rest(self, readings: ArrayLike) -> "Readout":
        """This readout with `zero` the median of readings (samples, channels) without load.

        Raises `InputError` where a channel has no finite reading.
        """
        volts = np.array(self._volts(readings))
        volts[~np.isfinite(volts)] = np.nan
        dead = np.flatnonzero(np.isnan(volts).all(axis=0))
        if dead.size:
            raise InputError(
                "wrong-channels", f"channel {dead[0] + 1} has no reading at rest.",
                cause="a broken wire, or a column that is not the channel's.",
                fix="mend it, or leave the channel out.",
            )  # fmt: skip
        zero = jnp.asarray(np.nanmedian(volts, axis=0), self.scale.dtype)
        return eqx.tree_at(lambda r: r.zero, self, zero)

    def init(self) -> ReadoutState:
        """The state before the first sample."""
        none = jnp.full(self.channels, jnp.nan, self.scale.dtype)
        return ReadoutState(none, none, none, jnp.zeros(self.channels, int))

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: ReadoutState
    ) -> tuple[ReadoutState, Changes]:
        """Samples (samples, channels) at the times `t` (samples,), s; channels do not affect each other."""
        volts = self._volts(y)
        t = jnp.asarray(t, volts.dtype)
        if volts.ndim != 2 or t.shape != volts.shape[:1]:
            raise _fault(
                f"{t.shape} times and {volts.shape} readings.",
                "give (samples,) and (samples, channels).",
            )
        return scanned(self, t, jnp.asarray(y, float), state)

    def take(
        self, state: ReadoutState, t: ArrayLike | None, readings: ArrayLike
    ) -> tuple[ReadoutState, Changes]:
        readings, volts = jnp.asarray(readings, self.scale.dtype), self._volts(readings)
        t = jnp.broadcast_to(jnp.asarray(t, volts.dtype), volts.shape)
        sound = jnp.isfinite(volts) & jnp.isfinite(t)
        first = jnp.isnan(state.time)
        dt = jnp.where(first, 0, t - state.time)
        gap = (dt < 0) | (dt > self.longest_gap)
        slow = (self.time_constant > 0) & ~first & ~gap
        part = -jnp.expm1(-dt / jnp.where(slow, self.time_constant, 1))
        change = (volts - self.zero) / self.scale
        now = jnp.where(slow, state.held + part * (change - state.held), change)
        repeats = jnp.where(readings == state.reading, state.repeats + 1, 0)
        stuck = (repeats >= self.stuck_after - 1) & (self.stuck_after > 0)
        # Half a count inside: the ends' own voltages are rounded.
        inside = 0.0 if self.bits is None else (self.high - self.low) / (2**self.bits - 1) / 2
        ended = (volts <= self.low + inside) | (volts >= self.high - inside)
        ok, *codes = map(int, ChannelStatus)
        status = jnp.select([~sound, ended, stuck, gap], codes[::-1], ok)
        new = ReadoutState(now, readings, t, repeats)
        after = jax.tree.map(lambda new, old: jnp.where(sound, new, old), new, state)
        return after, Changes(jnp.where(jnp.isnan(after.held), 0, after.held), status)

    def _volts(self, readings: Any) -> Array:
        readings = jnp.asarray(readings, self.scale.dtype)
        if readings.shape[-1:] != (self.channels,):
            raise InputError(
                "wrong-channels", f"readings of shape {readings.shape} for {self.channels} channels.",
                fix="give (..., channels); NaN for a channel that has failed.",
            )  # fmt: skip
        if self.bits is None:
            return readings
        return self.low + (self.high - self.low) * (readings / (2**self.bits - 1))


def _fault(problem: str, fix: str) -> InputError:
    return InputError("bad-option", problem, place="Readout", fix=fix)
