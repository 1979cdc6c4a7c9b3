"""Indentation of the cover, from its material, local thickness and the frame below it."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, FoamCurve, InputError, LinearSponge, Scalar, parameter
from hysteresis._parameter import PyTree, is_concrete
from hysteresis._quantities import FORCE, LENGTH, TIME, Units, conversion

from .. import _traced as traced
from .._contract import AbstractCompensator, Status
from .._readings import nested
from ..runtime._armor import bump


class AbstractField(eqx.Module):
    """A quantity of the place: field(surface, point) with surface k from 1 and the point P^i in metres."""

    @abc.abstractmethod
    def __call__(self, surface: Int[Array, ""], point: Float[Array, "3"]) -> Float[Array, ""]:
        """The value at one point of one surface."""

    @abc.abstractmethod
    def greatest(self) -> Float[Array, ""]:
        """No value is above this."""


class Uniform(AbstractField):
    """The same all over: one number, or one for every surface."""

    value: Any = parameter(meaning="value of all surfaces, or of each")

    def __call__(self, surface: Int[Array, ""], point: Float[Array, "3"]) -> Float[Array, ""]:
        return _of(self.value, surface)

    def greatest(self) -> Float[Array, ""]:
        return jnp.max(self.value)


class Bumps(AbstractField):
    """A smooth bump about one point of each surface:

        base_k + amplitude_k exp(-|P - centre_k|^2 / (2 width^2))

    Examples are a frame that bends in the middle of each side, and a sheet that is thinner at its rim.

    **Arguments:** `centre` (surfaces, 3), m, e.g. `Box.centres()`; `amplitude` and `base`, one number or
    one for every surface; `width`, m.

    **Example:**

        >>> factor = compensate.armor.Bumps(box.centres(), amplitude=0.2, width=0.05, base=1.0)
        >>> round(float(factor(jnp.array(1), box.centres()[0])), 6)
        1.2
    """

    centre: Float[Array, "surfaces 3"] = parameter(
        unit="m", fixed=True, meaning="middle of each bump"
    )
    amplitude: Any = parameter(meaning="height of each bump")
    width: Scalar = parameter(unit="m", bounds=(0.0, float("inf")), meaning="width of the bumps")
    base: Any = parameter(0.0, meaning="value far from a bump")

    def __call__(self, surface: Int[Array, ""], point: Float[Array, "3"]) -> Float[Array, ""]:
        base, amplitude = _of(self.base, surface), _of(self.amplitude, surface)
        return bump(traced, base, amplitude, self.width, self.centre[surface - 1], point)

    def greatest(self) -> Float[Array, ""]:
        return jnp.max(self.base) + jnp.maximum(jnp.max(self.amplitude), 0)


def _of(value: Array, surface: Array) -> Array:
    """The value at a surface: a scalar as it is, or the entry of that surface."""
    return value[surface - 1] if value.ndim else value


def as_field(given: AbstractField | ArrayLike) -> AbstractField:
    """A field as it is; a number, or one for every surface, becomes `Uniform`."""
    return given if isinstance(given, AbstractField) else Uniform(given)


HARD_PUSH = 20.0
"""N, the paper's largest force: what a cover gives way under it tells its unit."""

LINEAR = 25.0
"""N, up to which the paper measured its sponges as lines: beyond, a line that was typed in is a guess."""

LATER = 60.0
"""s, after which a cover under a constant force is looked at again."""

THINNEST = 1e-4
"""m. A cover that gives way less under a hard push is not soft, or its unit is not what it is taken for."""


