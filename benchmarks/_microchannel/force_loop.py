"""A soft sensor read as it is pressed, and a machine that presses it: what a force loop controls."""

from dataclasses import dataclass
from functools import partial
from math import cos, exp, expm1, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from hysteresis.rigs import MicrochannelRig
from hysteresis.rigs._arguments import check_fields, require

_require = partial(require, "ForceLoopRig")


class ChannelStream:
    """One location of a `MicrochannelRig`, force by force: its law, one step after the other.

        step(F_n) = follow(F)_n + e_n

    Where several locations are pressed their readings add, but for the noise.

    **Arguments:**

    - `rig`: the sensor. `location`: which place is pressed. `dt`: s between forces.
    - `placement`: p of each layer; a machine's is 1.
    - `session`: of the noise; None for none.

    **Raises:** `InputError` for no such location, and times or a placement that are not positive.

    **Example:**

        >>> rig = hysteresis.rigs.MicrochannelRig(seed=11)
        >>> stream = ChannelStream(rig, location=0)
        >>> [round(volts, 3) for volts in stream.step(2.0)]
        [0.361, 0.12]
    """

    def __init__(
        self,
        rig: MicrochannelRig,
        *,
        location: int = 0,
        dt: float = 0.001,
        placement: tuple[float, ...] | None = None,
        session: int | None = None,
    ):
        layers, locations = rig.gains.shape
        placed = (1.0,) * layers if placement is None else placement
        _require(
            0 <= location < locations,
            f"location {location} is none of this sensor's.",
            f"Number them 0 to {locations - 1}.",
        )
        _require(bool(np.isfinite(dt) and dt > 0), f"dt = {dt} s.", "Give seconds > 0.")
        _require(
            len(placed) == layers and min(placed) > 0,
            f"placement = {placed}.",
            f"Give {layers} numbers above 0.",
        )
        self.dt = dt
        self._rig = rig
        gains = zip(rig.gains[:, location].tolist(), placed, strict=True)
        self._gains = tuple(rig.readout.scale * (gain * p) for gain, p in gains)
        self._stops = tuple(zip(rig.stop_travel_n, rig.stop_share, strict=True))
        creep = zip(rig.creep, rig.creep_s, strict=True)
        self._creep = tuple((g, exp(-dt / tau), -expm1(-dt / tau)) for g, tau in creep)
        self._direct = 1 - sum(rig.creep)
        tau = rig.readout.low_pass_s
        self._kept, self._taken = exp(-dt / tau), -expm1(-dt / tau)
        self._force, self._read = 0.0, 0.0
        self._stop, self._slow = [0.0] * len(self._stops), [0.0] * len(self._creep)
        noise = None if session is None else rig._rng(8, session)
        self._noise, self._waiting = noise, iter(())

    def step(self, force: float) -> tuple[float, ...]:
        """Readings of all layers in V under the next force, in N.

        **Raises:** `InputError` unless 0 <= F < F_c.
        """
        rig = self._rig
        if not 0 <= force < rig.closing_force_n:
            _require(
                False,
                f"{force} N is not within 0 N and the closing force.",
                f"Stay below {rig.closing_force_n:g} N; nothing pulls.",
            )
        moved, Z = force - self._force, 0.0
        for k, (r, share) in enumerate(self._stops):
            s = self._stop[k] + moved
            s = self._stop[k] = -r if s < -r else r if s > r else s
            Z += share / r * s
        self._force = force
        rub = rig.friction * -expm1(-force / rig.friction_onset_n) * Z
        u = force / (1 - force / rig.closing_force_n) * (1 - rub)
        v = self._direct * u
        for k, (g, kept, taken) in enumerate(self._creep):
            q = self._slow[k] = kept * self._slow[k] + taken * u
            v += g * q
        self._read = read = self._kept * self._read + self._taken * v
        if self._noise is None:
            return tuple(gain * read for gain in self._gains)
        return tuple(gain * read + self._next_noise() for gain in self._gains)

    def _next_noise(self) -> float:
        """Drawn a thousand at a time: one draw takes longer than the step."""
        assert self._noise is not None
        for e in self._waiting:
            return e
        self._waiting = iter((self._rig.readout.noise * self._noise.normal(size=1000)).tolist())
        return next(self._waiting)


