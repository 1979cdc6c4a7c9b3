"""What the unknowns of a composition that depends on a condition stand for."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from hysteresis import AbstractModel, Conditioned
from hysteresis.numerics._functions import hats_of

from ._composition import CompositionUnknowns
from ._nnls import nonnegative_least_squares


class ConditionedUnknowns(NamedTuple):
    """A composition at each of a few knots of a condition, and straight lines between them:

        y = h_1(c) (columns x_1) + ... + h_K(c) (columns x_K)

    with the hat functions h_k of the knots, see `Conditioned`. It is linear in the unknowns x_1 ... x_K,
    which stand one behind the other, each as in `base`. A composition that rises with its input at every
    knot rises for every c.

    - `base`: what each x_k stands for.
    - `knots`: (K,) values of the condition. `axis`: see `Conditioned`.
    - `condition`, `unit`: its name and unit.
    """

    base: CompositionUnknowns
    knots: tuple[float, ...]
    condition: str
    unit: str
    axis: str

    @property
    def scale(self) -> float:
        """The unknowns are in this unit of the output."""
        return self.base.scale

    @property
    def centre(self) -> float:
        """Offsets are counted from it, see `CompositionUnknowns`."""
        return self.base.centre

    @property
    def offsets(self) -> slice:
        """Which unknowns are an offset: one at each knot."""
        return slice(None, None, self.base.count)

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts of the composition."""
        return self.base.parts

    @property
    def first(self) -> tuple[float, ...]:
        """Of the map that the input passes first, see `CompositionUnknowns`."""
        return self.base.first

    @property
    def shares(self) -> tuple[float, ...]:
        """How large unknowns of either sign are expected, see `CompositionUnknowns`."""
        return self.base.shares

    @property
    def floor(self) -> float | None:
        """The output never falls below it."""
        return self.base.floor

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{self.base.name}, by {self.condition}"

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.knots) * self.base.count

    def words(self) -> dict[str, Any]:
        """Plain data."""
        return self._asdict() | {"base": self.base._asdict()}

    def minimum(
        self,
        H: Float[np.ndarray, "n n"],
        b: Float[np.ndarray, "*draws n"],
        start: Bool[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, "*draws n"]:
        """The minimum of x'Hx/2 - b'x with no unknown negative that is not free in `base`."""
        free = np.tile(self.base.free, len(self.knots))
        return nonnegative_least_squares(H, b, free, start)

    def model(self, unknowns: Float[Array, "*draws unknowns"] | np.ndarray) -> AbstractModel:
        """The model of the unknowns; of many vectors, one whose arrays have a leading axis of draws."""
        if unknowns.ndim > 1:
            return jax.vmap(self.model)(jnp.asarray(unknowns))
        each = jnp.split(jnp.asarray(unknowns), len(self.knots))
        models = tuple(self.base.model(x) for x in each)
        return Conditioned(models, self.knots, self.condition, self.unit, self.axis)

    @property
    def total_names(self) -> tuple[str, ...]:
        """Names of the sums that tell a person what the parts do, at every knot."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        names = self.base.total_names
        return tuple(f"{name} at {knot:.4g}{unit}" for knot in self.knots for name in names)

    @property
    def totals(self) -> Float[np.ndarray, "sums unknowns"]:
        """The sums as rows, at every knot."""
        return np.kron(np.eye(len(self.knots)), self.base.totals)


def shares_of(
    knots: Float[np.ndarray, " knots"],
    axis: str,
    c: Float[np.ndarray, " samples"],
    going_on: bool = False,
) -> Float[np.ndarray, "samples knots"]:
    """The hat functions of `Conditioned`, for many small sets of knots: nothing is compiled. With
    `going_on` they are straight beyond the ends, as a prediction is."""
    at, ends = on_axis(axis, c), on_axis(axis, knots)
    found = hats_of(np.clip(at, ends[0], ends[-1]), ends)
    for near, other in ((0, 1), (-1, -2)) if going_on and len(knots) > 1 else ():
        step = np.maximum((at - ends[near]) / (ends[near] - ends[other]), 0.0)
        found[:, near] += step
        found[:, other] -= step
    return found


def on_axis(axis: str, c: Float[np.ndarray, " values"]) -> Float[np.ndarray, " values"]:
    """The condition on the axis of interpolation."""
    return np.log(c) if axis == "logarithmic" else -1 / c if axis == "reciprocal" else c
