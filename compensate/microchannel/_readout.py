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


# Blind estimate of the gains of two layers from readings in use, without known places or forces.

PEAK, ANGLES = 0.05, 400
"""Part of the highest pile that counts as one; directions that are tried."""

LEAST = 100
"""Readings of pressed places."""


def gains_in_use(
    readings: ArrayLike, known: ArrayLike, *, pressed: float = 0.5, blur: float = 0.03
) -> Float[np.ndarray, "2 2"]:
    """Gains G of two places in two layers, from readings z = G s of both, with the places' signals s >= 0.

        direction of G_k: one of the outermost two directions of z in which readings accumulate

    A contact pushes and never pulls, so a reading of both places lies between their directions, and on one
    of them where that place is pressed alone. Independent component analysis needs independent signals;
    this method only needs each place to be pressed alone now and then.

    The readings do not tell which direction belongs to which place, nor how large the signal of 1 N is:
    order and lengths of the columns are those of `known`, such as the gains of another sensor of this kind.

    **Arguments:**

    - `readings`: z, (samples, 2) in V, zero at rest.
    - `known`: (layers, places), V per unit of signal.

    **Other arguments:**

    - `pressed`: readings shorter than this, in V, are ignored: use some ten times the noise.
    - `blur`: by how much directions are smoothed, 0.005 to 0.2 rad. A finger, which is placed anew for
      every press, needs more than a machine; places whose directions are close allow less.

    **Returns:** G, (layers, places).

    **Raises:** `InputError` for other shapes and numbers out of range, too few readings, and places that
    are never pressed alone.

    **Source:** the mixture to which Kim and Park (2018) would apply independent component analysis. This
    method uses only that signals are not negative, so that mixtures lie between single presses.

    **Example:**

        >>> one, none = np.linspace(0.0, 3.0, 100), np.zeros(100)
        >>> signals = np.column_stack([np.r_[one, none], np.r_[none, one]])
        >>> readings = signals @ np.array([[1.1, 0.5], [0.4, 1.1]]).T
        >>> compensate.internal.gains_in_use(readings, [[1.0, 0.6], [0.5, 1.0]]).round(2).tolist()
        [[1.05, 0.48], [0.38, 1.06]]
    """
    z, given = np.asarray(readings, float), np.asarray(known, float)
    if z.ndim != 2 or z.shape[1] != 2 or given.shape != (2, 2):
        raise InputError(
            "wrong-channels", f"readings of shape {z.shape} and gains of shape {given.shape}.",
            fix="give (samples, 2) and (2, 2): two layers, two places.",
        )  # fmt: skip
    if not (np.isfinite(given).all() and (given > 0).all()):
        raise InputError(
            "parameter-out-of-bounds",
            "known gains have to be above 0: a press makes every layer read more.",
        )
    if not (0 < pressed < np.inf and 0.005 <= blur <= 0.2):
        raise InputError(
            "bad-option", f"pressed = {pressed:g} V, blur = {blur:g} rad.",
            fix="give volts above 0, and 0.005 to 0.2 rad.",
        )  # fmt: skip
    z = z[np.isfinite(z).all(1)]
    strength = np.hypot(*z.T)
    used = strength > pressed
    if used.sum() < LEAST:
        raise InputError(
            "too-few-rows", f"{used.sum()} readings are above {pressed:g} V.",
            fix=f"give {LEAST} or more while the places are pressed, or a lower `pressed`.",
        )  # fmt: skip
    peaks = _piles(np.arctan2(z[used, 1], z[used, 0]), strength[used], blur)
    lengths, angles = np.hypot(*given), np.arctan2(given[1], given[0])
    if peaks[-1] - peaks[0] < np.ptp(angles) / 2:
        raise InputError(
            "no-excitation",
            f"the readings point {np.degrees(peaks[-1] - peaks[0]):.0f} degrees apart at most, the known "
            f"gains {np.degrees(np.ptp(angles)):.0f}.",
            cause="both places are always pressed together, or only one is pressed at all.",
            fix="press each place alone a few times.",
        )
    ends = peaks[[0, -1]][np.argsort(np.argsort(angles))]
    return lengths * np.array([np.cos(ends), np.sin(ends)])


def _piles(
    angle: Float[np.ndarray, " readings"], strength: Float[np.ndarray, " readings"], blur: float
) -> Float[np.ndarray, " piles"]:
    """Directions in which readings cluster, in rad from the first layer's axis, in ascending order."""
    # Blurred in bins, so that the work does not grow with bins times readings.
    edges = np.linspace(-np.pi / 4, 3 * np.pi / 4, 2 * ANGLES + 1)
    pile, _ = np.histogram(angle, edges, weights=strength)
    centre = (edges[1:] + edges[:-1]) / 2
    bin_width = edges[1] - edges[0]
    reach = int(4 * blur / bin_width)
    away = bin_width * np.arange(-reach, reach + 1)
    pile = np.convolve(pile, np.exp(-0.5 * (away / blur) ** 2), mode="same")
    inner = pile[1:-1]
    top = (inner > pile[:-2]) & (inner >= pile[2:]) & (inner > PEAK * pile.max())
    return centre[1:-1][top] if top.any() else centre[[int(pile.argmax())]]
