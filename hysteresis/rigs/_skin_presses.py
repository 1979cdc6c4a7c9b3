"""How a virtual skin of stacked channels is pressed and read: by a machine, a finger, several at once."""

import abc
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import count
from typing import Final, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from ._arguments import check_fields, require

Forces = Float[np.ndarray, "*sequences samples locations"]
Readings = Float[np.ndarray, "*sequences samples layers"]
Placed = Float[np.ndarray, "*placed"]
"""In N; in V or as relative changes; where a press is on its location."""


@dataclass(frozen=True, kw_only=True)
class ResistiveReadout:
    """A current source through each channel, an amplifier, a passive low-pass, a converter.

        reading = gain I R_0 (R - R_0)/R_0 in V,    V_0 = I R_0 = 0.435 V

    The amplifier's reference takes V_0 away, so that a sensor at rest reads zero.

    **Arguments:** (the range's low end below its high end, noise 0 or more, all others above 0)

    - `resistance_ohm`, `current_a`: R_0 and I; the paper's source gives 0.070 to 0.080 A.
    - `gain`: of the amplifier, which the paper does not print.
    - `low_pass_s`: time constant of the low-pass.
    - `noise`: standard deviation of a reading in V, behind the low-pass.
    - `low`, `high`: V, the ends of the converter's range, after a divider: every section at 8 N
      together makes 17 V. `bits`: of the converter, 10 as in the paper's microcontroller.

    Source: Kim and Park (2018), section II.

    **Example:**

        >>> readout = hysteresis.internal.ResistiveReadout()
        >>> readout.counts(np.array([0.0, 1.0, 50.0])).tolist()
        [25, 75, 1023]
    """

    resistance_ohm: float = 5.8
    current_a: float = 0.075
    gain: float = 20.0
    low_pass_s: float = 0.002
    noise: float = 0.02
    low: float = -0.5
    high: float = 20.0
    bits: int = 10

    def __post_init__(self) -> None:
        check_fields(self, ("noise",), ("low", "high"))
        require(
            type(self).__name__,
            bool(np.isfinite([self.low, self.high]).all()) and self.low < self.high,
            f"low = {self.low}, high = {self.high}.",
            "Give finite numbers, low below high.",
        )

    @property
    def scale(self) -> float:
        """V of reading for a relative change of 1: the amplified V_0."""
        return self.gain * self.current_a * self.resistance_ohm

    def counts(self, reading: Float[np.ndarray, "*shape"]) -> Int[np.ndarray, "*shape"]:
        """Of the converter, 0 to 2^bits - 1, where it also stays beyond its range."""
        last = 2**self.bits - 1
        part = (reading - self.low) / (self.high - self.low)
        return np.clip(np.rint(part * last), 0, last).astype(int)


_require = partial(require, "skin")

FINGER_TRAINING: Final = (318, 230, 420, 200, 424)
"""Presses of A to E: unequal, and 1,592 together as in the paper."""

MACHINE_FORCE: Final = 7.8
"""N: the paper's first mean squared error is that of even forces from 0 to here."""

_RISE = np.sin(np.linspace(0, np.pi / 2, 12))  # of a finger's press, in steps of 0.05 s
_FINGER_FORCE = (1.5, 8.0)  # N
_RATES = (2.0, 20.0)  # N/s of the machine


class ChannelPresses(NamedTuple):
    """Presses by a finger, each read once at its peak."""

    location: Int[np.ndarray, " presses"]
    """0 (A) to 4 (E)"""
    force: Float[np.ndarray, " presses"]
    """N, at the peak"""
    reading: Float[np.ndarray, "presses layers"]
    """V"""


class ChannelRecord(NamedTuple):
    """A stream of readings and what was pressed meanwhile; it starts with the sensor at rest."""

    time: Float[np.ndarray, " samples"]
    """s"""
    force: Float[np.ndarray, "samples locations"]
    """N"""
    reading: Float[np.ndarray, "samples layers"]
    """V"""


