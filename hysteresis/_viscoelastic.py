"""The Burgers model: Maxwell and Kelvin-Voigt elements in series, stepped exactly."""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._errors import InputError
from ._model import AbstractModel, Series, is_start, time_steps
from ._parameter import Scalar, is_concrete, parameter
from ._recurrence import linear_recurrence


class BurgersState(NamedTuple):
    """Time, input and the two creep displacements after a sample. `t` is NaN before the first."""

    t: Array
    force: Array
    dashpot: Array
    kelvin: Array


class BurgersInput(NamedTuple):
    """Steps dt, inputs, the inputs before them, where sequences start, and the state they start in."""

    dt: Array
    u: Array
    u_before: Array
    start: Array
    state: BurgersState


class _Creep(NamedTuple):
    """One exact step: creep = decay * creep + before * (force before) + now * (force now)."""

    decay: Array
    before: Array
    now: Array


class Burgers(AbstractModel[BurgersState, BurgersInput]):
    """Burgers model, force -> displacement, a spring, a dashpot and a Kelvin-Voigt element in series:

        x1' = F / eta1,    x2' = (F - E2 x2) / eta2,    d = F / E1 + x1 + x2 + offset

    Creep compliance J(t) = 1/E1 + t/eta1 + (1 - exp(-E2 t/eta2)) / E2. No internal displacement
    before the first sample; a first force other than zero is a jump. Steps are exact at any, also
    uneven, spacing for an input that is piecewise linear (`hold="linear"`) or keeps its last value
    until the next sample (`hold="constant"`).

    **Arguments:** moduli `E1`, `E2` (N/mm), viscosities `eta1`, `eta2` (N s/mm), all positive,
    and the output's `offset`.

    **Other arguments:**

    - `leading`: run it the other way, displacement -> force: each step solves the last equation
      for F, so this is the exact algebraic inverse. The output then leads the input.
    - `hold`: the input between samples, `"linear"` or `"constant"`.

    Raises `InputError` where a modulus or viscosity is not positive.

    Source: Kim 2018, section on the Burgers model; exact steps re-derived.
    """

    E1: Scalar = parameter(
        unit="force / displacement", bounds=(0.0, float("inf")), meaning="instantaneous stiffness"
    )
    eta1: Scalar = parameter(
        unit="force * time / displacement", bounds=(0.0, float("inf")), meaning="viscosity of flow"
    )
    E2: Scalar = parameter(
        unit="force / displacement", bounds=(0.0, float("inf")), meaning="stiffness of delayed part"
    )
    eta2: Scalar = parameter(
        unit="force * time / displacement",
        bounds=(0.0, float("inf")),
        meaning="viscosity of delayed part",
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="output of the unloaded model")
    leading: bool = eqx.field(default=False, static=True)
    hold: Literal["linear", "constant"] = eqx.field(default="linear", static=True)

    def __check_init__(self) -> None:
        for name in ("E1", "eta1", "E2", "eta2"):
            value = getattr(self, name)
            if is_concrete(value) and not bool((value > 0).all()):
                raise InputError(
                    "not-positive",
                    f"{name} = {value}: moduli and viscosities are positive.",
                    cause="a sign or a unit slipped.",
                    fix=f"give {name} > 0; for an element that is not there use a very large value.",
                )

    def init(self, t0: Any = None, u0: Any = None) -> BurgersState:
        zero = jnp.zeros_like(self.E1)
        return BurgersState(zero + (jnp.nan if t0 is None else t0), zero, zero, zero)

    def step(self, state: BurgersState, t: Any, u: Any) -> tuple[BurgersState, Float[Array, ""]]:
        dt = jnp.where(jnp.isnan(state.t), 0.0, t - state.t)
        creep, force_before = self._creep(dt), state.force
        known = creep.decay * jnp.stack([state.dashpot, state.kelvin]) + creep.before * force_before
        force = jnp.asarray(u)
        if self.leading:
            force = (u - known.sum()) / (1 / self.E1 + creep.now.sum())
        dashpot, kelvin = known + creep.now * force
        after = BurgersState(jnp.asarray(t, dt.dtype), force, dashpot, kelvin)
        y = force if self.leading else self.displacement(after)
        return after, y + jnp.asarray(self.offset)

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: BurgersState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> BurgersInput:
        if t is None:
            raise InputError(
                "no-time",
                "Burgers depends on the rate, and this record has no time.",
                fix="name the time column (--time COL) or the sampling step (--dt SECONDS).",
            )
        u = jnp.asarray(u)
        t = jnp.asarray(t, u.dtype)
        state = self.init() if state is None else state
        first = jnp.asarray(starts)
        dt = time_steps(t, state.t, starts)
        # Before its first sample a leading model's input is the displacement it last stood at.
        u_last = self.displacement(state) if self.leading else state.force
        u_before = jnp.concatenate([u[:1], u[:-1]]).at[first].set(u_last)
        return BurgersInput(dt, u, u_before, is_start(u.shape[0], starts), state)

    def evaluate(self, prepared: BurgersInput) -> Float[Array, " samples"]:
        dt, u, u_before, start, state = prepared
        creep = self._creep(dt)
        begin = jnp.stack([state.dashpot, state.kelvin])[None]
        start = start[:, None]
        if not self.leading:
            drive = creep.before * u_before[:, None] + creep.now * u[:, None]
            drive += start * creep.decay * begin
            x = linear_recurrence(creep.decay * (1 - start), drive)
            return u / self.E1 + x.sum(-1) + self.offset
        # F before = E1 (d before - x1 - x2) removes the force from the recurrence in (x1, x2).
        gain = creep.now / (1 / self.E1 + creep.now.sum(-1, keepdims=True))
        before = creep.before - gain * creep.before.sum(-1, keepdims=True)
        matrix = creep.decay[:, :, None] * jnp.eye(2)[None]
        matrix -= gain[:, :, None] * creep.decay[:, None, :] + self.E1 * before[:, :, None]
        drive = gain * u[:, None] + self.E1 * before * u_before[:, None]
        drive += start * (matrix * begin[:, None]).sum(-1)
        x = linear_recurrence(matrix * (1 - start)[:, :, None], drive)
        return self.E1 * (u - x.sum(-1)) + self.offset

    def displacement(self, state: BurgersState) -> Array:
        """Displacement after a sample, without the offset."""
        return state.force / self.E1 + state.dashpot + state.kelvin

    def creep_compliance(self, t: Any) -> Array:
        """J(t): displacement under a unit force applied at t = 0."""
        t = jnp.asarray(t)
        delayed = -jnp.expm1(-self.E2 * t / self.eta2) / self.E2
        return 1 / self.E1 + t / self.eta1 + delayed

    def relaxation_modulus(self, t: Any) -> Array:
        """G(t): force under a unit displacement applied at t = 0, with integral of J dG = 1:

        G = [(q1 - q2 r1) exp(-r1 t) - (q1 - q2 r2) exp(-r2 t)] / A,  r = (p1 -+ A) / (2 p2),
        p1 = eta1/E1 + eta1/E2 + eta2/E2, p2 = eta1 eta2 / (E1 E2), q1 = eta1, q2 = eta1 eta2 / E2,
        A = sqrt(p1^2 - 4 p2).
        """
        p1 = self.eta1 / self.E1 + self.eta1 / self.E2 + self.eta2 / self.E2
        p2 = self.eta1 * self.eta2 / (self.E1 * self.E2)
        q1, q2 = self.eta1, self.eta1 * self.eta2 / self.E2
        A = jnp.sqrt(p1**2 - 4 * p2)
        r1, r2 = (p1 - A) / (2 * p2), (p1 + A) / (2 * p2)
        t = jnp.asarray(t)
        return ((q1 - q2 * r1) * jnp.exp(-r1 * t) - (q1 - q2 * r2) * jnp.exp(-r2 * t)) / A

    def largest_stable_step(self) -> float:
        """The largest even step at which the displacement -> force direction does not grow.

        Infinite for `hold="linear"`. For `hold="constant"` the step's matrix
        diag(1, a) - E1 (dt/eta1, (1 - a)/E2) (1, 1)^T, a = exp(-E2 dt/eta2), reaches the
        eigenvalue -1, that is 1 + trace + determinant = 0, at one dt, found by bisection.
        """
        if self.hold == "linear":
            return float("inf")
        E1, eta1, E2, eta2 = (float(v) for v in (self.E1, self.eta1, self.E2, self.eta2))

        def stable(dt: float) -> bool:
            a = float(jnp.exp(-E2 * dt / eta2))
            flow, delayed = E1 * dt / eta1, E1 * (1 - a) / E2
            trace = 1 + a - flow - delayed
            determinant = (1 - flow) * (a - delayed) - flow * delayed
            return 1 + trace + determinant >= 0

        low, high = 0.0, eta1 / E1
        while stable(high):
            low, high = high, 2 * high
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if stable(middle) else (low, middle)
        return low

    def _creep(self, dt: Array) -> _Creep:
        """Coefficients of an exact step for (dashpot, Kelvin-Voigt), last axis."""
        x = self.E2 * dt / self.eta2
        a = jnp.exp(-x)
        if self.hold == "constant":
            before = jnp.stack([dt / self.eta1, -jnp.expm1(-x) / self.E2], -1)
            now = jnp.zeros_like(before)
        else:
            # phi = (1 - a) / x, by its series where x is too small to divide by (left out: x^5 / 720)
            small = x < 1e-3
            series = 1 - x / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5)))
            phi = jnp.where(small, series, -jnp.expm1(-x) / jnp.where(small, 1.0, x))
            half = dt / (2 * self.eta1)
            before = jnp.stack([half, (phi - a) / self.E2], -1)
            now = jnp.stack([half, (1 - phi) / self.E2], -1)
        return _Creep(jnp.stack([jnp.ones_like(a), a], -1), before, now)
