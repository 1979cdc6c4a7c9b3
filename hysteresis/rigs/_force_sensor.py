"""A virtual six-axis force sensor: crosstalk, hysteresis and noise."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from ._arguments import check_fields, require

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

        >>> sensor = hysteresis.rigs.ForceSensor(noise_n=0.0, noise_nm=0.0)
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
        _require(
            self.hysteresis < 2 * self.travel,
            f"hysteresis = {self.hysteresis} eats up the travel of {self.travel}.",
            "Keep it below twice the travel.",
        )

    def specimen(self, rng: np.random.Generator) -> Float[np.ndarray, "6 6"]:
        """I + G of one sensor."""
        G = rng.normal(0.0, self.crosstalk, (6, 6))
        G[:3, 3:] /= self.crosstalk_arm_m
        G[3:, :3] *= self.crosstalk_arm_m
        return np.eye(6) + G

    def read(
        self,
        load: Float[np.ndarray, "presses samples 6"],
        specimen: Float[np.ndarray, "6 6"],
        rng: np.random.Generator,
    ) -> Float[np.ndarray, "presses samples 6"]:
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
