"""A block of open-cell foam under a probe, in layers: struts, friction, air, relaxation."""

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from ._arguments import check_fields, check_lengths, check_step, require
from ._sponge import FORCE_LIMIT, AbstractBlock, SpongeCycles, checked_path

_require = partial(require, "FoamBlock")

AIR = 1.8e-8
"""kPa s: viscosity of air."""

SUBSTEPS = 2
"""Equal steps in which each ramp of force is integrated."""

MIXED_CYCLES = (
    (20, 0.5, 5), (20, 2.0, 0), (12, 1.0, 20), (16, 0.5, 5), (8, 2.0, 10), (18, 1.0, 0),
    (10, 0.5, 30), (20, 1.0, 5), (14, 2.0, 0), (6, 1.0, 10), (17, 1.5, 15), (11, 0.7, 0), (19, 0.4, 5),
)  # fmt: skip
"""Peak in N, rate in N/s, and the rest afterwards in s, cycle by cycle."""

MIXED_STEP = 0.5
"""s from sample to sample of these cycles."""

_ENOUGH = 1e-11  # of the strain
_MOST = 60  # steps of Newton's method

Layers = Float[np.ndarray, "columns layers"]


class _State(NamedTuple):
    """Where every layer stands: strain, the largest one so far, friction, and overstress in kPa."""

    strain: Layers
    deepest: Layers
    rub: Float[np.ndarray, "kinds columns layers"]
    over: Float[np.ndarray, "times columns layers"]


