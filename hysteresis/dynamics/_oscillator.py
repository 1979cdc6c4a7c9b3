"""A mass on a spring, a damper and a hysteretic force."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from .._errors import InputError
from .._model import AbstractModel, AbstractSteppedModel, Tree
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..models._compose import Sum
from ..trees import node
from ._fast_path import Compiled
from ._layout import layout_of
from ._rate_form import AbstractRateForm
from ._runge_kutta import runge_kutta

NEWTON_STEPS = 4


class OscillatorState(NamedTuple):
    """Time (NaN before the first sample) and force of the last sample, motion, and the parts' states."""

    t: Array
    force: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    parts: tuple[Any, ...]


@register
class Oscillator(AbstractSteppedModel[OscillatorState]):
    """A mass on a spring, a damper and a hysteretic force, driven by a force.

        m y'' + c y' + k y + z[y] = u

    The input is the force u, the output the displacement y. It starts at rest, with y = z = 0. Each sample
    is reached by `substeps` steps of Newmark's average acceleration, of second order, or by the classical
    Runge-Kutta method, of fourth order between the turning points; the force is straight between its
    samples, or held. A part in rate form (`BoucWenForce`, `DuhemForce`) is integrated together with the
    motion, others follow the displacement exactly.

    **Arguments:**

    - `mass`, `damping`, `stiffness`: m > 0, c >= 0 and k.
    - `hysteresis`: any model of a force over a displacement, or a `Sum` of several; also one that depends
      on the velocity.
    - `substeps`: steps of the integration to a sample.
    - `integrator`: `"newmark"` or `"runge-kutta"`.
    - `between`: the force between its samples, `"linear"` or `"held"`.

    Raises `InputError` where the mass is not positive, a choice is unknown, or times are missing.

    Source: Newmark 1959; the plant is that of Noël and Schoukens 2016.

    **Example:**

        >>> spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0, beta_delta=-1100.0)
        >>> plant = hysteresis.Oscillator(mass=2.0, damping=10.0, stiffness=5e4, hysteresis=spring)
        >>> t = np.arange(4) / 750
        >>> (1e6 * plant.displacement(t, [0.0, 40.0, 40.0, 40.0])).round(1).tolist()
        [0.0, 5.9, 40.5, 106.5]
    """

    mass: Scalar = parameter(unit="mass", bounds=(0.0, float("inf")), meaning="mass that moves")
    damping: Scalar = parameter(
        unit="force * time / displacement", bounds=(0.0, float("inf")), meaning="force by velocity"
    )
    stiffness: Scalar = parameter(
        unit="force / displacement", meaning="spring beside the hysteresis"
    )
    hysteresis: AbstractModel  # pyright: ignore[reportGeneralTypeIssues]  (`parameter` has no default here)
    substeps: int = eqx.field(default=20, static=True)
    integrator: str = eqx.field(default="newmark", static=True)
    between: str = eqx.field(default="linear", static=True)
    moved_by_force: ClassVar[bool] = True

    def __check_init__(self) -> None:
        if not isinstance(self.hysteresis, AbstractModel):
            raise InputError(
                "bad-parts", "the hysteresis is not a model.", fix="give a model, or a Sum."
            )
        for name, value, known in (
            ("integrator", self.integrator, ("newmark", "runge-kutta")),
            ("between", self.between, ("linear", "held")),
        ):
            if value not in known:
                raise InputError("bad-option", f"{name}={value!r}; have {', '.join(known)}.")
        if self.substeps < 1:
            raise InputError("bad-option", f"substeps={self.substeps}; at least 1.")
        if is_concrete(self.mass) and not np.all(np.asarray(self.mass) > 0):
            raise InputError(
                "parameter-out-of-bounds",
                f"mass = {self.mass}.",
                cause="without a mass the force sets no acceleration.",
                fix="give a positive mass.",
            )

    @property
    def parts(self) -> tuple[AbstractModel, ...]:
        """The hysteresis, or the parts of its sum."""
        return self.hysteresis.parts if isinstance(self.hysteresis, Sum) else (self.hysteresis,)

    def init(self, t0: Any = None, u0: Any = None) -> OscillatorState:
        zero = jnp.zeros_like(self.mass)
        t = zero * jnp.nan if t0 is None else jnp.asarray(t0, zero.dtype)
        return OscillatorState(t, zero, zero, zero, zero, tuple(part.init() for part in self.parts))

    def displacement(
        self, t: ArrayLike, force: ArrayLike, *, starts: tuple[int, ...] = (0,)
    ) -> Float[np.ndarray, " samples"]:
        """`simulate`, by a compiled loop where the clock is even, Newmark's method and a straight force are
        chosen, and the hysteresis is one part in rate form at most and plays: sixty times as fast."""
        t, u = np.asarray(t, float), np.asarray(force, float)
        if self.integrator == "newmark" and self.between == "linear":
            compiled = Compiled.of(self)
            if compiled is not None:
                found = compiled.over_samples(t, u, starts, self.substeps)
                if found is not None:
                    return found
        return np.asarray(self.simulate(t, u, starts=starts))

    def step(
        self, state: OscillatorState, t: Any, u: Any
    ) -> tuple[OscillatorState, Float[Array, ""]]:
        if t is None:
            raise InputError(
                "no-time",
                "an oscillator needs a clock.",
                fix="give times, in the unit of its parameters.",
            )
        u = jnp.asarray(u, state.force.dtype)
        t = jnp.asarray(t, u.dtype)
        new = jnp.isnan(state.t)
        h = jnp.where(new, 0.0, t - jnp.where(new, t, state.t)) / self.substeps
        # The first sample is where the motion begins: its acceleration alone is found.
        before = self._at_rest(state, u, new)
        push = u if self.between == "held" else None
        if self.between == "held":
            past = jnp.where(new, u, state.force)
            before = before._replace(
                acceleration=before.acceleration + (past - before.force) / self.mass
            )

        def fine(k: Array, at: OscillatorState) -> OscillatorState:
            share = (k + 1.0) / self.substeps
            force: Array = jnp.where(new, u, state.force + (u - state.force) * share)
            force = jnp.where(new, u, state.force) if push is not None else force
            advance = self._newmark if self.integrator == "newmark" else self._runge_kutta
            last = jnp.where(new, u, state.force + (u - state.force) * k / self.substeps)
            last = force if push is not None else last
            clock = jnp.where(new, t, state.t + (t - state.t) * share)
            return advance(at, clock, h, last, force)

        after, _ = jax.lax.scan(
            lambda at, k: (fine(k, at), None),
            before._replace(t=t),
            jnp.arange(self.substeps, dtype=u.dtype),
        )
        after = after._replace(t=t, force=u)
        if self.between == "held":
            jump = (u - jnp.where(new, u, state.force)) / self.mass
            after = after._replace(acceleration=after.acceleration + jump)
        return after, after.displacement

    def laws(self, eps: float, depth: int) -> Tree:
        """Its `find` goes from force to displacement."""
        layout = layout_of(self.hysteresis)
        if layout is None or self.integrator != "newmark" or self.between != "linear":
            raise InputError(
                "not-exportable",
                "this oscillator cannot be exported.",
                cause="its hysteresis is not made of plays and one BoucWenForce (n = 1) or DuhemForce, or"
                " it is not integrated by Newmark's method with a straight force.",
                fix="fit it with identify.fit(record, 'Oscillator').",
            )
        arrays = layout.rate, layout.limit, layout.radii, layout.reach, layout.heights
        rate, limit, radii, reach, heights = map(jnp.asarray, arrays)
        knots, plays = rate.shape[1], len(radii)
        cells, none = np.asarray(layout.counts, float) - 1, np.zeros(max(plays, 1))
        return node(
            "oscillator",
            {
                "substeps": self.substeps, "mass": self.mass, "damping": self.damping,
                "stiffness": self.stiffness, "knots": knots, "limit": limit,
                "per": (knots - 1) / (2 * limit) if knots else 0.0, "rate": rate,
                "plays": plays, "radii": radii, "low": -reach,
                "scale": cells / (2 * reach), "first": layout.first[:-1].astype(float),
                "cells": cells, "heights": heights,
            },
            {
                "begun": 0, "y": 0.0, "v": 0.0, "a": 0.0, "z": 0.0, "force": 0.0, "play": none,
                "next": none, "f": 0.0, "steep": 0.0, "total": 0.0, "stretch": 0.0,
            },
        )  # fmt: skip

    def _at_rest(self, state: OscillatorState, u: Array, new: Array) -> OscillatorState:
        """The state with the acceleration that the first force gives."""
        _, z = self._of_displacement(state.parts, state.t, state.displacement)
        for own in self._rate_forces(state.parts):
            z = z + own
        y, v = state.displacement, state.velocity
        found = (u - self.damping * v - self.stiffness * y - z) / self.mass
        return state._replace(
            acceleration=jnp.where(new, found, state.acceleration),
            force=jnp.where(new, u, state.force),
        )

    def _rate_forces(self, states: tuple[Any, ...]) -> list[Array]:
        pairs = zip(self.parts, states, strict=True)
        return [own.z for part, own in pairs if isinstance(part, AbstractRateForm)]

    def _of_displacement(
        self, states: tuple[Any, ...], t: Any, y: Any
    ) -> tuple[tuple[Any, ...], Array]:
        """States and force at a displacement, of the parts that follow it; the others stay as they are."""
        after, force = [], jnp.zeros_like(y)
        for part, own in zip(self.parts, states, strict=True):
            if not isinstance(part, AbstractRateForm):
                own, z = part.step(own, t, y)
                force = force + z
            after.append(own)
        return tuple(after), force

    def _newmark(
        self, at: OscillatorState, t: Array, h: Array, _: Array, u: Array
    ) -> OscillatorState:
        """One step of average acceleration: Newton's method for the acceleration after it, whose last step
        carries the derivatives."""

        def motion(model: "Oscillator", at: OscillatorState, a1: Array) -> tuple[Array, Array]:
            y1 = at.displacement + h * at.velocity + 0.25 * h * h * (at.acceleration + a1)
            return y1, at.velocity + 0.5 * h * (at.acceleration + a1)

        def off(model: "Oscillator", at: OscillatorState, a1: Array) -> Array:
            y1, v1 = motion(model, at, a1)
            _, z = model._of_displacement(at.parts, t, y1)
            for part, own in zip(model.parts, at.parts, strict=True):
                if isinstance(part, AbstractRateForm):
                    z = z + part.after(own.z, at.velocity, v1, h)
            return model.mass * a1 + model.damping * v1 + model.stiffness * y1 + z - u

        def newton(model: "Oscillator", at: OscillatorState, a1: Any) -> Any:
            error, by_a = jax.jvp(lambda x: off(model, at, x), (a1,), (jnp.ones_like(a1),))
            return a1 - error / jax.lax.stop_gradient(by_a)

        frozen: Any = jax.lax.stop_gradient((self, at))
        a1: Any = frozen[1].acceleration
        for _turn in range(NEWTON_STEPS - 1):
            a1 = jax.lax.stop_gradient(newton(frozen[0], frozen[1], a1))
        a1 = newton(self, at, a1)
        y1, v1 = motion(self, at, a1)
        parts, _ = self._of_displacement(at.parts, t, y1)
        parts = tuple(
            own._replace(u=y1, z=part.after(own.z, at.velocity, v1, h))
            if isinstance(part, AbstractRateForm)
            else own
            for part, own in zip(self.parts, parts, strict=True)
        )
        return at._replace(displacement=y1, velocity=v1, acceleration=a1, parts=parts)

    def _runge_kutta(
        self, at: OscillatorState, t: Array, h: Array, last: Array, u: Array
    ) -> OscillatorState:
        """One step of the classical Runge-Kutta method; parts that follow the displacement are taken from
        their state before the step."""
        rates = [part for part in self.parts if isinstance(part, AbstractRateForm)]

        def slopes(motion: Any, share: float) -> Any:
            y, v, z = motion
            _, force = self._of_displacement(at.parts, t - (1 - share) * h, y)
            for own in z:
                force = force + own
            push = last + (u - last) * share
            a = (push - self.damping * v - self.stiffness * y - force) / self.mass
            return v, a, [v * part.slope(one, v < 0) for part, one in zip(rates, z, strict=True)]

        start = (at.displacement, at.velocity, self._rate_forces(at.parts))
        y1, v1, z1 = runge_kutta(slopes, start, h)
        parts, _ = self._of_displacement(at.parts, t, y1)
        forces = iter(z1)
        parts = tuple(
            own._replace(u=y1, z=next(forces)) if isinstance(part, AbstractRateForm) else own
            for part, own in zip(self.parts, parts, strict=True)
        )
        a1 = slopes((y1, v1, z1), 1.0)[1]
        return at._replace(displacement=y1, velocity=v1, acceleration=a1, parts=parts)
