"""A mass on a spring, a damper and a hysteretic force."""

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from .._errors import InputError
from .._law_model import AbstractLawModel, LawState
from .._model import AbstractModel, Tree
from .._parameter import (
    NOT_NEGATIVE,
    POSITIVE,
    Scalar,
    as_float,
    check_shapes,
    is_concrete,
    parameter,
)
from .._registry import register
from ..models._compose import Sum
from ..running import Numbers, place_of
from ..trees import node

# Hysteretic forces in rate form: of one state, whose rate goes with the velocity.

STEPS = 4
"""Of the Runge-Kutta method to a sample."""


def _law(**parameters: Any) -> Tree:
    table = {"knots": 0, "per": 0.0, "rate": np.zeros(2)}
    powers = {"alpha": 0.0, "gamma": 0.0, "delta": 0.0, "n": 1.0}
    known = {"steps": STEPS, **table, **powers} | parameters
    return node("rate_form", known, {"u": 0.0, "z": 0.0})


@register
class BoucWenForce(AbstractLawModel):
    """Bouc-Wen's hysteretic force in its original form, also of mixed sign.

        z' = alpha v - beta_gamma |v| |z|^(n-1) z - beta_delta v |z|^n

    v is the velocity of the input and z = 0 at the start. `BoucWen` is the normal form, whose z is
    bounded; here the coefficients may have either sign, so that z may also stiffen. Data show only the
    products beta gamma and beta delta.

    **Arguments:**

    - `alpha`: stiffness of z at z = 0.
    - `beta_gamma`, `beta_delta`: how it changes with |z|, while |z| falls and rises alike, and of opposite
      sign.
    - `n`: exponent, at least 0.5. A fit keeps it.

    Raises `InputError` where alpha <= 0 or n < 0.5.

    Source: Bouc 1967, Wen 1976; with these names Noël and Schoukens 2016.

    **Example:**

        >>> spring = hysteresis.BoucWenForce(alpha=2.0, beta_gamma=1.0, beta_delta=1.0)
        >>> np.asarray(spring.simulate(None, np.array([0.0, 0.5, 0.0]))).round(2).tolist()
        [0.0, 0.63, -0.31]
    """

    alpha: Scalar = parameter(unit="output / input", **POSITIVE, meaning="stiffness at z = 0")
    beta_gamma: Scalar = parameter(0.0, unit="1 / input", meaning="loss of stiffness by |v| z")
    beta_delta: Scalar = parameter(0.0, unit="1 / input", meaning="loss of stiffness by v |z|")
    n: Scalar = parameter(
        1.0, bounds=(0.5, float("inf")), at="low", fixed=True, meaning="exponent of |z|"
    )

    @property
    def with_knots(self) -> "DuhemForce | None":
        """The same by slopes at three knots: None where n is not 1, and NaN where n is not known yet."""
        if is_concrete(self.n) and float(self.n) != 1.0:
            return None
        a, g, d = (jnp.asarray(x, float) for x in (self.alpha, self.beta_gamma, self.beta_delta))
        rising = jnp.where(self.n == 1.0, jnp.stack([a + g - d, a, a - g - d]), jnp.nan)
        return DuhemForce(rising, jnp.stack([a - g - d, a, a + g - d]))

    def laws(self, eps: float, depth: int) -> Tree:
        return _law(alpha=self.alpha, gamma=self.beta_gamma, delta=self.beta_delta, n=self.n)


@register
class DuhemForce(AbstractLawModel):
    """Duhem operator: the slope of the force depends on the force and on the direction of motion.

        dz = rising(z) du  while u rises,     dz = falling(z) du  while u falls

    with straight lines between the values at even knots from -limit to limit, and on beyond them; z = 0 at
    the start. Bouc-Wen with n = 1 is one with three knots.

    **Arguments:**

    - `rising`, `falling`: slopes (knots,) at the knots; an odd number of at least 3, so that one is at 0.
    - `limit`: the outermost knot.

    Raises `InputError` for another number of knots, two different ones, or a limit that is not positive.

    Source: Duhem 1897; Macki, Nistri and Zecca 1993.

    **Example:**

        >>> friction = hysteresis.DuhemForce(rising=[2.0, 1.0, 0.0], falling=[0.0, 1.0, 2.0], limit=1.0)
        >>> np.asarray(friction.simulate(None, np.array([0.0, 1.0, 0.0]))).round(2).tolist()
        [0.0, 0.63, -0.4]
    """

    rising: Any = parameter(unit="output / input", meaning="slope while the input rises")
    falling: Any = parameter(unit="output / input", meaning="slope while it falls")
    limit: Scalar = parameter(1.0, unit="output", **POSITIVE, fixed=True, meaning="last knot")

    def __check_init__(self) -> None:
        shapes = jnp.shape(self.rising), jnp.shape(self.falling)
        count = shapes[0][-1] if shapes[0] else 0
        if shapes[0] != shapes[1] or count < 3 or count % 2 == 0:
            said = f"slopes of shapes {shapes[0]} and {shapes[1]}."
            mend = "give as many rising as falling slopes, an odd number of at least 3."
            raise InputError("length-mismatch", said, fix=mend)

    def laws(self, eps: float, depth: int) -> Tree:
        return _law(**self.slopes())

    def slopes(self) -> Tree:
        """As a law knows them."""
        knots = self.rising.shape[-1]
        rate = jnp.concatenate([jnp.asarray(x) for x in (self.rising, self.falling)])
        return {"knots": knots, "per": (knots - 1) / (2 * self.limit), "rate": rate}


