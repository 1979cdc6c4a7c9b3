"""A virtual skin of two liquid-metal channels, one over the other: Kim and Park (2018), and its presses.

The law is deliberately none of our models: stops inside a closing channel's curve, with creep. It is a
plausible generator, not an identification: the paper prints no curve's numbers.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from itertools import count
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from ._arguments import require
from ._channel_readout import CapacitiveReadout, ResistiveReadout

_require = partial(require, "MicrochannelRig")

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
    """V or pF"""


class ChannelRecord(NamedTuple):
    """A stream of readings and what was pressed meanwhile; it starts with the sensor at rest."""

    time: Float[np.ndarray, " samples"]
    """s"""
    force: Float[np.ndarray, "samples locations"]
    """N"""
    reading: Float[np.ndarray, "samples layers"]
    """V or pF"""


@dataclass(frozen=True, kw_only=True)
class MicrochannelRig:
    """Two stacked layers of five serial channel sections A to E, whose widths mirror each other.

    A force F_k on location k closes its sections; the layers' relative changes are

        u_k = F_k/(1 - F_k/F_c) (1 - a (1 - exp(-F_k/F_0)) Z_k),    Z_k = sum_i w_i s_ik/r_i
        v_k = (1 - sum_j g_j) u_k + sum_j g_j q_jk,                 tau_j dq_jk/dt + q_jk = u_k
        c_l = k sum_k S_lk p_lk v_k,                                reading = low-pass[scale c_l] + e

    - s_ik follows F_k as a stop of travel r_i does, |s_ik| <= r_i: unloading reads higher than loading.
    - p: placement. A machine presses the middle, p = 1. A finger does not: ln p = c + d in layer 1 and
      c - d in layer 2, normal and drawn anew for every press. e is normal, fresh in every sample.

    Every record starts from rest with a virgin sensor; the rig keeps no state. Step n ends at sample n:
    q and the low-pass see F constant over it.

    **Arguments:**

    - `seed`: of the specimen and of its readings.
    - `sensitivity`: S, (layers, locations). `sensitivity_per_n`: k, 1/N.
    - `closing_force_n`: F_c, at which a section is closed.
    - `friction`, `friction_onset_n`: a and F_0; `stop_travel_n`, `stop_share`: r and w, sum 1.
    - `creep`, `creep_s`: g and tau.
    - `placement_common`, `placement_differential`: standard deviations of c and d.
    - `fabrication`: standard deviation of ln S from specimen to specimen; 0: every one as designed.
    - `readout`: `ResistiveReadout` in V, or `CapacitiveReadout` in pF.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Kim and Park (2018), figs 1, 5 and 7 and tables I to III, which S, the placement and the
    noise were chosen to give; 6.5 to 14 % of hysteresis are read off fig 1.

    **Example:**

        >>> rig = hysteresis.rigs.MicrochannelRig(seed=11)
        >>> volts = rig.follow([[2.0, 0.0, 0.0, 0.0, 0.0]] * 50)
        >>> volts[-1].round(2).tolist()
        [0.97, 0.32]
    """

    seed: int = 0
    sensitivity: tuple[tuple[float, ...], ...] = (
        (3.0, 2.42, 2.0, 1.36, 1.0),
        (1.0, 1.60, 2.0, 2.58, 3.0),
    )
    sensitivity_per_n: float = 0.02
    closing_force_n: float = 41.8
    friction: float = 0.09
    friction_onset_n: float = 0.8
    stop_travel_n: tuple[float, ...] = (0.35, 0.9, 2.2)
    stop_share: tuple[float, ...] = (0.4, 0.35, 0.25)
    creep: tuple[float, ...] = (0.05, 0.04)
    creep_s: tuple[float, ...] = (0.4, 6.0)
    placement_common: float = 0.10
    placement_differential: float = 0.066
    fabrication: float = 0.0
    readout: ResistiveReadout | CapacitiveReadout = field(default_factory=ResistiveReadout)

    def __post_init__(self) -> None:
        at_zero = ("seed", "placement_common", "placement_differential", "fabrication", "friction")
        for f in fields(self):
            if f.name in ("sensitivity", "readout"):
                continue
            value = np.asarray(getattr(self, f.name))
            least = value >= 0 if f.name in at_zero else value > 0
            _require(
                bool(np.all(np.isfinite(value) & least)),
                f"{f.name} = {value} is out of range.",
                f"Give finite numbers {'of 0 or more' if f.name in at_zero else 'above 0'}.",
            )
        _require(
            len(set(map(len, self.sensitivity))) == 1 and bool(np.min(self.sensitivity) > 0),
            "sensitivity is no table of numbers above 0.",
            "Give one row for each layer, one column for each location.",
        )
        _require(
            len(self.stop_travel_n) == len(self.stop_share)
            and abs(sum(self.stop_share) - 1) < 1e-9
            and len(self.creep) == len(self.creep_s)
            and sum(self.creep) < 1
            and self.friction < 1,
            "stops or creep do not fit together.",
            "Stop shares add up to 1, creep to less; each has its travel or its time.",
        )

    @cached_property
    def gains(self) -> Float[np.ndarray, "layers locations"]:
        """k S of this specimen, 1/N: relative change of a layer for 1 N, before the channel closes."""
        S = self.sensitivity_per_n * np.array(self.sensitivity)
        return S * np.exp(self.fabrication * self._rng(0).normal(size=S.shape))

    def follow(
        self, force: ArrayLike, dt: float = 0.02, placement: ArrayLike = 1.0
    ) -> Float[np.ndarray, "*sequences samples layers"]:
        """Readings in V or pF, without noise.

        **Arguments:**

        - `force`: (..., samples, locations) in N, below F_c; the leading axes are histories of their own.
        - `dt`: s between samples.
        - `placement`: p, spread over (..., samples, layers, locations).

        **Raises:** `InputError` outside these ranges.
        """
        force = np.asarray(force, float)
        _require(
            force.ndim >= 2 and force.shape[-1] == self.gains.shape[1],
            f"force has the shape {force.shape}.",
            f"Give (samples, {self.gains.shape[1]}), one column for each location.",
        )
        pressed = self._closing(force, dt)[..., None, :]
        return self.readout.scale * np.sum(self.gains * np.asarray(placement) * pressed, axis=-1)

    def finger_presses(
        self, counts: int | Sequence[int] = FINGER_TRAINING, *, session: int = 0
    ) -> ChannelPresses:
        """Presses to 1.5 to 8 N within half a second, each on a sensor at rest, at one location.

        `counts`: at each location in turn, or one number for all. Presses of another session have
        other forces, placements and noise.
        """
        layers, locations = self.gains.shape
        each = [counts] * locations if isinstance(counts, int) else list(counts)
        _require(
            len(each) == locations and min(each) >= 0 and sum(each) > 0,
            f"counts = {counts}.",
            f"Give {locations} numbers of presses, one for each location.",
        )
        rng = self._rng(1, session)
        location = np.repeat(np.arange(locations), each)
        peak = rng.uniform(*_FINGER_FORCE, len(location))
        placed = self._placement(rng, len(location)) * self.gains[:, location].T
        pressed = self._closing(peak[:, None, None] * _RISE[:, None], 0.05)
        reading = self.readout.scale * placed * pressed[:, -1]
        reading += self.readout.noise * rng.normal(size=(len(location), layers))
        return ChannelPresses(location, peak, reading)

    def press_together(
        self, force: ArrayLike, *, session: int = 0
    ) -> Float[np.ndarray, "presses layers"]:
        """Readings of presses as `finger_presses`, to a force (presses, locations) in N on every location.

        Each contact is placed by itself; 0 N is none.
        """
        force = np.asarray(force, float)
        _require(
            force.ndim == 2 and force.shape[1] == self.gains.shape[1],
            f"force has the shape {force.shape}.",
            f"Give (presses, {self.gains.shape[1]}).",
        )
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
        return self._pressed({location: (force, 1.0)}, dt, rng)

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
            loops.append(self._pressed({location: (force, 1.0)}, dt, rng))
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
        _require(
            presses > 0 and samples >= 80 * presses,
            f"{presses} presses in {samples} samples.",
            "Give each press 80 samples or more.",
        )
        rng = self._rng(4, session)
        slot = samples // presses
        pressed = {}
        for location in locations:
            force, place = np.zeros(samples), np.ones((samples, self.gains.shape[0]))
            placements = self._placement(rng, presses)
            for n in range(presses):
                length = int(rng.integers(60, min(slot, 120)))
                begin = n * slot + int(rng.integers(0, slot - length))
                peak = rng.uniform(1.5, 7.0)
                press = slice(begin, begin + length)
                force[press] = peak * np.sin(np.pi * np.arange(1, length + 1) / (length + 1))
                place[n * slot : (n + 1) * slot] = placements[n] if finger else 1.0
            pressed[location] = force, place
        return self._pressed(pressed, dt, rng)

    def _rng(self, *purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, *purpose])

    def _placement(self, rng: np.random.Generator, presses: int) -> Float[np.ndarray, "presses l"]:
        """p of each press: layers by turns get c + d and c - d."""
        common = self.placement_common * rng.normal(size=(presses, 1))
        differential = self.placement_differential * rng.normal(size=(presses, 1))
        return np.exp(common + differential * (-1.0) ** np.arange(self.gains.shape[0]))

    def _pressed(
        self, presses: dict[int, tuple[np.ndarray, ArrayLike]], dt: float, rng: np.random.Generator
    ) -> ChannelRecord:
        """Read locations under (force (samples,), placement spread over (samples, layers))."""
        layers, locations = self.gains.shape
        samples = max(len(force) for force, _ in presses.values())
        force, place = np.zeros((samples, locations)), np.ones((samples, layers, locations))
        for location, (values, placement) in presses.items():
            _require(
                0 <= location < locations,
                f"location {location} is none of this sensor's.",
                f"Number them 0 to {locations - 1}.",
            )
            force[:, location], place[..., location] = values, placement
        reading = self.follow(force, dt, place)
        reading += self.readout.noise * rng.normal(size=reading.shape)
        return ChannelRecord(dt * np.arange(1, samples + 1), force, reading)

    def _closing(
        self, force: Float[np.ndarray, "*sequences samples locations"], dt: float
    ) -> Float[np.ndarray, "*sequences samples locations"]:
        """v behind the low-pass, in N: both are linear, and the order of linear stages is free."""
        _require(
            bool(np.all((force >= 0) & (force < self.closing_force_n))),
            "a force is not within 0 N and the closing force.",
            f"Stay below {self.closing_force_n:g} N; nothing pulls.",
        )
        _require(bool(np.isfinite(dt) and dt > 0), f"dt = {dt} s.", "Give seconds > 0.")
        F = np.moveaxis(force, -2, 0)
        dF = np.diff(F, axis=0, prepend=0.0)
        Z = np.zeros_like(F)
        for r, share in zip(self.stop_travel_n, self.stop_share, strict=True):
            s = np.zeros(F.shape[1:])
            for n in range(len(F)):
                s = np.minimum(np.maximum(s + dF[n], -r), r)
                Z[n] += share / r * s
        rub = self.friction * -np.expm1(-F / self.friction_onset_n) * Z
        u = F / (1 - F / self.closing_force_n) * (1 - rub)
        v = (1 - sum(self.creep)) * u
        for g, tau in zip(self.creep, self.creep_s, strict=True):
            v += g * _lag(u, dt, tau)
        return np.moveaxis(_lag(v, dt, self.readout.low_pass_s), 0, -2)


def _lag(u: np.ndarray, dt: float, tau: float) -> np.ndarray:
    """tau dq/dt + q = u from rest, u constant over each step; along the first axis."""
    kept, q, out = np.exp(-dt / tau), np.zeros(u.shape[1:]), np.empty_like(u)
    taken = -np.expm1(-dt / tau) * u
    for n in range(len(u)):
        q = kept * q + taken[n]
        out[n] = q
    return out


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
