"""A mass on a spring, a damper and a hysteretic force."""

from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._errors import InputError
from .._law_model import AbstractLawModel, LawState
from .._model import AbstractModel, Tree
from .._parameter import Scalar, is_concrete, parameter
from .._registry import register
from ..models._compose import Sum
from ._layout import before_first, layout_of


@register
class Oscillator(AbstractLawModel):
    """A mass on a spring, a damper and a hysteretic force, driven by a force.

        m y'' + c y' + k y + z[y] = u

    The input is the force u, the output the displacement y. It starts at rest, with y = z = 0. Each sample
    is reached by `substeps` steps of Newmark's average acceleration, of second order; the force is straight
    between its samples. A part in rate form is integrated together with the motion, plays follow
    the displacement exactly.

    **Arguments:**

    - `mass`, `damping`, `stiffness`: m > 0, c >= 0 and k.
    - `hysteresis`: a `BoucWenForce` of n = 1, a `DuhemForce`, `GeneralizedPlays`, or a `Sum` of plays and
      at most one of the others. `Feedback.of_masses` takes any model.
    - `substeps`: steps of the integration to a sample.

    Raises `InputError` where the mass is not positive, the hysteresis is made of something else, there is
    no step, or times are missing.

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
    needs_time = True
    moved_by_force: ClassVar[bool] = True
    GONE: ClassVar[dict[str, str]] = {"integrator": "newmark", "between": "linear"}

    def __check_init__(self) -> None:
        if not isinstance(self.hysteresis, AbstractModel) or layout_of(self.hysteresis) is None:
            raise InputError(
                "bad-parts",
                "the hysteresis is not made of plays and one force in rate form.",
                fix="give GeneralizedPlays, a BoucWenForce of n = 1 or a DuhemForce, or a Sum;"
                " Feedback.of_masses takes any model.",
            )
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

    def moving(self, displacement: float, velocity: float, force: float = 0.0) -> LawState:
        """The state before a first sample that finds the mass in motion, with this `force` in rate form."""
        now = before_first(self._numbers, (displacement, velocity, force))
        return self.init()._replace(numbers=jnp.asarray(now))

    def displacement(
        self, t: ArrayLike, force: ArrayLike, *, starts: tuple[int, ...] = (0,)
    ) -> Float[np.ndarray, " samples"]:
        """`simulate`, by NumPy."""
        return np.asarray(self.simulate(np.asarray(t, float), np.asarray(force), starts=starts))

    def laws(self, eps: float, depth: int) -> Tree:
        """Its `find` goes from force to displacement."""
        layout = layout_of(self.hysteresis)
        assert layout is not None
        arrays = (jnp.asarray(x) for x in (layout.limit, layout.radii, layout.reach))
        free = dict(zip(("limit", "radii", "reach"), arrays, strict=True))
        plant = self.mass, self.damping, self.stiffness
        return replace(layout, **free).tree(plant, self.substeps)