class Pressed(NamedTuple):
    """What a step of the loop leaves: the true force in N, and what the sensor says."""

    force: float
    """N"""
    reading: tuple[float, ...]
    """V, of every layer"""


@dataclass(frozen=True, kw_only=True)
class ForceLoopRig:
    """A machine whose position is commanded presses one location of a soft sensor.

        x'' = w^2 (c - x) - 2 zeta w x',    w = 2 pi f
        d = max(0, x - a sin(2 pi f_o t + phase)),    F = k d (1 + d/d_0)

    - c: the command in mm, constant from step to step; x: where the machine is.
    - The pressed object sways by a; how stiff it and the sensor are, k, is known but to some per cent.

    **Arguments:**

    - `sensor`: what is pressed; its seed is also that of k and the phase. `location`.
    - `dt`: s between steps.
    - `bandwidth_hz`, `damping`: f and zeta of the machine.
    - `stiffness`: k as believed, N/mm; `stiffness_error`: standard deviation of ln k around it.
      `stiffening_mm`: d_0.
    - `sway_mm`, `sway_hz`: a and f_o. `highest_n`: where a stop keeps the force.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: the future work of Kim and Park (2018), who name no machine; the numbers are those of a
    small position-controlled linear drive.

    **Example:**

        >>> sensor = hysteresis.rigs.MicrochannelRig(seed=11)
        >>> loop = ForceLoopRig(sensor=sensor).start()
        >>> round(loop.step(1.0).force, 3)
        0.028
    """

    sensor: MicrochannelRig
    location: int = 0
    dt: float = 0.001
    bandwidth_hz: float = 30.0
    damping: float = 0.8
    stiffness: float = 2.0
    stiffness_error: float = 0.15
    stiffening_mm: float = 10.0
    sway_mm: float = 0.2
    sway_hz: float = 0.3
    highest_n: float = 12.0

    def __post_init__(self) -> None:
        at_zero = ("stiffness_error", "sway_mm")
        check_fields(self, at_zero, ("sensor", "location"), below={"damping": 1})
        _require(
            self.highest_n < self.sensor.closing_force_n,
            f"highest_n = {self.highest_n} closes the channel.",
            f"Stay below {self.sensor.closing_force_n:g} N.",
        )

    def start(self, session: int = 0) -> "ForceLoop":
        """The machine at rest at 0 mm and the sensor virgin; another session has other noise."""
        return ForceLoop(self, session)


class ForceLoop:
    """A run of a `ForceLoopRig`: command by command."""

    def __init__(self, rig: ForceLoopRig, session: int):
        self._rig = rig
        self._sensor = ChannelStream(rig.sensor, location=rig.location, dt=rig.dt, session=session)
        random = rig.sensor._rng(9, session)
        # The object is the specimen's own, how it happens to sway is not.
        true = rig.sensor._rng(9).normal()
        self._stiffness = rig.stiffness * exp(rig.stiffness_error * true)
        self._phase = float(random.uniform(0, 2 * pi))
        self._origin = sin(self._phase)
        w = 2 * pi * rig.bandwidth_hz
        slow, fast = rig.damping * w, w * sqrt(1 - rig.damping**2)
        decay, c, s = exp(-slow * rig.dt), cos(fast * rig.dt), sin(fast * rig.dt)
        # Deviation from the command and velocity a step later.
        self._on = (
            decay * (c + slow / fast * s), decay * s / fast,
            -decay * w * w / fast * s, decay * (c - slow / fast * s),
        )  # fmt: skip
        self._x, self._v, self._t = 0.0, 0.0, 0.0

    def step(self, command: float) -> Pressed:
        """`command`: mm. What is felt and read at the end of the step."""
        rig = self._rig
        a, b, c, d = self._on
        off = self._x - command
        self._x, self._v = command + a * off + b * self._v, c * off + d * self._v
        self._t += rig.dt
        swayed = sin(2 * pi * rig.sway_hz * self._t + self._phase) - self._origin
        depth = self._x - rig.sway_mm * swayed
        force = 0.0 if depth < 0 else self._stiffness * depth * (1 + depth / rig.stiffening_mm)
        force = min(force, rig.highest_n)
        return Pressed(force, self._sensor.step(force))
