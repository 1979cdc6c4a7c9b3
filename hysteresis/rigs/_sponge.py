"""A virtual urethane sponge under a flat probe: the indentation test of Tsuji et al. (2014).

No model of ours is the whole law (an Iwan assembly of stops inside a softening foam curve with Prony
overstress and first-cycle conditioning), so that a model fitted to it is wrong in the way models of a
real sponge are; its stops and branches are elements of ours, too. It is a plausible generator, not an
identification: it has more parameters than the paper prints statistics.
"""

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from ._arguments import check_fields, check_lengths, check_step, fault, require

_fault = partial(fault, "SpongeRig")
_require = partial(require, "SpongeRig")

REFERENCE_THICKNESS: Final = 50.0
"""mm, of the paper's block, to which the parameters refer."""

FORCE_LIMIT: Final = 40.0
"""N, the end of the paper's preliminary test: beyond it nothing constrains the law."""

_ROOT_TOLERANCE: Final = 1e-12  # mm; the displacements themselves carry 7e-15


class Line(NamedTuple):
    """d = K F + b."""

    K: float
    """mm/N"""
    b: float
    """mm"""


class SpongeStatistics(NamedTuple):
    """What the paper prints; a gap is unloading minus loading at the same force and cycle."""

    mean_gap: float
    """mm, over 2 N <= F < peak in all cycles"""
    largest_gap: float
    """mm"""
    largest_gap_force: float
    """N"""
    largest_gap_cycle: int
    loading: Line
    """approximation 1"""
    both: Line
    """approximation 2"""
    unloading: Line
    """approximation 3"""
    loss: Float[np.ndarray, " cycles"]
    """1 - (work returned)/(work done), per cycle"""


class SpongeCycles(NamedTuple):
    """A cyclic force test as recorded. The 0 N sample between two cycles ends the earlier one."""

    time: Float[np.ndarray, " n"]
    """s"""
    force: Float[np.ndarray, " n"]
    """N"""
    displacement: Float[np.ndarray, " n"]
    """mm"""
    cycle: Int[np.ndarray, " n"]
    """1, 2, ..."""

    def statistics(self) -> SpongeStatistics:
        """The paper's statistics.

        The lines are least squares over F >= 2 N (the paper leaves 0 N out); the peak belongs to
        both branches and therefore counts twice in approximation 2.
        """
        gaps, rising, falling, loss = [], [], [], []
        for cycle in np.unique(self.cycle):
            rows = np.flatnonzero(self.cycle == cycle)
            cut = slice(max(rows[0] - 1, 0), rows[-1] + 1)  # starts where the last one ended
            force, displacement = self.force[cut], self.displacement[cut]
            peak = np.argmax(force)
            up = force[: peak + 1], displacement[: peak + 1]
            down = force[peak:], displacement[peak:]
            loss.append(1 + np.trapezoid(*down) / np.trapezoid(*up))
            forces, i, j = np.intersect1d(up[0], down[0], return_indices=True)
            gap, inside = down[1][j] - up[1][i], (forces >= 2) & (forces < force[peak])
            pairs = zip(gap[inside].tolist(), forces[inside].tolist(), strict=True)
            gaps += [(*pair, int(cycle)) for pair in pairs]
            rising.append(up)
            falling.append(down)
        largest, at_force, at_cycle = max(gaps)
        mean = float(np.mean([gap for gap, _, _ in gaps]))
        lines = map(_line, (rising, rising + falling, falling))
        return SpongeStatistics(mean, largest, at_force, at_cycle, *lines, loss=np.array(loss))


def _line(branches: list[tuple[np.ndarray, np.ndarray]]) -> Line:
    force, displacement = (np.concatenate(column) for column in zip(*branches, strict=True))
    K, b = np.polyfit(force[force >= 2], displacement[force >= 2], 1)
    return Line(float(K), float(b))


class _State(NamedTuple):
    """Where the sponge stands; lengths are those of the 50 mm block."""

    depth: float
    deepest: float
    elastic: float
    struts: tuple[float, ...]
    overstress: tuple[float, ...]