@dataclass(frozen=True, kw_only=True)
class FoamBlock(AbstractBlock):
    """A block of soft open-cell foam that a round probe presses with a given force.

    The load spreads below the probe in a cone, which is cut into layers. Each layer i, with the area A_i
    and the strain e_i, carries the whole force by its struts and by the air in it:

        F = A_i (s_i + p_i),        d = h sum_i e_i

    - struts: s = S(e) (1 - c (1 - exp((e - e_max)/e_c))) + (f (1 - exp(-e/e_f)) + a S(e)) R + sum_j q_j,
      S(e) = E (e - (1 - b) e_b (1 - exp(-e/e_b)))/(1 - e/e_D)^m: loose ones first, touching in the end
    - rubbing: R is the mean of some r_k with dr_k/de = (1 - sign(de) r_k)/l_k, which slip gradually: each
      is `BoucWen` with n = 1 and gamma = 0
    - flow of the polymer, by Eyring: dq_j = w_j dS - (Q/T_j) sinh(q_j/Q) dt
    - air: the closing of a layer drives it to the neighbours and sideways through k = k_0 (1 - e)^3,
      div(k grad p)/eta = -de/dt

    At 20 N the layer under the probe of a block of 50 mm is squashed to 8 % of its height and the lowest to
    60 %, so each is at another point of its law, and no sum or series of elements with one input is the
    block. In one of 10 mm all layers are below 19 %: it has reached densification. The probe is not glued
    on: e >= 0. Each sample ends a ramp of force; the first starts from the virgin block at rest. Air moves
    it by 0.002 mm at the rates of the paper.

    **Arguments:** (all positive unless it is said otherwise)

    - `thickness_mm`, `layers`, `probe_mm` (diameter), `spread` (tangent of the cone's half angle).
    - `modulus_kpa`, `toe_strain`, `toe_slope`, `dense_strain`, `dense_power`: E, e_b, b, e_D, m.
    - `softening`, `softening_strain`: c and e_c.
    - `friction_kpa`, `friction_onset`, `friction_share`, `slip_strain`: f, e_f, a, and l_k.
    - `flow_share`, `flow_s`, `flow_kpa`: w_j, T_j, Q.
    - `permeability_mm2`: k_0.
    - `aged`: the part of the struts that have broken, 0 or more; it weakens E and friction alike.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Gibson and Ashby, Cellular Solids (1997), chapters 5 and 6, for the struts and the air. The
    numbers were chosen so that the block meets what Tsuji et al. (2014) print of theirs, and so that one of
    10 mm is the least linear, as in their fig 10.

    **Example:**

        >>> block = hysteresis.internal.FoamBlock(thickness_mm=50.0)
        >>> block.follow([0.0, 10.0, 20.0, 10.0]).round(1).tolist()
        [0.0, 16.5, 30.6, 21.9]
    """

    thickness_mm: float = 50.0
    layers: int = 8
    probe_mm: float = 15.0
    spread: float = 0.11627
    modulus_kpa: float = 94.16104
    toe_strain: float = 0.076004
    toe_slope: float = 0.050015
    dense_strain: float = 0.9949
    dense_power: float = 0.055026
    softening: float = 0.003014
    softening_strain: float = 0.25925
    friction_kpa: float = 5.11853
    friction_onset: float = 0.090963
    friction_share: float = 0.036154
    slip_strain: tuple[float, ...] = (0.049255, 0.122061)
    flow_share: tuple[float, ...] = (0.045097, 0.032833)
    flow_s: tuple[float, ...] = (4.0, 40.0)
    flow_kpa: float = 5.24025
    permeability_mm2: float = 2e-5
    aged: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self, ("aged",))
        check_lengths(self, ("flow_share", "flow_s"))
        _require(
            self.softening + self.friction_share < 1 and self.aged < 1 and self.dense_strain <= 1,
            "softening, friction_share or aged leave nothing of the struts.",
            "Keep softening + friction_share and aged below 1, dense_strain at 1 or below.",
        )

    def follow(self, force: ArrayLike, dt: float = 6.0) -> Float[np.ndarray, " samples"]:
        """Displacement in mm under the given force in N, 0 to 40, each sample `dt` seconds after the last.

        **Raises:** `InputError` outside these ranges.
        """
        return self.follow_columns(checked_path(force)[None], dt)[0]

    def follow_columns(
        self,
        force: Float[np.ndarray, "columns samples"],
        dt: float = 6.0,
        stiffness: ArrayLike = 1.0,
        supported: ArrayLike = 1.0,
    ) -> Float[np.ndarray, "columns samples"]:
        """`follow` of columns side by side, each with its own force.

        - `stiffness` (columns,): times E and f, as one place of a sheet differs from another.
        - `supported` (columns,): part of the cone's growth that the foam can use; less near an edge.
        """
        force = np.asarray(force, float)
        _require(
            force.ndim == 2 and bool(np.all((force >= 0) & (force <= FORCE_LIMIT))),
            f"force is not (columns, samples) within 0 to {FORCE_LIMIT:g} N.",
            "Stay where the rig is known to resemble the foam.",
        )
        check_step("FoamBlock", dt)
        columns = len(force)
        factor, support = (
            np.broadcast_to(np.asarray(v, float), (columns,))[:, None]
            for v in (stiffness, supported)
        )
        height = self.thickness_mm / self.layers
        middle = height * (np.arange(self.layers) + 0.5)
        radius = self.probe_mm / 2 + support * self.spread * middle
        area = 1e-3 * np.pi * radius**2  # N/kPa
        zero = np.zeros((columns, self.layers))
        kinds, times = len(self.slip_strain), len(self.flow_s)
        state = _State(zero, zero, np.zeros((kinds, *zero.shape)), np.zeros((times, *zero.shape)))
        last, depth, step = np.zeros((columns, 1)), np.empty(force.shape), dt / SUBSTEPS
        for n, end in enumerate(force.T[..., None]):
            for k in range(1, SUBSTEPS + 1):
                now = last + (end - last) * k / SUBSTEPS
                state = self._yield(state, now / area, factor, radius, height, step)
            last, depth[:, n] = end, height * state.strain.sum(axis=1)
        return depth

    def mixed_cycles(self, noise: float = 0.0, seed: int | None = None) -> SpongeCycles:
        """Cycles of which no two have the same peak, rate and rest (`MIXED_CYCLES`), every 0.5 s.

        A rest belongs to the cycle before it.
        """
        force, cycle = [0.0], [1]
        for n, (peak, rate, rest) in enumerate(MIXED_CYCLES, start=1):
            up = np.linspace(0, peak, round(peak / rate / MIXED_STEP) + 1)
            part = [*up[1:], *up[-2::-1], *[0.0] * round(rest / MIXED_STEP)]
            force += part
            cycle += [n] * len(part)
        depth = self.follow(force, dt=MIXED_STEP)
        depth += np.random.default_rng(seed).normal(0.0, noise, len(depth))
        time = MIXED_STEP * np.arange(len(force))
        return SpongeCycles(time, np.array(force), depth, np.array(cycle))

    def at_age(self, aged: float) -> "FoamBlock":
        """The block with this part of its struts broken."""
        return replace(self, aged=aged)

    def _yield(
        self, state: _State, stress: Layers, factor: np.ndarray, radius: Layers, height: float, dt: float
    ) -> _State:  # fmt: skip
        """The layers after `dt` seconds in which struts and air come to carry `stress`, kPa."""
        resistance = self._air(state.strain, radius, height) / dt
        scale = self.modulus_kpa * factor
        e = state.strain
        # Off the kink of the friction, to the side where the solution is.
        left, _, _ = self._struts(state, e, factor, dt)
        e = np.clip(e + 1e-9 * np.sign(stress - left), 0, e + 0.5 * (self.dense_strain - e))
        for n in range(_MOST):
            carried, slope, after = self._struts(state, e, factor, dt)
            moved = e - state.strain
            off = carried + np.einsum("cij,cj->ci", resistance, moved) - stress
            held = (e <= 0) & (off > 0)
            matrix = resistance + slope[..., None] * np.eye(self.layers)
            matrix = np.where(held[..., None], np.eye(self.layers), matrix)
            change = np.linalg.solve(matrix, np.where(held, 0, -off)[..., None])[..., 0]
            new = np.clip(e + (1 if n < 20 else 0.5) * change, 0, e + 0.5 * (self.dense_strain - e))
            if np.all(np.abs(new - e) < _ENOUGH) or np.all(held | (np.abs(off) < 1e-10 * scale)):
                break
            e = new
        return after

    def _struts(
        self, state: _State, e: Layers, factor: Float[np.ndarray, "columns 1"], dt: float
    ) -> tuple[Layers, Layers, _State]:
        """Stress of the struts at the strain `e`, its slope, and the state there."""
        elastic, slope = self._elastic(e, factor)
        before, _ = self._elastic(state.strain, factor)
        deepest = np.maximum(state.deepest, e)
        back = np.exp((e - deepest) / self.softening_strain)
        soft = 1 - self.softening * (1 - back)
        softens = self.softening * back / self.softening_strain * (e < deepest)
        way = np.where(e >= state.strain, 1.0, -1.0)
        gone = np.exp(-np.abs(e - state.strain) / np.reshape(self.slip_strain, (-1, 1, 1)))
        rub = way + (state.rub - way) * gone
        rubs = (1 - way * state.rub) * gone / np.reshape(self.slip_strain, (-1, 1, 1))
        R, Rs = rub.mean(axis=0), rubs.mean(axis=0)
        f = self.friction_kpa * (1 - self.aged) * factor
        onset = np.exp(-e / self.friction_onset)
        grip = f * (1 - onset) + self.friction_share * elastic
        grips = f * onset / self.friction_onset + self.friction_share * slope
        total = elastic * soft + grip * R
        rises = slope * soft + elastic * softens + grips * R + grip * Rs
        Q = 2 * self.flow_kpa
        over = []
        for q, w, tau in zip(state.over, self.flow_share, self.flow_s, strict=True):
            start, kept = np.tanh((q + w * (elastic - before)) / Q), np.exp(-dt / tau)
            over.append(Q * np.arctanh(start * kept))
            total = total + over[-1]
            rises = rises + w * slope * kept * (1 - start**2) / (1 - (start * kept) ** 2)
        return total, rises, _State(e, deepest, rub, np.array(over))

    def _elastic(self, e: Layers, factor: Float[np.ndarray, "columns 1"]) -> tuple[Layers, Layers]:
        """S and its slope."""
        E, y = self.modulus_kpa * (1 - self.aged) * factor, self.toe_strain
        loose = (1 - self.toe_slope) * np.exp(-e / y)
        curve, slope = e + y * (loose - (1 - self.toe_slope)), 1 - loose
        room = 1 - e / self.dense_strain
        dense = E * room**-self.dense_power
        steeper = self.dense_power / (self.dense_strain * room)
        return dense * curve, dense * (slope + curve * steeper)

    def _air(self, strain: Layers, radius: Layers, height: float) -> Float[np.ndarray, "c n n"]:
        """Pressure of every layer for a rate of closing 1/s of every layer: kPa s."""
        k = self.permeability_mm2 * (1 - strain) ** 3 / AIR
        between = 2 / (1 / k[:, 1:] + 1 / k[:, :-1]) / height**2
        flow, i = np.zeros((*strain.shape, self.layers)), np.arange(self.layers)
        flow[:, i, i] = 8 * k / radius**2
        for one, other in ((i[1:], i[:-1]), (i[:-1], i[1:])):
            flow[:, one, other] -= between
            flow[:, one, one] += between
        return np.linalg.inv(flow)
