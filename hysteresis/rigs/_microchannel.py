"""A virtual skin of two liquid-metal channels, one over the other: Kim and Park (2018).

No model of ours is the whole law, stops inside a closing channel's curve with creep, though stops and creep
are elements of ours, too. It is a plausible generator, not an identification: the paper prints no
curve's numbers.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from ._arguments import require
from ._skin_presses import AbstractSkinRig, Forces, Placed, Readings, lag

_require = partial(require, "MicrochannelRig")


@dataclass(frozen=True, kw_only=True)
class MicrochannelRig(AbstractSkinRig):
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
    - `readout`: from changes to V.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Kim and Park (2018), figs 1, 5 and 7 and tables I to III, which S, the placement and the
    noise were chosen to give; 6.5 to 14 % of hysteresis are read off fig 1.

    **Example:**

        >>> rig = hysteresis.rigs.MicrochannelRig(seed=11)
        >>> volts = rig.follow([[2.0, 0.0, 0.0, 0.0, 0.0]] * 50)
        >>> volts[-1].round(2).tolist()
        [0.97, 0.32]
    """

    closing_force_n: float = 41.8
    friction: float = 0.09
    friction_onset_n: float = 0.8
    stop_travel_n: tuple[float, ...] = (0.35, 0.9, 2.2)
    stop_share: tuple[float, ...] = (0.4, 0.35, 0.25)
    creep: tuple[float, ...] = (0.05, 0.04)
    creep_s: tuple[float, ...] = (0.4, 6.0)
    placement_common: float = 0.10
    placement_differential: float = 0.066

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(
            len(self.stop_travel_n) == len(self.stop_share)
            and abs(sum(self.stop_share) - 1) < 1e-9
            and len(self.creep) == len(self.creep_s)
            and sum(self.creep) < 1
            and self.friction < 1,
            "stops or creep do not fit together.",
            "Stop shares add up to 1, creep to less; each has its travel or its time.",
        )

    def _at_zero(self) -> tuple[str, ...]:
        return (*super()._at_zero(), "placement_common", "placement_differential", "friction")

    def _placement(self, rng: np.random.Generator, presses: int) -> Float[np.ndarray, "presses l"]:
        """p of each press: layers by turns get c + d and c - d."""
        common = self.placement_common * rng.normal(size=(presses, 1))
        differential = self.placement_differential * rng.normal(size=(presses, 1))
        return np.exp(common + differential * (-1.0) ** np.arange(self.gains.shape[0]))

    @property
    def _middle(self) -> Float[np.ndarray, " placed"]:
        """The placement of a press in the middle of its location."""
        return np.ones(self.gains.shape[0])

    def _changes(self, force: Forces, dt: float, placement: Placed) -> Readings:
        """c: the relative change of each layer, behind the low-pass."""
        pressed = self._closing(force, dt)[..., None, :]
        return np.sum(self.gains * placement * pressed, axis=-1)

    def _closing(self, force: Forces, dt: float) -> Forces:
        """v behind the low-pass, in N: both are linear, and the order of linear stages is free."""
        said = "a force is not below the closing force."
        mend = f"Stay below {self.closing_force_n:g} N."
        _require(bool(np.all(force < self.closing_force_n)), said, mend)
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
            v += g * lag(u, dt, tau)
        return np.moveaxis(lag(v, dt, self.readout.low_pass_s), 0, -2)