class AbstractBlock(abc.ABC):
    """A block of foam that a probe presses with a given force."""

    @abc.abstractmethod
    def follow(self, force: ArrayLike, dt: float = 6.0) -> Float[np.ndarray, " n"]:
        """Displacement in mm under the given force in N."""

    def five_cycles(
        self, peak: float = 20.0, step: float = 2.0, noise: float = 0.0, seed: int | None = None
    ) -> SpongeCycles:
        """The paper's test: five times 0 to `peak` to 0 N, in steps of `step` N every 6 s.

        **Arguments:**

        - `peak`, `step`: N; a whole number of steps makes the peak.
        - `noise`: standard deviation of one reading of the displacement, mm.
        - `seed`: of the noise; None draws a fresh one.

        **Raises:** `InputError` if the steps do not make the peak, or the peak is out of range.
        """
        _require(
            noise >= 0, f"noise = {noise} mm is negative.", "Give a standard deviation, 0 or more."
        )
        steps = round(peak / step) if step > 0 else 0
        said = f"steps of {step} N do not make {peak} N."
        mend = "Choose a positive step that divides the peak."
        _require(steps >= 1 and math.isclose(steps * step, peak), said, mend)
        ramp = np.linspace(0.0, peak, steps + 1)
        force = np.concatenate([[0.0], np.tile(np.concatenate([ramp[1:], ramp[-2::-1]]), 5)])
        cycle = np.concatenate([[1], np.repeat(np.arange(1, 6), 2 * steps)])
        read = np.random.default_rng(seed).normal(0.0, noise, force.size)
        return SpongeCycles(6.0 * np.arange(force.size), force, self.follow(force) + read, cycle)


def checked_path(force: ArrayLike) -> Float[np.ndarray, " n"]:
    """A force over time, within what the rigs are known for. Raises `InputError` `bad-option`."""
    path = np.asarray(force, float)
    _require(path.ndim == 1, f"force has {path.ndim} dimensions.", "Give a sequence of numbers.")
    outside = np.flatnonzero(~((path >= 0) & (path <= FORCE_LIMIT)))
    if outside.size:
        said = f"force[{outside[0]}] = {path[outside[0]]:g} N is outside 0 to {FORCE_LIMIT:g} N."
        raise _fault(said, "Stay where the rig is known to resemble the sponge.")
    return path