class Cover(eqx.Module):
    """A soft cover on a frame that gives way a little:

        d_n = factor(k, P^i) g(F_n) + compliance(k, P^i) F_n          on surface k at the point P^i

    with g the material's displacement under the normal force F_n, with its history.

    **Arguments:**

    - `compensator`: g, from a force to a length: a model fitted with force as input, such as
      `LinearSponge`, or the inverse of one fitted with force as output, `invert(model)`. None: rigid.
    - `factor`: a number or a field, e.g. `Bumps`: what the sheet differs from the sample g was fitted to.
    - `compliance`: of the frame, m/N; a number or a field.
    - `length_unit`, `force_unit`: of g, where it does not carry its units. The model of a fit does, and is
      converted; a `LinearSponge` without units is in mm and N, as its documentation says, and refused
      where a hard push of 20 N makes less than 0.1 mm, which are metres.
    - `thickness`, m: of the cover, beyond which no displacement is possible.

    A contact whose force is beyond those of the fit (`trained` of the model; 25 N for a `LinearSponge` that
    was typed in, the end of the paper's linear range), whose displacement is beyond them or beyond the
    thickness, or that a guarded compensator calls so, is EXTRAPOLATED.

    Raises `InputError` `no-unit` for a material of which nothing tells the units, `wrong-unit` for units
    that contradict those given or cannot be right, `unknown-unit`, and `wrong-direction` for a material
    that gives forces.

    Source: Tsuji 2014, equations (7) and (8), for factor 1 and compliance 0.

    **Example:**

        >>> cover = compensate.armor.Cover(hysteresis.LinearSponge(K=1.298, b=6.186, threshold=1.5))
        >>> round(cover.hard_push(), 4)
        0.0321
    """

    compensator: AbstractModel | AbstractCompensator | None = None
    factor: AbstractField = eqx.field(default=1.0, converter=as_field)
    compliance: AbstractField = eqx.field(default=0.0, converter=as_field)
    length_unit: str | None = eqx.field(default=None, static=True)
    force_unit: str | None = eqx.field(default=None, static=True)
    thickness: Scalar = parameter(
        float("inf"), unit="m", fixed=True, meaning="thickness of the cover"
    )

    def __check_init__(self) -> None:
        if self.is_rigid:
            return
        _check_quantities(self.compensator, self.length_unit, self.force_unit)
        if is_concrete(self.thickness) and not self.thickness > 0:
            raise InputError(
                "parameter-out-of-bounds", f"a thickness of {float(self.thickness):g} m.",
                fix="give a length above 0, in metres.",
            )  # fmt: skip
        if self.length_unit is not None or not all(map(is_concrete, jax.tree.leaves(self))):
            return
        pressed = self.hard_push()
        if not pressed >= THINNEST:
            raise InputError(
                "wrong-unit",
                f"{HARD_PUSH:g} N press this cover in by {1e3 * pressed:.3g} mm.",
                cause="its lengths are metres, or it gives forces and not displacements.",
                fix='length_unit="m"; or invert(model), where the model\'s output is a force.',
            )

    @property
    def scales(self) -> tuple[float, float, float]:
        """What 1 N, 1 unit of displacement in m, and 1 s are for g: (N -> g, g -> m, s -> g)."""
        units: Any = _units_of(self.compensator)
        if units is None or not units.are_known:
            time = "1" if units is None else units.time
            units = Units(self.force_unit or FORCE, self.length_unit or "mm", time)
        of_force, of_length = conversion(FORCE, units.input), conversion(units.output, LENGTH)
        assert of_force is not None
        assert of_length is not None
        return of_force, of_length, conversion(TIME, units.time) or 1.0

    @property
    def is_rigid(self) -> bool:
        return self.compensator is None

    @property
    def is_even(self) -> bool:
        """Whether d_n is the same all over a surface."""
        return isinstance(self.factor, Uniform) and isinstance(self.compliance, Uniform)

    def init(self) -> PyTree:
        """The state of a place that was never touched."""
        return () if self.compensator is None else self.compensator.init()

    def press(
        self, state: PyTree, t: Any, force: Float[Array, ""]
    ) -> tuple[PyTree, Float[Array, ""], Bool[Array, ""]]:
        """The state after a force at the time `t`, s; g(F_n) in metres; whether it is beyond the fit."""
        if self.compensator is None:
            return state, jnp.zeros_like(force), jnp.zeros_like(force, bool)
        of_force, of_length, of_time = self.scales
        own = force * of_force
        found: Any
        state, found = self.compensator.step(state, None if t is None else t * of_time, own)
        beyond, judged = jnp.zeros_like(force, bool), own
        if isinstance(self.compensator, AbstractCompensator):
            beyond, judged = found.status == int(Status.EXTRAPOLATED), found.value
            found = judged
        if (most := self.known_to()) is not None:
            beyond = beyond | (judged > most)
        return state, of_length * found, beyond

    def known_to(self) -> Array | None:
        """The greatest force that the material is known for, of an inverse the displacement; its units."""
        most = most_of(self.compensator)
        if most is None and isinstance(self.compensator, LinearSponge):
            return jnp.asarray(LINEAR * self.scales[0])
        return most

    def displacement(
        self,
        pressed: Float[Array, ""],
        force: Float[Array, ""],
        surface: Int[Array, ""],
        point: Float[Array, "3"],
    ) -> Float[Array, ""]:
        """d_n of a surface at a point, m, from g(F_n) and F_n."""
        local, given = self.factor(surface, point), self.compliance(surface, point)
        return local * pressed + given * force

    def most(self, force: Float[Array, ""]) -> Float[Array, ""]:
        """d_n at most under a normal force, with a quarter more for the history, m."""
        pressed = 1.25 * self.press(self.init(), 0.0, force)[1]
        return self.factor.greatest() * pressed + self.compliance.greatest() * force

    def hard_push(self) -> float:
        """g under 20 N, m."""
        with jax.ensure_compile_time_eval():  # also where a cover is made within a jitted function
            return float(self.press(self.init(), 0.0, jnp.asarray(HARD_PUSH, float))[1])

    def creeps(self) -> bool:
        """Whether a held force presses the cover in further with time, by more than a thousandth."""
        with jax.ensure_compile_time_eval():
            force = jnp.asarray(HARD_PUSH / 2, float)
            state, now, _ = self.press(self.init(), 0.0, force)
            then = self.press(state, LATER, force)[1]
        return abs(float(then - now)) > 1e-3 * abs(float(now))