# Generalised Prandtl-Ishlinskii operator: a curve of every play.


@register
class GeneralizedPlays(AbstractLawModel):
    """Generalised Prandtl-Ishlinskii operator: a sum of curves, each of the play of one radius.

        y = sum of g_j(p_j),     p_j the play of radius r_j of the input

    g_j is straight between its values at even knots from -reach_j to reach_j, and on beyond them. Straight
    curves of falling slope beside a spring are stops, an Iwan model; with bent curves it approximates a
    Preisach operator whose density is continuous. Every play starts at 0.

    **Arguments:**

    - `radii`: (plays,), not negative.
    - `reach`: (plays,), positive.
    - `values`: (plays, knots), at least two knots; or those of one play after the other, with the number of
      `knots` of each.

    Raises `InputError` where their shapes differ or an entry is out of bounds.

    Source: Al Janaideh, Rakheja and Su 2011; Krasnosel'skii and Pokrovskii 1989.

    **Example:**

        >>> plays = hysteresis.GeneralizedPlays([0.0, 1.0], [2.0, 2.0], [[-2.0, 2.0], [1.0, -1.0]])
        >>> np.asarray(plays.simulate(None, np.array([0.0, 2.0, 1.0]))).tolist()
        [0.0, 1.5, 0.5]
    """

    radii: Float[Array, " plays"] = parameter(
        unit="input", **NOT_NEGATIVE, fixed=True, meaning="radii of the plays"
    )
    reach: Float[Array, " plays"] = parameter(
        unit="input", **POSITIVE, fixed=True, meaning="outermost knots"
    )
    values: Float[Array, " values"] = parameter(unit="output", meaning="curves of the plays")
    knots: tuple[int, ...] = eqx.field(static=True, default=())

    def __init__(self, radii: Any, reach: Any, values: Any, knots: Sequence[int] | None = None):
        self.radii, self.reach = as_float(radii), as_float(reach)
        values = as_float(values)
        if knots is None:
            knots = (values.shape[-1],) * len(values) if values.ndim == 2 else ()
        self.values, self.knots = values.reshape(-1), tuple(int(k) for k in knots)

    def __check_init__(self) -> None:
        check_shapes(
            0, False, knots=(self.knots, "plays"), radii=(self.radii, "plays"),
            reach=(self.reach, "plays"), values=(self.values, f"{sum(self.knots)}"),
        )  # fmt: skip
        if min(self.knots, default=2) < 2:
            mend = "give two values or more of each play."
            raise InputError("length-mismatch", f"knots are {self.knots}.", fix=mend)

    @classmethod
    def joined(cls, plays: Sequence["GeneralizedPlays"]) -> "GeneralizedPlays":
        """The sum of several, or of none."""
        radii, reach, values = (
            jnp.concatenate([jnp.zeros(0), *(getattr(one, name) for one in plays)])
            for name in ("radii", "reach", "values")
        )
        return cls(radii, reach, values, [k for one in plays for k in one.knots])

    @property
    def first(self) -> np.ndarray:
        """The first value of each play, and the end."""
        return np.cumsum([0, *self.knots])

    def laws(self, eps: float, depth: int) -> Tree:
        state = {"u": 0.0, "play": np.zeros(len(self.knots))}
        return node("curves_of_plays", self.curves(), state)

    def curves(self) -> Tree:
        """As a law knows them."""
        knots = np.asarray(self.knots, float)
        return {
            "plays": len(knots), "radii": self.radii, "low": -self.reach,
            "scale": (knots - 1) / (2 * self.reach), "first": np.cumsum(knots) - knots,
            "cells": knots - 1, "heights": self.values,
        }  # fmt: skip


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
