"""Indentation of the cover, from its material, local thickness and the frame below it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, FoamCurve, InputError, is_concrete
from hysteresis._type_variables import PyTree

from .._contract import AbstractCompensator
from ..inverses._linear_sponge import LinearSpongeCompensator
from ._faces import METRES
from ._fields import AbstractField, Uniform, as_field

HARD_PUSH = 20.0
"""N, the paper's largest force: what a cover gives way under it tells its unit."""

THINNEST = 1e-4
"""m. A cover that gives way less under a hard push is not soft, or its unit is not what it is taken for."""


class Cover(eqx.Module):
    """A soft cover on a frame that gives way a little:

        d_n = factor(k, P^i) g(F_n) + compliance(k, P^i) F_n          on surface k at the point P^i

    with g the material's displacement under the normal force F_n, with its history.

    **Arguments:**

    - `compensator`: g, from N to a length: a model fitted with force as input, such as `LinearSponge`,
      or the inverse of one fitted with force as output, `invert(model)`. None: rigid.
    - `factor`: a number or a field, e.g. `Bumps`: what the sheet differs from the sample g was fitted to.
    - `compliance`: of the frame, m/N; a number or a field.
    - `length_unit`: of g. By default millimetres, and then refused where a hard push of 20 N makes less
      than 0.1 mm, which are metres.

    Raises `InputError` for a unit that is not a length's, or one that cannot be right, and for a curve that
    gives forces.

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

    def __check_init__(self) -> None:
        if (self.length_unit or "mm") not in METRES:
            raise InputError(
                "unknown-unit",
                f"the cover's length unit {self.length_unit!r} is unknown.",
                fix=f"give one of {', '.join(METRES)}.",
            )
        if isinstance(self.compensator, LinearSpongeCompensator | FoamCurve):
            given = type(self.compensator).__name__
            raise InputError(
                "wrong-direction",
                f"a {given} gives forces, and a cover is asked for its displacement.",
                fix="LinearSponge(K, b) itself; invert(FoamCurve(...)).",
            )
        leaves = jax.tree.leaves(self)
        if self.length_unit is None and all(map(is_concrete, leaves)) and not self.is_rigid:
            self._check_unit()

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
        self, state: PyTree, t: ArrayLike | None, force: Float[Array, ""]
    ) -> tuple[PyTree, Float[Array, ""]]:
        """g(F_n) in metres, at the time `t`, and the state after it."""
        if self.compensator is None:
            return state, jnp.zeros_like(force)
        found: Any
        state, found = self.compensator.step(state, t, force)
        if isinstance(self.compensator, AbstractCompensator):
            found = found.value
        return state, METRES[self.length_unit or "mm"] * found

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

    def _check_unit(self) -> None:
        pressed = self.hard_push()
        if not pressed >= THINNEST:
            raise InputError(
                "wrong-unit",
                f"{HARD_PUSH:g} N press this cover in by {1e3 * pressed:.3g} mm.",
                cause="its lengths are metres, or it gives forces and not displacements.",
                fix='length_unit="m"; or invert(model), where the model\'s output is a force.',
            )


Material = Cover | AbstractModel | AbstractCompensator | None
"""What a cover is made of; None is rigid."""


def as_cover(given: Material) -> Cover:
    """A `Cover` as it is; anything else becomes one that is even."""
    return given if isinstance(given, Cover) else Cover(given)
