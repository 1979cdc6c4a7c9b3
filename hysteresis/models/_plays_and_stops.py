"""The Prandtl-Ishlinskii model: play operators, bent and rate-dependent where asked for."""

from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._law_model import AbstractLawModel
from .._model import Tree
from .._parameter import (
    NOT_NEGATIVE,
    POSITIVE,
    Scalar,
    check_increasing,
    check_range,
    check_shapes,
    is_concrete,
    parameter,
    parameters,
)
from .._registry import register
from ..trees import AbstractSearchedModel, node, polygon, series

Values = Float[Array, " _"] | Any
"""A one-dimensional parameter: given as numbers, kept as an array."""


@register
class PrandtlIshlinskii(AbstractLawModel):
    """Prandtl-Ishlinskii model: a line and a weighted sum of play operators.

        y = offset + S(slope u + sum_i w_i z_i),     z_i <- clip(z_i, u - r_i, u + r_i)

    z_i = 0 at the start, and play i follows the input with a backlash of +-r_i. The loops are those of
    a Preisach model whose density depends on alpha - beta alone, over the whole range of the input:
    they are symmetric and congruent, and a larger loop wipes out those inside it. There are two
    extensions, which can be combined:

    - modified: S(x) = x + sum_j s_j max(x - d_j, 0) over d_j >= 0 + sum_j s_j min(x - d_j, 0) over
      d_j < 0 bends the output, which makes loops asymmetric and lets them saturate;
    - rate-dependent: thresholds r_i + c_i |du/dt|, the speed being that of the interval which ended
      at the *previous* sample (0 at first). So the thresholds of a step are known before its input, and
      its inverse is explicit.

    **Arguments:**

    - `thresholds`: (n,) r_i, positive and increasing.
    - `weights`: (n,) w_i, none negative.
    - `slope`: of the line, positive.
    - `offset`: the output's constant.

    **Other arguments:**

    - `rates`: (n,) c_i, none negative. None: the output does not depend on the rate.
    - `bends`, `bend_slopes`: (m,) d_j, increasing, and s_j. S must rise everywhere: 1 plus the sum of s_j
      over all bends passed on the way from 0 is positive. None: S(x) = x.
    - `leading`: stop operators, sum_i w_i (u - z_i), for loops traversed clockwise, whose output leads
      the input.

    Raises `InputError` where an argument does not meet these conditions.

    Source: Krejci and Kuhnen 2001 (the model and its inverse), Kuhnen 2003 (bends), Al Janaideh and
    Krejci 2013 (rates).

    **Example:**

        >>> plays = hysteresis.PrandtlIshlinskii(np.array([1.0]), np.array([0.5]), slope=1.0)
        >>> plays.simulate(None, np.array([0.0, 2.0, 4.0, 3.0, 0.0])).tolist()
        [0.0, 2.5, 5.5, 4.5, 0.5]
    """

    thresholds: Values = parameter(
        unit="input", **POSITIVE, fixed=True, meaning="half widths of the plays"
    )
    weights: Values = parameter(
        unit="output / input", **NOT_NEGATIVE, meaning="slopes of the plays"
    )
    slope: Scalar = parameter(unit="output / input", **POSITIVE, meaning="slope of the line")
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    rates: Values | None = parameter(
        None, unit="time", **NOT_NEGATIVE, meaning="growth of the half widths with speed"
    )
    bends: Values | None = parameter(
        None, unit="output", fixed=True, meaning="where the output's curve bends"
    )
    bend_slopes: Values | None = parameter(None, meaning="by how much it bends")
    leading: bool = eqx.field(default=False, static=True)

    def __check_init__(self) -> None:
        bends, bend_slopes = (() if x is None else x for x in (self.bends, self.bend_slopes))
        check_shapes(
            0, False, thresholds=(self.thresholds, "plays"), weights=(self.weights, "plays"),
            rates=(self.rates, "plays"), bends=(bends, "bends"), bend_slopes=(bend_slopes, "bends"),
        )  # fmt: skip
        if all(is_concrete(value) for value in jax.tree.leaves(self)):
            self._check_values()

    may_jump = False

    @property
    def needs_time(self) -> bool:
        return self.rates is not None

    def laws(self, eps: float, depth: int) -> Tree:
        none = np.zeros(len(self.thresholds))
        plays = node(
            "plays",
            {
                "plays": len(none), "thresholds": self.thresholds, "weights": self.weights,
                "slope": self.slope, "rates": none if self.rates is None else self.rates,
                "offset": self.offset if self.bends is None else 0.0, "leading": self.leading,
                "nested": self.rates is None,
            },
            {"u": 0.0, "speed": 0.0, "z": none},
        )  # fmt: skip
        if self.bends is None:
            return plays
        # The bends are a polygon, which goes on beyond its ends as it begins.
        d = self.bends
        nodes = jnp.concatenate([d[:1] - 1.0, d, d[-1:] + 1.0])
        outputs = jnp.stack([self.bend(x) for x in nodes])
        return series(plays, polygon(nodes, jnp.diff(outputs), self.offset + outputs[0], eps))

    def bend(self, x: Array) -> Float[Array, ""]:
        """S(x)."""
        if self.bends is None or self.bend_slopes is None:
            return x
        d = self.bends
        passed = jnp.where(d >= 0, jnp.maximum(x - d, 0), jnp.minimum(x - d, 0))
        return x + jnp.dot(self.bend_slopes, passed)

    def _check_values(self) -> None:
        for name, _, value in parameters(self):
            if value is not None and not np.isfinite(np.asarray(value)).all():
                raise InputError(
                    "parameter-out-of-bounds", f"{name} = {value}.", fix=f"keep {name} finite."
                )
        check_increasing("thresholds", self.thresholds)
        check_increasing("bends", self.bends)
        if self.bends is None or self.bend_slopes is None:
            return
        d, s = np.asarray(self.bends), np.asarray(self.bend_slopes)
        if min(1 + np.append(s[d >= 0].cumsum(), s[d < 0][::-1].cumsum())) <= 0:
            said = f"with bend_slopes = {s} the output's curve does not rise everywhere."
            mend = "from 0 outwards, keep 1 + the sum of the bend slopes passed above 0."
            raise InputError("output-falls", said, fix=mend)


# Stop and play operators whose stiffness depends on where the input was, or how far it has ever gone.

Modulator = Literal["position", "span"]
Weights = Float[Array, "..."] | Any


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
    thresholds: Weights = parameter(
        unit="input", **POSITIVE, fixed=True, meaning="strain at which a stop slides"
    )
    levels: Weights = parameter(
        unit="input", fixed=True, meaning="where the modulator has its hats"
    )
    slopes: Weights = parameter(
        unit="output / input", **NOT_NEGATIVE, meaning="slope after a reversal"
    )
    springs: Weights = parameter(
        unit="output / input", **NOT_NEGATIVE, meaning="stiffness beside them"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")
    rest: float = eqx.field(default=0.0, static=True, converter=float)
    by: Modulator = eqx.field(default="span", static=True)
    plays: Weights | None = parameter(
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
