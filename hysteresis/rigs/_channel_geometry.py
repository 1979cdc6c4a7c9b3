"""A virtual skin by its geometry: where a finger presses, how far its footprint reaches, what closes."""

from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float

from ._arguments import require
from ._skin_presses import AbstractSkinRig, Forces, Placed, Readings, lag

_require = partial(require, "ChannelGeometryRig")

_POINTS: Final = 9  # along one section


@dataclass(frozen=True, kw_only=True)
class ChannelGeometryRig(AbstractSkinRig):
    """Two layers of channels in rubber, closed point by point below the footprint of a round finger.

    A finger at the place X presses on a disc of the radius r with the pressure of Hertz, and every point
    s of a channel closes by the pressure there:

        r_H = (3 F R/(4 E))^(1/3),    P = 3 F/(2 pi r^2),    P_s = P sqrt(1 - ((s - X)^2 + Y^2)/r^2)
        c_l = k sum_s S_ls (P_s + q_s)/(1 - (P_s + q_s)/P_c)

    - The rim sticks: as the force falls, r goes to r_H only gradually, dr = (r_H - r) |dF|/l.
    - The rubber yields by a law of Eyring: dq/dt = (g P - q)/T exp(|g P - q|/Q), q_s as P_s.
    - A finger misses the middle of a location by X along the channel and Y across it. It then reaches
      the neighbouring sections too, which belong to other locations.

    What a press does is thus no product of a place and a force, and the law has no stops and no linear
    creep. Specimens differ in every section and in the depth of the layers.

    **Arguments:** (all above 0, the misses 0 or more)

    - those of a skin: `seed`, `sensitivity`, `sensitivity_per_n`, `fabrication`, `readout`.
    - `pitch_mm`: from location to location; a section covers nine tenths of it.
    - `finger_mm`, `modulus_kpa`: R and E. `closing_kpa`: P_c.
    - `rim_n`: l. `flow`, `flow_s`, `flow_kpa`: g, T and Q.
    - `miss_along_mm`, `miss_across_mm`: standard deviations of X and Y.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Johnson, Contact Mechanics (1985), sections 3.4 and 5.5; Kim and Park (2018), figs 1, 5 and 7.

    **Example:**

        >>> rig = hysteresis.internal.ChannelGeometryRig(seed=11)
        >>> volts = rig.follow([[2.0, 0.0, 0.0, 0.0, 0.0]] * 50)
        >>> volts[-1].round(1).tolist()
        [1.8, 0.6]
    """

    fabrication: float = 0.05
    pitch_mm: float = 10.0
    finger_mm: float = 8.0
    modulus_kpa: float = 150.0
    closing_kpa: float = 150.0
    rim_n: float = 0.4
    flow: float = 0.35
    flow_s: float = 2.0
    flow_kpa: float = 8.0
    miss_along_mm: float = 2.7
    miss_across_mm: float = 0.8

    def _at_zero(self) -> tuple[str, ...]:
        return (*super()._at_zero(), "miss_along_mm", "miss_across_mm")

    @property
    def _middle(self) -> Float[np.ndarray, " placed"]:
        """X and Y in mm of a press in the middle of its location."""
        return np.zeros(2)

    def _placement(self, rng: np.random.Generator, presses: int) -> Float[np.ndarray, "presses 2"]:
        """X and Y of each press by a finger."""
        return rng.normal(size=(presses, 2)) * [self.miss_along_mm, self.miss_across_mm]

    def _changes(self, force: Forces, dt: float, placement: Placed) -> Readings:
        """c: the relative change of each layer, behind the low-pass."""
        locations = force.shape[-1]
        place = np.broadcast_to(placement, (*force.shape[:-1], 2, locations))
        middle = self.pitch_mm * np.arange(locations)
        points = middle[:, None] + self._along
        radius, pressure, flow = self._footprint(force, dt)
        total = np.zeros((*force.shape[:-1], locations, _POINTS))
        for k in np.flatnonzero(force.reshape(-1, locations).any(axis=0)):
            along, across = place[..., 0, k, None, None], place[..., 1, k, None, None]
            r = np.maximum(radius[..., k, None, None], 1e-9)
            away = ((points - middle[k] - along) ** 2 + across**2) / r**2
            below = (pressure + flow)[..., k, None, None]
            total += below * np.sqrt(np.maximum(1 - away, 0))
        part = total / self.closing_kpa
        shut = part.max(initial=0) >= 0.95
        _require(not shut, "a channel is squeezed shut.", "Press with less force.")
        # In N: what 1 N in the middle does to a section, before the channel closes.
        closed = np.mean(part / (1 - part), axis=-1) / self._per_newton
        c = np.moveaxis(closed @ self.gains.T, -2, 0)
        return np.moveaxis(lag(c, dt, self.readout.low_pass_s), 0, -2)

    @property
    def _per_newton(self) -> float:
        """Mean closing of a section that 4 N press in its middle, for 1 N."""
        r, pressure = self._hertz(np.array([4.0]))
        part = pressure * np.sqrt(np.maximum(1 - (self._along / r) ** 2, 0)) / self.closing_kpa
        return float(np.mean(part / (1 - part))) / 4

    @property
    def _along(self) -> np.ndarray:
        """Places in mm along a section, from its middle."""
        return self.pitch_mm * 0.9 * ((np.arange(_POINTS) + 0.5) / _POINTS - 0.5)

    def _hertz(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radius of the footprint in mm and pressure in its middle in kPa."""
        r = np.cbrt(3e3 * force * self.finger_mm / (4 * self.modulus_kpa))
        return r, np.where(r > 0, 1.5e3 * force / (np.pi * np.maximum(r, 1e-9) ** 2), 0)

    def _footprint(self, force: Forces, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """r, P and the flow q in the middle, for every sample."""
        F = np.moveaxis(force, -2, 0)
        hertz, _ = self._hertz(F)
        r, q, before = np.zeros((3, *F.shape[1:]))
        found = np.empty((3, *F.shape))
        for n, now in enumerate(F):
            kept = np.exp(-np.abs(now - before) / self.rim_n)
            r = np.maximum(hertz[n], np.where(now < before, hertz[n] + (r - hertz[n]) * kept, r))
            P = np.where(now > 0, 1.5e3 * now / (np.pi * np.maximum(r, 1e-9) ** 2), 0)
            off = self.flow * P - q
            # Of d(off)/dt = -off/T exp(|off|/Q) the rate at the start of the step, without overshoot.
            q = q + off * -np.expm1(-dt / self.flow_s * np.exp(np.abs(off) / self.flow_kpa))
            before, found[:, n] = now, (r, P, q)
        return tuple(np.moveaxis(x, 0, -2) for x in found)  # type: ignore[return-value]
