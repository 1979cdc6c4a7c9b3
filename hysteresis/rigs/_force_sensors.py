"""Virtual six-axis force sensors: one of crosstalk and plays, and one of beams with strain gauges."""

from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from ._arguments import check_fields, require

Loads = Float[np.ndarray, "presses samples 6"]
"""Histories of wrenches, or of readings, N and N m."""

Matrix = Float[np.ndarray, "6 6"]

_require = partial(require, "ForceSensor")


@dataclass(frozen=True, kw_only=True)
class ForceSensor:
    """A sensor at P_o that reads the wrench w = (F, M) a load exerts about P_o.

        reading = (I + G) H[w] + e,    H[w]_i = w_i - (h_i/2) z_i/r_i

    - G: crosstalk, every entry normal; those between forces and moments are scaled by an arm, so
      that a force and a moment of force times arm leak into each other as two forces do.
    - H: the flexure lags its load by a play, as those of `PrandtlIshlinskii`: a calibration with plays can
      be exactly right, which it cannot be for `GaugeSensor`. z_i follows w_i as a stop of
      travel r_i does, |z_i| <= r_i; between loading and unloading the reading differs by h_i once the load
      has moved by 2 r_i.
    - e: normal noise, fresh in every sample.

    Without load and noise it reads zero: it was zeroed after a rest.

    **Arguments:** (all 0 or more, the arm, the ratings and the travel above)

    - `crosstalk`: standard deviation of the entries of G. `crosstalk_arm_m`: the arm.
    - `hysteresis`: h over full scale; the makers of the paper's sensor promise 1 % at most.
    - `full_scale_n`, `full_scale_nm`: the ratings of force and moment. The paper's are not known;
      these hold its largest forces (40 N) and moments (20 N at the rim, 12 N m) and no more.
    - `travel`: r over full scale.
    - `noise_n`, `noise_nm`: standard deviations of e.

    **Raises:** `InputError` if a parameter is outside its range, or the play so strong that a
    reading no longer rises with its load (h >= 2 r).

    Source: Tsuji et al. (2014), their sensor's 1 % nonlinearity and 1 % hysteresis.

    **Example:**

        >>> sensor = hysteresis.internal.ForceSensor(noise_n=0.0, noise_nm=0.0)
        >>> load = np.array([[[0, 0, 20, 0, 0, 0], [0, 0, 10, 0, 0, 0]]], float)
        >>> sensor.read(load, np.eye(6), np.random.default_rng(0))[0, :, 2].tolist()
        [19.75, 10.25]
    """

    crosstalk: float = 0.015
    crosstalk_arm_m: float = 0.25
    hysteresis: float = 0.01
    full_scale_n: float = 50.0
    full_scale_nm: float = 12.0
    travel: float = 0.05
    noise_n: float = 0.03
    noise_nm: float = 0.006

    def __post_init__(self) -> None:
        check_fields(self, ("crosstalk", "hysteresis", "noise_n", "noise_nm"))
        said = f"hysteresis = {self.hysteresis} eats up the travel of {self.travel}."
        _require(self.hysteresis < 2 * self.travel, said, "Keep it below twice the travel.")

    def specimen(self, rng: np.random.Generator) -> Matrix:
        """I + G of one sensor."""
        G = rng.normal(0.0, self.crosstalk, (6, 6))
        G[:3, 3:] /= self.crosstalk_arm_m
        G[3:, :3] *= self.crosstalk_arm_m
        return np.eye(6) + G

    def read(self, load: Loads, specimen: Matrix, rng: np.random.Generator) -> Loads:
        """Readings in N and N m under histories of load that start from no load."""
        full_scale = np.repeat([self.full_scale_n, self.full_scale_nm], 3)
        travel = self.travel * full_scale
        stop = np.zeros((len(load), 6))
        stops = np.empty_like(load)
        before = np.zeros_like(stop)
        for n in range(load.shape[1]):
            stop = np.clip(stop + load[:, n] - before, -travel, travel)
            stops[:, n], before = stop, load[:, n]
        lagging = load - self.hysteresis * full_scale / 2 * stops / travel
        noise = np.repeat([self.noise_n, self.noise_nm], 3)
        return lagging @ specimen.T + noise * rng.normal(size=load.shape)


_SLIPS: Final = np.geomspace(0.02, 0.5, 10)
"""Strains, as parts of that at full scale, over which the patches of a clamp begin to slip."""

_LEVELS: Final = np.concatenate(
    [np.arange(0, 1.01, 0.25), np.arange(0.75, -1.01, -0.25), [-0.5, 0]]
)
"""Parts of full scale at which the maker loads each axis."""


class Gauges(NamedTuple):
    """One specimen: what its maker could not see."""

    mounting: Matrix
    """from the load about P_o to that in the sensor's own axes"""
    strain: Float[np.ndarray, "8 6"]
    """of each bridge for full scale of each axis"""
    bend: Float[np.ndarray, "8 2"]
    """of each bridge's output: quadratic and cubic"""
    decoupling: Float[np.ndarray, "6 8"]
    """from the bridges' outputs to parts of full scale, by the maker's calibration"""