@dataclass(frozen=True, kw_only=True)
class AbstractSkinRig(abc.ABC):
    """Two stacked layers of five serial channel sections A to E, and what presses them.

    A subclass says how a press changes the resistance of the layers (`_changes`), and how a finger misses
    the middle of a location (`_placement`). `MicrochannelRig` says what its fields are.
    """

    seed: int = 0
    sensitivity: tuple[tuple[float, ...], ...] = (
        (3.0, 2.42, 2.0, 1.36, 1.0),
        (1.0, 1.60, 2.0, 2.58, 3.0),
    )
    sensitivity_per_n: float = 0.02
    fabrication: float = 0.0
    readout: ResistiveReadout = field(default_factory=ResistiveReadout)

    def __post_init__(self) -> None:
        check_fields(self, self._at_zero(), ("sensitivity", "readout"))
        _require(
            len(set(map(len, self.sensitivity))) == 1 and bool(np.min(self.sensitivity) > 0),
            "sensitivity is no table of numbers above 0.",
            "Give one row for each layer, one column for each location.",
        )

    def _at_zero(self) -> tuple[str, ...]:
        """Fields that may be 0."""
        return ("seed", "fabrication")

    @cached_property
    def gains(self) -> Float[np.ndarray, "layers locations"]:
        """k S of this specimen, 1/N: relative change of a layer for 1 N, before the channel closes."""
        S = self.sensitivity_per_n * np.array(self.sensitivity)
        return S * np.exp(self.fabrication * self._rng(0).normal(size=S.shape))

    @property
    @abc.abstractmethod
    def _middle(self) -> Float[np.ndarray, " placed"]:
        """The placement of a press in the middle of its location."""

    @abc.abstractmethod
    def _placement(self, rng: np.random.Generator, presses: int) -> Float[np.ndarray, "presses p"]:
        """The placement of each press by a finger."""

    @abc.abstractmethod
    def _changes(self, force: Forces, dt: float, placement: Placed) -> Readings:
        """c: the relative change of each layer, behind the low-pass."""

    def follow(
        self, force: ArrayLike, dt: float = 0.02, placement: ArrayLike | None = None
    ) -> Readings:
        """Readings in V, without noise.

        **Arguments:**

        - `force`: (..., samples, locations) in N; the leading axes are histories of their own.
        - `dt`: s between samples.
        - `placement`: spread over (..., samples, parts of a placement, locations); the middle unless
          given.

        **Raises:** `InputError` outside these ranges.
        """
        force = np.asarray(force, float)
        said = f"force has the shape {force.shape}."
        mend = f"Give (samples, {self.gains.shape[1]}), one column for each location."
        _require(force.ndim >= 2 and force.shape[-1] == self.gains.shape[1], said, mend)
        _require(
            bool(np.all(np.isfinite(force) & (force >= 0))) and bool(np.isfinite(dt) and dt > 0),
            f"a force is not 0 N or more, or dt = {dt} s.",
            "Give forces that push, and seconds > 0.",
        )
        placed = self._middle[:, None] if placement is None else np.asarray(placement, float)
        return self.readout.scale * self._changes(force, dt, placed)

    def finger_presses(
        self, counts: int | Sequence[int] = FINGER_TRAINING, *, session: int = 0
    ) -> ChannelPresses:
        """Presses to 1.5 to 8 N within half a second, each on a sensor at rest, at one location.

        `counts`: at each location in turn, or one number for all. Presses of another session have
        other forces, placements and noise.
        """
        layers, locations = self.gains.shape
        each = [counts] * locations if isinstance(counts, int) else list(counts)
        said = f"counts = {counts}."
        mend = f"Give {locations} numbers of presses, one for each location."
        _require(len(each) == locations and min(each) >= 0 and sum(each) > 0, said, mend)
        rng = self._rng(1, session)
        location = np.repeat(np.arange(locations), each)
        peak = rng.uniform(*_FINGER_FORCE, len(location))
        force = peak[:, None] * (location[:, None] == np.arange(locations))
        placed = self._placement(rng, len(location))[:, None, :, None]
        reading = self.follow(force[:, None] * _RISE[:, None], 0.05, placed)[:, -1]
        reading += self.readout.noise * rng.normal(size=(len(location), layers))
        return ChannelPresses(location, peak, reading)

    def press_together(
        self, force: ArrayLike, *, session: int = 0
    ) -> Float[np.ndarray, "presses layers"]:
        """Readings of presses as `finger_presses`, to a force (presses, locations) in N on every location.

        Each contact is placed by itself; 0 N is none.
        """
        force = np.asarray(force, float)
        said = f"force has the shape {force.shape}."
        mend = f"Give (presses, {self.gains.shape[1]})."
        _require(force.ndim == 2 and force.shape[1] == self.gains.shape[1], said, mend)
        rng = self._rng(5, session)
        placed = self._placement(rng, force.size).reshape(*force.shape, -1).swapaxes(1, 2)
        reading = self.follow(force[:, None] * _RISE[:, None], 0.05, placed[:, None])[:, -1]
        return reading + self.readout.noise * rng.normal(size=reading.shape)

    def cnc_loops(
        self, samples: int = 56_708, *, location: int = 0, dt: float = 0.02, session: int = 0
    ) -> ChannelRecord:
        """A machine presses one location, to random forces of 0 to 7.8 N at random rates of 2 to 20 N/s.

        It turns in the lower and in the upper two thirds alternately, and at every eighth turn at 0 N:
        loops inside loops.
        """
        rng = self._rng(2, session)
        third = MACHINE_FORCE / 3
        turns = (third * (rng.uniform(0, 2) + n % 2) if n % 8 else 0.0 for n in count(1))
        force = _ramps(turns, dt, rng, samples)
        return self._pressed({location: (force, self._middle)}, dt, rng)

    def test_loops(
        self, *, location: int = 0, dt: float = 0.02, session: int = 0
    ) -> tuple[ChannelRecord, ...]:
        """Four loops from 0 N to a random peak, by way of a smaller loop, and back, as `cnc_loops`."""
        loops = []
        for n in range(4):
            rng = self._rng(3, session, n)
            peak = rng.uniform(0.6, 1.0) * MACHINE_FORCE
            inside = sorted(rng.uniform(0.2, 0.9, 2) * peak)
            turns = (inside[1], inside[0], peak, 0.0)
            force = _ramps(turns, dt, rng)
            loops.append(self._pressed({location: (force, self._middle)}, dt, rng))
        return tuple(loops)

    def simultaneous(
        self,
        samples: int = 1452,
        *,
        locations: Sequence[int] = (1, 3),
        presses: int = 8,
        dt: float = 0.05,
        finger: bool = True,
        session: int = 0,
    ) -> ChannelRecord:
        """Fingers press several locations at random times, each `presses` times to 1.5 to 7 N.

        A press rises and falls as half a sine does, by at most 0.4 N a sample, and differs in length,
        force and placement; with `finger` = False it is centred as a machine's is.
        """
        said = f"{presses} presses in {samples} samples."
        mend = "Give each press 80 samples or more."
        _require(presses > 0 and samples >= 80 * presses, said, mend)
        rng = self._rng(4, session)
        slot = samples // presses
        pressed = {}
        for location in locations:
            force, place = np.zeros(samples), np.tile(self._middle, (samples, 1))
            placements = self._placement(rng, presses)
            for n in range(presses):
                length = int(rng.integers(60, min(slot, 120)))
                begin = n * slot + int(rng.integers(0, slot - length))
                peak = rng.uniform(1.5, 7.0)
                press = slice(begin, begin + length)
                force[press] = peak * np.sin(np.pi * np.arange(1, length + 1) / (length + 1))
                place[n * slot : (n + 1) * slot] = placements[n] if finger else self._middle
            pressed[location] = force, place
        return self._pressed(pressed, dt, rng)

    def _rng(self, *purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, *purpose])

    def _pressed(
        self, presses: dict[int, tuple[np.ndarray, ArrayLike]], dt: float, rng: np.random.Generator
    ) -> ChannelRecord:
        """Read locations under (force (samples,), placement spread over (samples, layers))."""
        locations = self.gains.shape[1]
        samples = max(len(force) for force, _ in presses.values())
        force = np.zeros((samples, locations))
        place = np.tile(self._middle[:, None], (samples, 1, locations))
        for location, (values, placement) in presses.items():
            said = f"location {location} is none of this sensor's."
            _require(0 <= location < locations, said, f"Number them 0 to {locations - 1}.")
            force[:, location], place[..., location] = values, placement
        reading = self.follow(force, dt, place)
        reading += self.readout.noise * rng.normal(size=reading.shape)
        return ChannelRecord(dt * np.arange(1, samples + 1), force, reading)


def lag(u: np.ndarray, dt: float, tau: float) -> np.ndarray:
    """tau dq/dt + q = u from rest, u constant over each step; along the first axis."""
    return scipy.signal.lfilter([-np.expm1(-dt / tau)], [1.0, -np.exp(-dt / tau)], u, axis=0)


def _ramps(
    turns: Iterable[float], dt: float, rng: np.random.Generator, samples: int | None = None
) -> Float[np.ndarray, " samples"]:
    """From 0 N straight from turn to turn, each at a rate drawn evenly in its logarithm.

    As many `samples` as asked for, else up to the last turn.
    """
    times, forces = [0.0], [0.0]
    for force in turns:
        rate = np.exp(rng.uniform(*np.log(_RATES)))
        times.append(times[-1] + abs(force - forces[-1]) / rate)
        forces.append(force)
        if samples is not None and times[-1] >= samples * dt:
            break
    if samples is None:
        samples = int(np.ceil(times[-1] / dt))
    return np.interp(dt * np.arange(1, samples + 1), times, forces)