def _units_of(material: Any) -> Units | None:
    """From what a material is given to what it gives; of a compensator without units, by its model."""
    model = getattr(material, "model", None)
    if material.units is not None or not isinstance(model, AbstractModel):
        return material.units
    return model.units and model.units.reversed


def _check_quantities(material: Any, length_unit: str | None, force_unit: str | None) -> None:
    """Raises `InputError` where a material is not known to give lengths under forces."""
    given = type(material).__name__
    wrong_way = InputError(
        "wrong-direction",
        f"this {given} gives forces, and a cover is asked for its displacement.",
        fix="fit it from force to displacement, or invert(model) of a model of the force;"
        " LinearSponge(K, b) itself, not its inverse.",
    )
    for unit, quantity in ((length_unit, LENGTH), (force_unit, FORCE)):
        if unit is not None and conversion(unit, quantity) is None:
            raise InputError(
                "unknown-unit",
                f"{unit!r} is not a unit of {'length' if quantity == LENGTH else 'force'}.",
                fix='give one such as "mm", "inch", "N" or "kgf".',
            )
    units = _units_of(material)
    if units is not None and units.are_known:
        if conversion(units.input, LENGTH) and conversion(units.output, FORCE):
            raise wrong_way
        force, length = conversion(units.input, FORCE), conversion(units.output, LENGTH)
        if force is None or length is None:
            raise InputError(
                "wrong-unit",
                f"this {given} leads from {units.input} to {units.output}, not from a force to a length.",
                fix="fit a displacement under a force, with their units in the headers.",
            )
        for own, told in ((units.input, force_unit), (units.output, length_unit)):
            if told is not None and conversion(told, own) != 1.0:
                raise InputError(
                    "wrong-unit",
                    f"this {given} carries the unit {own}, and {told} was given.",
                    fix="leave the unit out.",
                )
        return
    inverted = getattr(material, "model", None)
    if isinstance(material, FoamCurve) or isinstance(inverted, LinearSponge):
        raise wrong_way
    if length_unit is None and not isinstance(material, LinearSponge):
        raise InputError(
            "no-unit",
            f"nothing tells the units of this {given}.",
            cause="it was not made by a fit, or its record had no units.",
            fix='fit it with units in the headers, or Cover(model, length_unit="mm", force_unit="N").',
        )


def most_of(material: Any) -> Array | None:
    """The greatest trained input of a model, or of the one that a compensator inverts; None: not known."""
    inside = (
        x if isinstance(x, AbstractModel) else getattr(x, "model", None) for x in nested(material)
    )
    model = next((one for one in inside if isinstance(one, AbstractModel)), None)
    if model is None or model.trained is None:
        return None
    low, high = model.trained[..., 0], model.trained[..., 1]
    return high + 1e-6 * (high - low)  # rounding


Material = Cover | AbstractModel | AbstractCompensator | None
"""What a cover is made of; None is rigid."""


def as_cover(given: Material) -> Cover:
    """A `Cover` as it is; anything else becomes one that is even."""
    return given if isinstance(given, Cover) else Cover(given)