@dataclass(frozen=True, kw_only=True)
class GaugeSensor:
    """A cross of four beams, each with a bridge for bending up and one for bending sideways.

        x = T w/full scale,    g = B x,    b_k = e_k + m_k2 e_k^2 + m_k3 e_k^3
        e_k = g_k - (H/2) mean_i r_ik,     dr_ik/dg_k = (1 - sign(dg_k) r_ik)/l_i
        reading = full scale D b + noise

    - T: how the sensor is mounted, a degree and two millimetres off.
    - r: the beams are clamped, and patches of the clamp slip one after the other, each as `BoucWen` with
      n = 1 and gamma = 0: hysteresis belongs to the bridges, before they are mixed, not to the axes.
    - m: the bridges are not linear.
    - D: the maker loads one axis after the other by a jig that is itself misaligned, and fits D by least
      squares. What is left is crosstalk, nonlinearity and hysteresis at once, none of which is a
      parameter of a calibration.

    **Arguments:** (all above 0)

    - `full_scale_n`, `full_scale_nm`: ratings; those of the paper's sensor are not known.
    - `nonlinearity`, `hysteresis`: parts of full scale, the largest that a bridge has; the maker of the
      paper's sensor promises 1 % of each at most.
    - `misplaced`: of the gauges, as a part of the strain at full scale.
    - `jig_deg`, `jig_mm`: standard deviations of the maker's jig; `mount_deg`, `mount_mm`: of the shell's.
    - `noise_n`, `noise_nm`: standard deviations of a reading.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Tsuji et al. (2014), the 1 % of nonlinearity and of hysteresis; the rest is common practice
    and was chosen to give the error of their rigid shell.

    **Example:**

        >>> sensor = hysteresis.internal.GaugeSensor(noise_n=1e-9, noise_nm=1e-9)
        >>> load = np.array([[[0, 0, 20, 0, 0, 0], [0, 0, 10, 0, 0, 0]]], float)
        >>> specimen = sensor.specimen(np.random.default_rng(0))
        >>> sensor.read(load, specimen, np.random.default_rng(0))[0, :, 2].round(1).tolist()
        [19.5, 10.2]
    """

    full_scale_n: float = 200.0
    full_scale_nm: float = 20.0
    nonlinearity: float = 0.01
    hysteresis: float = 0.01
    misplaced: float = 0.03
    jig_deg: float = 1.2
    jig_mm: float = 2.0
    mount_deg: float = 1.0
    mount_mm: float = 2.0
    noise_n: float = 0.03
    noise_nm: float = 0.006

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def full_scale(self) -> Float[np.ndarray, " 6"]:
        """N and N m of the six axes."""
        return np.repeat([self.full_scale_n, self.full_scale_nm], 3)

    def specimen(self, rng: np.random.Generator) -> Gauges:
        """One sensor, made, calibrated by its maker and mounted below a shell."""
        turn = np.pi / 2 * np.arange(4)
        zero, one = np.zeros(4), np.ones(4)
        up = np.stack([zero, zero, one, np.sin(turn), -np.cos(turn), zero], 1)
        aside = np.stack([np.sin(turn), -np.cos(turn), zero, zero, zero, one], 1)
        strain = np.concatenate([up, aside]) + self.misplaced * rng.normal(size=(8, 6))
        # A cubic a x^3 leaves its best line by 0.38 a at most, a quadratic a x^2 by half of a.
        bend = self.nonlinearity * rng.uniform(-1, 1, (8, 2)) * [0.5, 1.0]
        full = self.full_scale
        mounting = _moved(self.mount_deg, self.mount_mm, full, rng)
        jig = np.stack([_moved(self.jig_deg, self.jig_mm, full, rng)[:, k] for k in range(6)])
        meant = (_LEVELS[:, None] * np.eye(6)[:, None]).reshape(-1, 6)
        bridges = self._bridges(_LEVELS[:, None] * jig[:, None], strain, bend).reshape(-1, 8)
        decoupling = np.linalg.lstsq(bridges, meant, rcond=None)[0].T
        return Gauges(mounting, strain, bend, decoupling)

    def read(self, load: Loads, specimen: Gauges, rng: np.random.Generator) -> Loads:
        """Readings in N and N m under histories of load that start from no load."""
        parts = load / self.full_scale @ specimen.mounting.T
        bridges = self._bridges(parts, specimen.strain, specimen.bend)
        noise = np.repeat([self.noise_n, self.noise_nm], 3)
        reading = self.full_scale * (bridges @ specimen.decoupling.T)
        return reading + noise * rng.normal(size=load.shape)

    def _bridges(
        self, parts: Loads, strain: Float[np.ndarray, "8 6"], bend: Float[np.ndarray, "8 2"]
    ) -> Float[np.ndarray, "presses samples 8"]:
        """Outputs under histories of load, in parts of full scale, from rest."""
        g = parts @ strain.T
        rub, before = np.zeros((len(g), 8, len(_SLIPS))), np.zeros(g.shape[::2])
        out = np.empty_like(g)
        for n in range(g.shape[1]):
            moved = (g[:, n] - before)[..., None]
            way = np.sign(moved)
            rub = way + (rub - way) * np.exp(-np.abs(moved) / _SLIPS)
            before = g[:, n]
            e = before - self.hysteresis / 2 * rub.mean(axis=2)
            out[:, n] = e + bend[:, 0] * e**2 + bend[:, 1] * e**3
        return out


def _moved(
    degrees: float, millimetres: float, full: Float[np.ndarray, " 6"], rng: np.random.Generator
) -> Matrix:
    """Wrenches, in parts of full scale, seen from axes that are a little turned and moved."""
    a, b, c = np.deg2rad(degrees) * rng.normal(size=3)
    x, y, z = 1e-3 * millimetres * rng.normal(size=3)
    turn = np.eye(3) + np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    arm = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    whole = np.block([[turn, np.zeros((3, 3))], [arm @ turn, turn]])
    return whole * full / full[:, None]
