"""Curves without memory: the contract they share, and the general ones."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._errors import InputError
from .._model import AbstractFollowingModel, Series, Tree, evaluated, one_column
from .._parameter import (
    NOT_NEGATIVE,
    POSITIVE,
    Output,
    Scalar,
    Starts,
    Times,
    as_float,
    check_increasing,
    is_concrete,
    parameter,
)
from .._registry import register
from ..trees import ROUNDING, curve, node

Values = Float[Array, " _"] | Any
"""A one-dimensional parameter: given as numbers, kept as an array."""


class AbstractCurve(AbstractFollowingModel[tuple[()], Array]):
    """A model without memory: y = curve(u), sample by sample. Its state is empty, and the input itself is
    the prepared one."""

    @abc.abstractmethod
    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        """The output at inputs of any shape."""

    def init(self, t0: Any = None, u0: Any = None) -> tuple[()]:
        return ()

    def follow(
        self, t: Times, u: Series, state: tuple[()] | None = None
    ) -> tuple[tuple[()], Output]:
        return (), evaluated(self, as_float(u))

    def prepare(
        self, t: Times, u: Series, state: tuple[()] | None = None, *, starts: Starts = (0,)
    ) -> Array:
        return as_float(one_column(u))

    def evaluate(self, prepared: Array) -> Float[Array, " samples"]:
        return self.curve(prepared)


class AbstractMonotoneCurve(AbstractCurve):
    """A curve that never falls: parabolas from node to node, straight on beyond the ends."""

    nodes: eqx.AbstractVar[Values]

    # A field with a default: as an annotation it would come before the others in `__init__`.
    @property
    @abc.abstractmethod
    def offset(self) -> Scalar: ...

    @abc.abstractmethod
    def rises(self) -> Float[Array, " cells"]:
        """The rise of the output over each cell."""

    @abc.abstractmethod
    def cell_slopes(self) -> tuple[Float[Array, " cells"], Float[Array, " cells"]]:
        """The slopes at the start and at the end of each cell."""

    def outputs(self) -> Float[Array, " nodes"]:
        """The output at every node."""
        rises = self.rises()
        return self.offset + jnp.append(jnp.zeros_like(rises[:1]), rises.cumsum())

    def laws(self, eps: float, depth: int) -> Tree:
        return curve(self.nodes, self.outputs(), *self.cell_slopes(), eps)

    def cell_of(self, u: Float[Array, "*samples"]) -> Int[Array, "*samples"]:
        """The cell of each input; beyond the nodes the nearest."""
        cell = jnp.searchsorted(self.nodes, u, side="right") - 1
        return jnp.clip(cell, 0, self.nodes.shape[0] - 2)


@register
class MonotoneCurve(AbstractMonotoneCurve):
    """A polygon that never falls: straight from node to node, and continued straight beyond the ends.

    **Arguments:**

    - `nodes`: (n + 1,) inputs, increasing.
    - `increments`: (n,) rises of the output from each node to the next, none negative.
    - `offset`: the output at the first node.

    Raises `InputError` where an argument does not meet these conditions.

    **Example:**

        >>> curve = hysteresis.MonotoneCurve(nodes=[0.0, 1.0, 3.0], increments=[2.0, 1.0])
        >>> curve.simulate(None, np.array([0.5, 1.0, 2.0, 5.0])).tolist()
        [1.0, 2.0, 2.5, 4.0]
    """

    nodes: Values = parameter(unit="input", fixed=True, meaning="where the polygon may bend")
    increments: Values = parameter(unit="output", **NOT_NEGATIVE, meaning="rise over each cell")
    offset: Scalar = parameter(0.0, unit="output", meaning="output at the first node")

    def __check_init__(self) -> None:
        _check_nodes("increments", self.nodes, self.increments, 1)

    @classmethod
    def even(cls, low: float, high: float, increments: Any, offset: Any = 0.0) -> "MonotoneCurve":
        """With cells of equal width from `low` to `high`."""
        return cls(np.linspace(low, high, np.shape(increments)[0] + 1), increments, offset)

    def rises(self) -> Float[Array, " cells"]:
        return self.increments

    def cell_slopes(self) -> tuple[Float[Array, " cells"], Float[Array, " cells"]]:
        slopes = self.increments / jnp.diff(self.nodes)
        return slopes, slopes

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        cell, slope = self.cell_of(u), self.increments / jnp.diff(self.nodes)
        return self.outputs()[cell] + slope[cell] * (u - self.nodes[cell])


@register
class MonotoneSpline(AbstractMonotoneCurve):
    """A smooth curve that never falls: its slope is a polygon, and constant beyond the ends.

        y = offset + integral of the slope from the first node to u

    The slope is continuous, the output is linear in the parameters, and no cell can overshoot.

    **Arguments:**

    - `nodes`: (n,) inputs, increasing, at least two.
    - `slopes`: (n,) slopes at the nodes, none negative.
    - `offset`: the output at the first node.

    Raises `InputError` where an argument does not meet these conditions.

    **Example:**

        >>> curve = hysteresis.curves.MonotoneSpline(nodes=[0.0, 1.0, 2.0], slopes=[0.0, 2.0, 2.0])
        >>> curve.simulate(None, np.array([0.0, 0.5, 1.0, 2.0, 3.0])).tolist()
        [0.0, 0.25, 1.0, 3.0, 5.0]
    """

    nodes: Values = parameter(unit="input", fixed=True, meaning="where the slope may bend")
    slopes: Values = parameter(unit="output / input", **NOT_NEGATIVE, meaning="slope at each node")
    offset: Scalar = parameter(0.0, unit="output", meaning="output at the first node")

    def __check_init__(self) -> None:
        _check_nodes("slopes", self.nodes, self.slopes, 0)

    @classmethod
    def even(cls, low: float, high: float, slopes: Any, offset: Any = 0.0) -> "MonotoneSpline":
        """With cells of equal width from `low` to `high`."""
        return cls(np.linspace(low, high, np.shape(slopes)[0]), slopes, offset)

    def rises(self) -> Float[Array, " cells"]:
        start, end = self.cell_slopes()
        return (start + end) / 2 * jnp.diff(self.nodes)

    def cell_slopes(self) -> tuple[Float[Array, " cells"], Float[Array, " cells"]]:
        return self.slopes[:-1], self.slopes[1:]

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        cell, widths = self.cell_of(u), jnp.diff(self.nodes)
        along, first = u - self.nodes[cell], self.slopes[cell]
        inside = jnp.clip(along, 0.0, widths[cell])
        gain = (jnp.diff(self.slopes) / widths)[cell] * inside
        rise = (first + gain / 2) * inside + (first + gain) * (along - inside)
        return self.outputs()[cell] + rise


@register
class PolynomialCurve(AbstractCurve):
    """A polynomial between `low` and `high`, continued along its tangents beyond:

        y = sum_i c_i x^i,     x = (2 u - low - high) / (high - low)

    **Arguments:** `coefficients` (degree + 1,) c_i, the constant first; `low` and `high`.

    Raises `InputError` unless `low` < `high` and there is a coefficient.

    **Example:**

        >>> square = hysteresis.curves.PolynomialCurve(coefficients=[0.0, 0.0, 1.0])
        >>> square.simulate(None, np.array([0.5, 1.0, 2.0])).tolist()
        [0.25, 1.0, 3.0]
    """

    coefficients: Values = parameter(unit="output", meaning="of the powers of the scaled input")
    low: Scalar = parameter(-1.0, unit="input", fixed=True, meaning="input scaled to -1")
    high: Scalar = parameter(1.0, unit="input", fixed=True, meaning="input scaled to 1")

    def __check_init__(self) -> None:
        if np.ndim(self.coefficients) != 1 or np.shape(self.coefficients)[0] < 1:
            raise _out_of_bounds("coefficients", self.coefficients, "a list of one number or more")
        _check_order(self.low, self.high)

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        x = (2 * u - self.low - self.high) / (self.high - self.low)
        inside = jnp.clip(x, -1.0, 1.0)
        powers = self.coefficients[::-1]
        slope = jnp.polyval(jnp.polyder(powers), inside)
        return jnp.polyval(powers, inside) + slope * (x - inside)

    def laws(self, eps: float, depth: int) -> Tree:
        first, last = self.curve(jnp.stack([self.low, self.high]))
        return node(
            "polynomial",
            {
                "degree": len(self.coefficients) - 1, "coefficients": self.coefficients,
                "low": self.low, "high": self.high, "first": first, "last": last,
                "margin": ROUNDING * eps * jnp.maximum(jnp.abs(first), jnp.abs(last)),
            },
        )  # fmt: skip


@register
class Clip(AbstractCurve):
    """y = u between `low` and `high`, and the nearer of them beyond.

    Before another stage, it is a contact threshold. After another stage, it is slack that carries no
    tension.

    Raises `InputError` unless `low` < `high`.

    **Example:**

        >>> clip = hysteresis.curves.Clip(low=0.0)
        >>> clip.simulate(None, np.array([-1.0, 0.5, 2.0])).tolist()
        [0.0, 0.5, 2.0]
    """

    low: Scalar = parameter(-float("inf"), unit="input", fixed=True, meaning="least output")
    high: Scalar = parameter(float("inf"), unit="input", fixed=True, meaning="greatest output")

    def __check_init__(self) -> None:
        _check_order(self.low, self.high)

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        return jnp.clip(u, self.low, self.high)

    def laws(self, eps: float, depth: int) -> Tree:
        ends = {"low": jnp.maximum(self.low, -1e30), "high": jnp.minimum(self.high, 1e30)}
        return node("clip", ends)


def _check_nodes(name: str, nodes: Any, values: Any, more: int) -> None:
    """Nodes increase, are at least two and `more` than the values."""
    shapes = np.shape(nodes), np.shape(values)
    if len(shapes[0]) != 1 or shapes[0][0] < 2 or shapes[1] != (shapes[0][0] - more,):
        raise InputError(
            "length-mismatch",
            f"the shapes of nodes and {name} are {shapes[0]} and {shapes[1]}.",
            fix=f"give {'one node more than' if more else 'as many nodes as'} {name}, and at least two.",
        )
    check_increasing("nodes", nodes)


def _check_order(low: Any, high: Any) -> None:
    if is_concrete(low) and is_concrete(high) and not np.all(np.asarray(low) < np.asarray(high)):
        raise _out_of_bounds("low", low, f"below high = {high}")


def _out_of_bounds(name: str, value: Any, what: str) -> InputError:
    return InputError("parameter-out-of-bounds", f"{name} = {value}.", fix=f"keep {name} {what}.")


# The linear sponge: a line above a contact threshold.


@register
class LinearSponge(AbstractCurve):
    """Displacement of a soft cover under a normal force, as a line:

        d = K F + b   where F >= threshold,   else d = 0

    **Arguments:** `K` (mm/N), `b` (mm), `threshold` (N; the force of first contact). Any
    other pair of quantities works the same way, in the units of its record.

    Source: Tsuji 2014, equation (8); its threshold is 1.5 N.

    **Example:**

        >>> sponge = hysteresis.LinearSponge(K=1.5, b=6.0, threshold=1.5)
        >>> sponge.simulate(None, np.array([0.0, 2.0, 4.0])).tolist()
        [0.0, 9.0, 12.0]
    """

    K: Scalar = parameter(unit="output / input", meaning="compliance")
    b: Scalar = parameter(0.0, unit="output", meaning="displacement at no force")
    threshold: Scalar = parameter(
        -float("inf"), unit="input", fixed=True, meaning="input of first contact"
    )

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        return jnp.where(u >= self.threshold, self.K * u + self.b, 0.0)

    def laws(self, eps: float, depth: int) -> Tree:
        threshold = jnp.maximum(self.threshold, -1e30)
        least = threshold - max(1e-12, 8 * eps) * jnp.abs(threshold)
        return node("line", {"K": self.K, "b": self.b, "threshold": threshold, "least": least})


# Force over compression of a foam: toe, linear part, plateau, densification.


@register
class FoamCurve(AbstractCurve):
    """Force of a foam over its compression (or stress over strain). Its slope passes from the toe's
    stiffness to the linear part's and the plateau's, and grows from densification on:

        dy/du = linear (toe (1 - S(u - u1)) + S(u - u1) - S(u - u2) + plateau S(u - u2)
                        + densification r(u - u3)),          y(0) = offset

    where r(x) = (x + sqrt(x^2 + rounding^2)) / 2 is a ramp with a rounded corner and S = r' a rounded
    step. No term is negative, so y rises everywhere. The integral has a closed form.

    **Arguments:**

    - `linear`: stiffness of the linear part.
    - `toe`, `plateau`: stiffnesses of these parts divided by `linear`; `toe` is less than 1.
    - `toe_length`, `linear_length`, `plateau_length`: the compressions over which they hold:
      u1 = toe_length, u2 = u1 + linear_length, u3 = u2 + plateau_length.
    - `rounding`: the compression over which one part passes into the next.
    - `densification`: growth of the stiffness beyond u3 per unit of compression, divided by `linear`.
    - `offset`: force without compression.

    Raises `InputError` where an argument other than the offset is not positive, or `toe` is 1 or more.

    Source: Gibson and Ashby, Cellular Solids (1997), for the stages; the rounded passages are ours.

    **Example:**

        >>> foam = hysteresis.FoamCurve(
        ...     linear=2.0, toe=0.5, plateau=0.1, toe_length=1.0, linear_length=4.0,
        ...     plateau_length=10.0, rounding=0.5, densification=0.5)
        >>> np.asarray(foam.simulate(None, np.array([0.0, 1.0, 5.0, 15.0, 20.0]))).round(1).tolist()
        [0.0, 1.2, 8.6, 11.2, 25.0]
    """

    linear: Scalar = parameter(
        unit="output / input", **POSITIVE, meaning="stiffness of bending cell walls"
    )
    toe: Scalar = parameter(bounds=(0.0, 1.0), meaning="stiffness at first contact, in parts")
    plateau: Scalar = parameter(**POSITIVE, meaning="of buckling cell walls, in parts")
    toe_length: Scalar = parameter(unit="input", **POSITIVE, meaning="end of the toe")
    linear_length: Scalar = parameter(unit="input", **POSITIVE, meaning="of the linear part")
    plateau_length: Scalar = parameter(unit="input", **POSITIVE, meaning="of the plateau")
    rounding: Scalar = parameter(unit="input", **POSITIVE, meaning="width of the passages")
    densification: Scalar = parameter(
        unit="1 / input", **POSITIVE, meaning="growth of stiffness, in parts"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="force without compression")

    def curve(self, u: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        risen = self._integral(u) - self._integral(jnp.zeros_like(u))
        return self.offset + self.linear * risen

    def laws(self, eps: float, depth: int) -> Tree:
        u1 = self.toe_length
        u2 = u1 + self.linear_length
        return node(
            "foam",
            {
                "linear": self.linear, "toe": self.toe, "plateau": self.plateau, "u1": u1, "u2": u2,
                "u3": u2 + self.plateau_length, "rounding": self.rounding,
                "densification": self.densification, "offset": self.offset,
                "least": self.linear * jnp.minimum(self.toe, self.plateau),
                "origin": self._integral(jnp.zeros(())),
            },
        )  # fmt: skip

    def _integral(self, u: Array) -> Array:
        w = self.rounding
        first, second = self.toe_length, self.toe_length + self.linear_length
        x = u - second - self.plateau_length
        dense = (x**2 + x * jnp.sqrt(x**2 + w**2) + w**2 * jnp.arcsinh(x / w)) / 4
        return (
            self.toe * u
            + (1 - self.toe) * _ramp(u - first, w)
            + (self.plateau - 1) * _ramp(u - second, w)
            + self.densification * dense
        )


def _ramp(x: Array, width: Scalar) -> Array:
    return (x + jnp.sqrt(x**2 + width**2)) / 2
