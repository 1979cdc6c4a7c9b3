"""A mass on a spring, a damper and a hysteretic force."""

from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from .._errors import InputError
from .._law_model import AbstractLawModel, LawInput, LawState
from .._model import AbstractModel, Series, Tree
from .._once import once
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..models._compose import Sum
from ..running import place_of
from ._layout import before_first, layout_of


class OscillatorLaw(AbstractLawModel):
    """Newmark's step of a straight force, by `hysteresis/laws/oscillator.py`.

    - `plant`: mass, damping and stiffness.
    """

    plant: tuple[Scalar, Scalar, Scalar]
    hysteresis: AbstractModel
    substeps: int = eqx.field(static=True)

    needs_time = True

    def laws(self, eps: float, depth: int) -> Tree:
        """Its `find` goes from force to displacement."""
        layout = layout_of(self.hysteresis)
        assert layout is not None
        arrays = (jnp.asarray(x) for x in (layout.limit, layout.radii, layout.reach))
        free = dict(zip(("limit", "radii", "reach"), arrays, strict=True))
        return replace(layout, **free).tree(self.plant, self.substeps)


@register
class Oscillator(AbstractModel[LawState, LawInput]):
    """A mass on a spring, a damper and a hysteretic force, driven by a force.

        m y'' + c y' + k y + z[y] = u

    The input is the force u, the output the displacement y. It starts at rest, with y = z = 0. Each sample
    is reached by `substeps` steps of Newmark's average acceleration, of second order; the force is straight
    between its samples, or held. A part in rate form is integrated together with the motion, plays follow
    the displacement exactly.

    **Arguments:**

    - `mass`, `damping`, `stiffness`: m > 0, c >= 0 and k.
    - `hysteresis`: a `BoucWenForce` of n = 1, a `DuhemForce`, `GeneralizedPlays`, or a `Sum` of plays and
      at most one of the others. `Feedback.of_masses` takes any model.
    - `substeps`: steps of the integration to a sample.
    - `between`: the force between its samples, `"linear"` or `"held"`.

    Raises `InputError` where the mass is not positive, the hysteresis is made of something else, a choice
    is unknown, or times are missing.

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
    between: str = eqx.field(default="linear", static=True)
    moved_by_force: ClassVar[bool] = True
    GONE: ClassVar[dict[str, str]] = {"integrator": "newmark"}

    def __check_init__(self) -> None:
        if not isinstance(self.hysteresis, AbstractModel) or layout_of(self.hysteresis) is None:
            raise InputError(
                "bad-parts",
                "the hysteresis is not made of plays and one force in rate form.",
                fix="give GeneralizedPlays, a BoucWenForce of n = 1 or a DuhemForce, or a Sum;"
                " Feedback.of_masses takes any model.",
            )
        if self.between not in ("linear", "held"):
            raise InputError("bad-option", f"between={self.between!r}; have linear, held.")
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

    def init(self, t0: Any = None, u0: Any = None) -> LawState:
        return self._law.init(t0, u0)

    def moving(self, displacement: float, velocity: float, force: float = 0.0) -> LawState:
        """The state before a first sample that finds the mass in motion, with this `force` in rate form."""
        now = before_first(self._law._numbers, (displacement, velocity, force))
        return self.init()._replace(numbers=jnp.asarray(now))

    def displacement(
        self, t: ArrayLike, force: ArrayLike, *, starts: tuple[int, ...] = (0,)
    ) -> Float[np.ndarray, " samples"]:
        """`simulate`, by NumPy."""
        return np.asarray(self.simulate(np.asarray(t, float), np.asarray(force), starts=starts))

    def step(self, state: LawState, t: Any, u: Any) -> tuple[LawState, Float[Array, ""]]:
        law = self._law
        if self.between == "held" and t is not None:
            before = jnp.where(jnp.isnan(state.t), jnp.asarray(u, float), self._force(state))
            state, _ = law.step(state, t, before)
        return law.step(state, t, u)

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: LawState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> LawInput:
        state = self.init() if state is None else state
        t, u, starts = self._rows(t, u, state, starts)
        return self._law.prepare(t, u, state, starts=starts)

    def evaluate(self, prepared: LawInput) -> Float[Array, " samples"]:
        found = self._law.evaluate(prepared)
        return found[::2] if self.between == "held" else found

    def follow(
        self, t: Series | None, u: Series, state: LawState | None = None
    ) -> tuple[LawState, Float[Array, " samples"]]:
        """All samples at once: (state after the last one, outputs)."""
        state = self.init() if state is None else state
        t, u, _ = self._rows(t, u, state, (0,))
        after, found = self._law.stream(t, u, state)
        return after, found[::2] if self.between == "held" else found

    def _rows(
        self, t: Any, u: Any, state: LawState, starts: tuple[int, ...]
    ) -> tuple[Any, Any, tuple[int, ...]]:
        """What is run: a held force is straight up to each sample, as it was at the one before, and another
        row after no time has the new one."""
        if self.between != "held" or t is None:
            return t, u, starts
        u, first = jnp.asarray(u, float), np.asarray(starts)
        begin = jnp.where(jnp.isnan(state.t), u[first], self._force(state))
        before = jnp.concatenate([u[:1], u[:-1]]).at[first].set(begin)
        both = jnp.stack([before, u], 1).ravel()
        return jnp.repeat(jnp.asarray(t), 2), both, tuple((2 * first).tolist())

    def _force(self, state: LawState) -> Array:
        """That of the last sample."""
        known, m = self._law._numbers
        return state.numbers[place_of(known, "force") - len(m)]

    @once
    def _law(self) -> OscillatorLaw:
        plant = self.mass, self.damping, self.stiffness
        return OscillatorLaw(plant, self.hysteresis, self.substeps)

    def laws(self, eps: float, depth: int) -> Tree:
        """Its `find` goes from force to displacement."""
        if self.between != "linear":
            raise InputError(
                "not-exportable",
                "this oscillator cannot be exported.",
                cause="its force is held between samples.",
                fix="give between='linear'.",
            )
        return self._law.laws(eps, depth)
