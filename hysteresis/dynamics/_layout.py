"""The parts of a hysteresis as the arrays that the law of an oscillator takes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._model import AbstractModel, Tree
from .._parameter import array_module, is_concrete
from ..models._compose import Sum
from ..models._viscoelastic_chain import Known
from ..running import Numbers, place_of
from ..trees import node
from ._generalized_plays import GeneralizedPlays, curves_of
from ._rate_form import BoucWenForce, DuhemForce

MOTION = ("y", "v", "z")
"""Of the law's state: displacement, velocity and force in rate form."""


@dataclass
class Layout:
    """Knots of f+ and f-, and plays with the knots of their curves, with all heights in one array.

    Arrays are NumPy's where the parameters are known.

    - `rate`: (2, knots), of no knot where there is no part in rate form. `limit`: the outermost of them.
    - `radii`, `reach`: (plays,). `counts`: (plays,) knots of each curve. `heights`: of all curves.
    """

    rate: Float[Known, "2 knots"] = field(default_factory=lambda: np.zeros((2, 0)))
    limit: Any = 1.0
    radii: Float[Known, " plays"] = field(default_factory=lambda: np.zeros(0))
    reach: Float[Known, " plays"] = field(default_factory=lambda: np.zeros(0))
    counts: Any = field(default_factory=lambda: np.zeros(0, np.int64))
    heights: Float[Known, " heights"] = field(default_factory=lambda: np.zeros(0))

    @property
    def first(self) -> np.ndarray:
        """The first height of each play, and the end."""
        return np.concatenate([[0], np.cumsum(self.counts)]).astype(np.int64)

    def tree(self, plant: Sequence[Any], substeps: int) -> Tree:
        """The law of a mass, damping and stiffness around it, at rest."""
        mass, damping, stiffness = plant
        knots, plays = self.rate.shape[1], len(self.radii)
        return node(
            "oscillator",
            {
                "substeps": substeps, "mass": mass, "damping": damping, "stiffness": stiffness,
                "knots": knots, "limit": self.limit,
                "per": (knots - 1) / (2 * self.limit) if knots else 0.0,
                "rate": jnp.asarray(self.rate),
                **curves_of(self.radii, self.reach, self.counts, self.heights),
            },
            {
                "begun": 0, "y": 0.0, "v": 0.0, "a": 0.0, "z": 0.0, "force": 0.0,
                "play": np.zeros(max(plays, 1)), "f": 0.0, "steep": 0.0, "total": 0.0, "stretch": 0.0,
            },
        )  # fmt: skip


def layout_of(model: AbstractModel) -> Layout | None:
    """The arrays of a hysteresis of one part in rate form at most and any plays; None of others."""
    parts = model.parts if isinstance(model, Sum) else (model,)
    found, xp = Layout(), array_module(*jax.tree.leaves(model))
    for part in parts:
        if isinstance(part, BoucWenForce | DuhemForce):
            rate = _rate_of(part, xp)
            if rate is None or found.rate.size:
                return None
            found.rate, found.limit = rate
        elif isinstance(part, GeneralizedPlays):
            found.radii = xp.append(found.radii, xp.asarray(part.radii, float))
            found.reach = xp.append(found.reach, xp.asarray(part.reach, float))
            found.counts = np.append(found.counts, part.knots).astype(np.int64)
            found.heights = xp.append(found.heights, xp.asarray(part.values, float))
        else:
            return None
    return found


def _rate_of(part: BoucWenForce | DuhemForce, xp: Any) -> tuple[Any, Any] | None:
    """Values at knots and the outermost knot; None where f is not straight between knots, and NaN where
    that is not known yet."""
    if isinstance(part, DuhemForce):
        both = xp.stack([xp.asarray(part.rising, float), xp.asarray(part.falling, float)])
        return both, float(part.limit) if xp is np else part.limit
    if is_concrete(part.n) and float(part.n) != 1.0:
        return None
    a, g, d = (xp.asarray(x, float) for x in (part.alpha, part.beta_gamma, part.beta_delta))
    rate = xp.array([[a + g - d, a, a - g - d], [a - g - d, a, a + g - d]])
    return rate if is_concrete(part.n) else jnp.where(part.n == 1.0, rate, jnp.nan), 1.0


def before_first(numbers: Numbers, motion: Any = ()) -> Float[np.ndarray, " state"]:
    """The state at the end of the law's numbers as one before a first sample, where the acceleration is to
    be found; with another `motion`: displacement, velocity and force in rate form."""
    known, m = numbers.known, np.array(numbers.m, float)
    m[place_of(known, "begun")] = 0.0
    for name, value in zip(MOTION, motion, strict=False):
        m[place_of(known, name)] = value
    return m[len(m) - known.states :]
