"""Generalised Prandtl-Ishlinskii operator: a curve of every play."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import NOT_NEGATIVE, POSITIVE, as_float, check_shapes, parameter
from .._registry import register
from ..trees import node


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