@dataclass(frozen=True, kw_only=True)
class SpongeRig(AbstractBlock):
    """A block of soft urethane foam, a probe, a gauge and a stage.

    With the block's thickness h and displacement d, everything happens in x = 50 mm d/h:

        F = E(x) (1 - c tanh((x_max - x)/x_c)) (1 + a Z) + f (1 - exp(-x/x_f)) Z + sum_j Q_j

    - foam curve: toe, linear regime, densification, with s(v) = log(1 + exp(v)),
      E = k' w [s((x - x_0)/w) - s(-x_0/w)] + m (w_m s((x - x_m)/w_m))^2, k' = k (50/h)^(q - 1)
    - struts rubbing: Z = sum_i o_i z_i/r_i, |z_i| <= r_i, each z_i following x as a stop does
    - first-cycle conditioning: the curve is softer below the deepest x so far
    - relaxation: dQ_j/dt = g_j dE/dt - Q_j/tau_j

    The probe is not glued on: d >= 0. Each sample ends a ramp of `dt` seconds from the sample
    before, the first a ramp from the virgin block at rest. The defaults reproduce the paper's
    statistics; the rig keeps no state, so a call never depends on an earlier one.

    **Arguments:** (all positive)

    - `thickness_mm`: h. The paper tested 50, 30 and 10 mm.
    - `stiffness_n_per_mm`, `thickness_exponent`: k and q; a linear sponge has k (50/h)^q.
    - `toe_mm`, `toe_width_mm`: x_0 and w.
    - `densification_n_per_mm2`, `densification_mm`, `densification_width_mm`: m, x_m and w_m.
    - `friction_gain`, `friction_n`, `friction_mm`: a, f and x_f.
    - `strut_travel_mm`, `strut_share`: r_i and o_i; the shares sum to one.
    - `conditioning`, `conditioning_mm`: c and x_c.
    - `overstress`, `relaxation_s`: g_j and tau_j.

    **Raises:** `InputError` if a parameter is outside its range.

    **Example:**

        >>> rig = hysteresis.rigs.SpongeRig(thickness_mm=50.0)
        >>> rig.follow([0.0, 10.0, 20.0, 10.0]).round(2).tolist()
        [0.0, 16.38, 29.92, 21.85]
    """

    thickness_mm: float = 50.0
    stiffness_n_per_mm: float = 0.6503
    thickness_exponent: float = 0.6
    toe_mm: float = 3.209
    toe_width_mm: float = 3.748
    densification_n_per_mm2: float = 0.836
    densification_mm: float = 43.73
    densification_width_mm: float = 1.5
    friction_gain: float = 0.0805
    friction_n: float = 1.278
    friction_mm: float = 6.865
    strut_travel_mm: tuple[float, ...] = (1.329, 5.485, 22.64)
    strut_share: tuple[float, ...] = (0.5035, 0.2979, 0.1986)
    conditioning: float = 0.0332
    conditioning_mm: float = 2.036
    overstress: tuple[float, ...] = (0.06, 0.04)
    relaxation_s: tuple[float, ...] = (4.0, 40.0)

    def __post_init__(self) -> None:
        check_fields(self, below={"friction_gain": 1, "conditioning": 1})
        check_lengths(self, ("strut_travel_mm", "strut_share"), ("overstress", "relaxation_s"))
        said = f"strut_share sums to {sum(self.strut_share)}, not 1."
        mend = "Divide the shares by their sum."
        _require(math.isclose(sum(self.strut_share), 1, abs_tol=1e-9), said, mend)

    def follow(
        self, force: ArrayLike, dt: float = 6.0, substeps: int = 4
    ) -> Float[np.ndarray, " n"]:
        """Displacement in mm under the given force in N: F(d) = force, to 1e-12 mm.

        Where the sponge pushes back harder than `force` even undeformed, d = 0.

        **Arguments:**

        - `force`: one-dimensional, within 0 to 40 N.
        - `dt`: seconds from sample to sample.
        - `substeps`: equal steps in which each ramp of force is integrated. The error
          falls with their square; four leave 1 um for 2 N in 6 s.

        **Raises:** `InputError` outside these ranges, or if the block is squashed flat.
        """
        path = checked_path(force)
        check_step("SpongeRig", dt)
        _require(substeps >= 1, f"substeps = {substeps} is less than 1.", "Give 1 or more.")
        step = dt / substeps
        state, last, depth = self._virgin(), 0.0, np.empty(path.size)
        for n, target in enumerate(path.tolist()):
            for k in range(1, substeps + 1):
                state = self._yield(state, last + (target - last) * k / substeps, step)
            last, depth[n] = target, state.depth
        return depth * self._scale

    @property
    def _scale(self) -> float:
        return self.thickness_mm / REFERENCE_THICKNESS

    def _virgin(self) -> _State:
        struts, overstress = (0.0,) * len(self.strut_share), (0.0,) * len(self.overstress)
        return _State(0.0, 0.0, self._elastic(0.0), struts, overstress)

    def _elastic(self, x: float) -> float:
        w, w_m = self.toe_width_mm, self.densification_width_mm
        foam = w * (_softplus((x - self.toe_mm) / w) - _softplus(-self.toe_mm / w))
        solid = w_m * _softplus((x - self.densification_mm) / w_m)
        stiffness = self.stiffness_n_per_mm * self._scale ** (1 - self.thickness_exponent)
        return stiffness * foam + self.densification_n_per_mm2 * solid * solid

    def _step(self, state: _State, x: float, dt: float) -> tuple[_State, float]:
        """State and force after `dt` seconds of E's straight ramp from `state` to depth x."""
        struts, Z = [], 0.0
        for z, r, share in zip(state.struts, self.strut_travel_mm, self.strut_share, strict=True):
            z = min(max(z + x - state.depth, -r), r)
            struts.append(z)
            Z += share * z / r
        elastic = self._elastic(x)
        overstress = []
        for Q, g, tau in zip(state.overstress, self.overstress, self.relaxation_s, strict=True):
            lost = -math.expm1(-dt / tau)
            overstress.append(Q - lost * Q + g * lost * tau / dt * (elastic - state.elastic))
        deepest = max(state.deepest, x)
        softening = self.conditioning * math.tanh((deepest - x) / self.conditioning_mm)
        force = elastic * (1 - softening) * (1 + self.friction_gain * Z)
        force -= self.friction_n * math.expm1(-x / self.friction_mm) * Z
        force += sum(overstress)
        return _State(x, deepest, elastic, tuple(struts), tuple(overstress)), force

    def _yield(self, state: _State, force: float, dt: float) -> _State:
        """The state after `dt` seconds in which the force ends at `force`."""

        def excess(depth: float) -> float:
            return self._step(state, depth, dt)[1] - force

        here = excess(state.depth)
        end = REFERENCE_THICKNESS if here < 0 else 0.0
        there = excess(end)
        if here >= 0 and there >= 0:
            return self._step(state, end, dt)[0]
        said = f"{force:g} N squashes the block of {self.thickness_mm:g} mm flat."
        _require(there > 0 or here >= 0, said, "Lower the force or take a thicker block.")
        depth: Any = brentq(excess, state.depth, end, xtol=_ROOT_TOLERANCE)
        return self._step(state, depth, dt)[0]


def force_path(turns: Sequence[float], step: float = 1.0) -> Float[np.ndarray, " samples"]:
    """From the first force (left out) through the others, in equal steps of at most `step` N.

    **Raises:** `InputError` if there is no turn, or the step is not positive.

    **Example:**

        >>> hysteresis.internal.force_path([0.0, 3.0, 1.0])
        array([1., 2., 3., 2., 1.])
    """
    said = "no turn, or no step."
    require("ArmorRig", len(turns) > 0 and step > 0, said, "Give forces, and a step > 0.")
    pieces = [
        np.linspace(a, b, max(int(np.ceil(abs(b - a) / step - 1e-9)), 1) + 1)[1:]
        for a, b in pairwise(turns)
    ]
    return np.concatenate([np.empty(0), *pieces])


def _softplus(v: float) -> float:
    return max(v, 0.0) + math.log1p(math.exp(-abs(v)))
