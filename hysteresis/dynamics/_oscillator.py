"""A mass on a spring, a damper and a hysteretic force."""

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._errors import InputError
from .._law_model import AbstractLawModel, LawState
from .._model import AbstractModel, Tree
from .._parameter import POSITIVE, Scalar, parameter
from .._registry import register
from ..models._compose import Sum
from ..running import Numbers, place_of
from ..trees import node
from ._generalized_plays import GeneralizedPlays
from ._rate_form import BoucWenForce, DuhemForce

MOTION = ("y", "v", "z")
"""Of the law's state: displacement, velocity and force in rate form."""


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

    mass: Scalar = parameter(unit="mass", **POSITIVE, meaning="mass that moves")
    damping: Scalar = parameter(
        unit="force * time / displacement",
        bounds=(0.0, float("inf")),
        at=None,
        meaning="force by velocity",
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
        if not isinstance(self.hysteresis, AbstractModel) or forces_of(self.hysteresis) is None:
            raise InputError(
                "bad-parts",
                "the hysteresis is not made of plays and one force in rate form.",
                fix="give GeneralizedPlays, a BoucWenForce of n = 1 or a DuhemForce, or a Sum;"
                " Feedback.of_masses takes any model.",
            )
        if self.substeps < 1:
            raise InputError("bad-option", f"substeps={self.substeps}; at least 1.")

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
        forces = forces_of(self.hysteresis)
        assert forces is not None
        return law_of((self.mass, self.damping, self.stiffness), *forces, self.substeps)


def forces_of(model: AbstractModel) -> tuple[DuhemForce | None, GeneralizedPlays] | None:
    """Of a hysteresis of one part in rate form at most and any plays: both. None of others."""
    parts = model.parts if isinstance(model, Sum) else (model,)
    parts = [one.with_knots if isinstance(one, BoucWenForce) else one for one in parts]
    plays = [one for one in parts if isinstance(one, GeneralizedPlays)]
    rates = [one for one in parts if isinstance(one, DuhemForce)]
    if len(rates) > 1 or len(rates) + len(plays) < len(parts):
        return None
    return (rates or [None])[0], GeneralizedPlays.joined(plays)


def law_of(
    plant: Sequence[Any], rate: DuhemForce | None, plays: GeneralizedPlays, substeps: int
) -> Tree:
    """The law of a mass, damping and stiffness around them, at rest."""
    none = {"knots": 0, "limit": 1.0, "per": 0.0, "rate": np.zeros(0)}
    slopes = none if rate is None else {**rate.slopes(), "limit": jnp.asarray(rate.limit)}
    given = dict(zip(("mass", "damping", "stiffness"), plant, strict=True))
    state = dict.fromkeys((*MOTION, "a", "force", "f", "steep", "total", "stretch"), 0.0)
    return node(
        "oscillator",
        {"substeps": substeps, **given, **slopes, **plays.curves()},
        {"begun": 0, **state, "play": np.zeros(max(len(plays.knots), 1))},
    )


def before_first(numbers: Numbers, motion: Any = ()) -> Float[np.ndarray, " state"]:
    """The state at the end of the law's numbers as one before a first sample, where the acceleration is to
    be found; with another `motion`: displacement, velocity and force in rate form."""
    known, m = numbers.known, np.array(numbers.m, float)
    m[place_of(known, "begun")] = 0.0
    for name, value in zip(MOTION, motion, strict=False):
        m[place_of(known, name)] = value
    return m[len(m) - known.states :]
