"""Stop and play operators whose stiffness depends on where the input was, or how far it has ever gone."""

from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import Tree
from .._parameter import (
    NOT_NEGATIVE,
    POSITIVE,
    Scalar,
    check_increasing,
    check_range,
    check_shapes,
    parameter,
)
from .._registry import register
from ..trees import AbstractSearchedModel, node

Modulator = Literal["position", "span"]
Values = Float[Array, "..."] | Any


@register
class ModulatedStops(AbstractSearchedModel):
    """Stop and play operators in parallel whose stiffnesses change with the past of the input:

        y_t = offset + sum_k h_k(m_(t-1)) f_k,t,
        f_k,t = e_k (u_t - rest) + sum_j (w_jk (s_j,t - s_(j-1),t) + p_jk z_j,t),
        s_j,t = clip(s_j,t-1 + u_t - u_(t-1), -r_j, r_j),   s_0 = 0,   z_j,t = u_t - rest - s_j,t

    A stop s_j is a spring in series with a slider that gives way at +-r_j (Jenkin element; in parallel, an
    Iwan model). Those of the smaller thresholds slide first, so that the branch after a reversal has the
    slope w_jk where the input has gone from 2 r_(j-1) to 2 r_j. Slopes that fall make a common yielding
    branch, of stops with the stiffnesses w_jk - w_(j+1)k; a flat stretch before a steep one is a backlash.
    A play z_j stands still until the input has gone 2 r_j from the reversal: stops lead their input, plays
    lag it. h_k are hat functions on `levels` of the modulator m: each is 1 at its level and 0 at the
    others, and they add up to 1. m_(t-1) is the input before, `by="position"`, so that friction and
    stiffness depend on the place; or the range that the input has covered until then, `by="span"`, so that
    a joint, a foam or a magnet stiffens or softens with the largest amplitude so far. As m does not know
    the present input, y rises with it, and has an inverse.

    **Arguments:**

    - `low`, `high`: the range of the input.
    - `thresholds`: (J,) the r_j, positive and increasing, in the unit of the input.
    - `levels`: (K,) of the modulator, increasing; beyond them the end ones count.
    - `slopes`: (J, K) w_jk, none negative. `springs`: (K,) e_k, none negative.
    - `offset`: the output's constant.
    - `rest`: where the input is before the first sample, and no stop is strained.
    - `by`: "position" or "span".
    - `plays`: (J, K) p_jk, none negative; None for no plays.

    Raises `InputError` where an argument does not meet these conditions.

    Source: Iwan, J. Appl. Mech. 33 (1966); stops whose sum only has to rise: Krejci and Kuhnen, IEE Proc.
    Control Theory Appl. 148 (2001); a stiffness that follows the largest amplitude: Clough and
    Johnston (1966), Ogden and Roxburgh (1999).

    **Example:**

        >>> stops = hysteresis.ModulatedStops(
        ...     -2.0, 2.0, np.array([1.0]), np.array([0.0, 4.0]), np.array([[1.0, 0.5]]), np.zeros(2)
        ... )
        >>> stops.simulate(None, np.array([0.5, 2.0, 1.0])).tolist()
        [0.5, 0.9375, 0.0]
    """

    low: float = eqx.field(static=True, converter=float)
    high: float = eqx.field(static=True, converter=float)
    thresholds: Values = parameter(
        unit="input", **POSITIVE, fixed=True, meaning="strain at which a stop slides"
    )
    levels: Values = parameter(unit="input", fixed=True, meaning="where the modulator has its hats")
    slopes: Values = parameter(
        unit="output / input", **NOT_NEGATIVE, meaning="slope after a reversal"
    )
    springs: Values = parameter(
        unit="output / input", **NOT_NEGATIVE, meaning="stiffness beside them"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    rest: float = eqx.field(default=0.0, static=True, converter=float)
    by: Modulator = eqx.field(default="span", static=True)
    plays: Values | None = parameter(
        None, unit="output / input", **NOT_NEGATIVE, meaning="slope of a moving play"
    )

    def __check_init__(self) -> None:
        check_range("the input reaches", self.low, self.high)
        if self.by not in ("position", "span"):
            raise InputError("bad-option", f"by={self.by!r}.", fix="give position or span.")
        check_shapes(
            thresholds=(self.thresholds, "J"), levels=(self.levels, "K"), slopes=(self.slopes, "J K"),
            springs=(self.springs, "K"), plays=(self.plays, "J K"),
        )  # fmt: skip
        for name in ("thresholds", "levels"):
            check_increasing(name, getattr(self, name))

    def forwards(self) -> Tree:
        slopes, springs = self.of_stops()
        n, rest = len(self.thresholds), self.rest
        return node(
            "stops",
            {
                "stops": n, "count": len(self.levels), "thresholds": self.thresholds,
                "levels": self.levels, "slopes": slopes, "springs": springs, "offset": self.offset,
                "rest": rest, "by_position": self.by == "position",
            },
            {
                "u": rest, "least": rest, "largest": rest, "z": np.full(n, rest), "level": -1.0,
                "spring": 0.0, "weights": np.zeros(n),
            },
        )  # fmt: skip

    def of_stops(self) -> tuple[Float[Array, "thresholds levels"], Float[Array, " levels"]]:
        """Slopes and springs that stand for the plays, too: a play is a spring less a stop.

        Such a slope may be negative, but never by more than the spring beside it.
        """
        slopes, springs = jnp.asarray(self.slopes), jnp.asarray(self.springs)
        if self.plays is None:
            return slopes, springs
        plays = jnp.asarray(self.plays)
        return slopes - jnp.cumsum(plays[::-1], 0)[::-1], springs + plays.sum(0)
