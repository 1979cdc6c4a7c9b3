"""Inverses of curves without memory."""

import abc
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar, is_concrete, register
from hysteresis.curves import Clip, FoamCurve, MonotoneCurve, MonotoneSpline, PolynomialCurve
from hysteresis.trees import FLAT_WIDTH, ROUNDING

from .._contract import AbstractCompensator, Estimate, Status, scan_steps
from ._inverse_of import inverse_of

NEWTON_STEPS = 100


class AbstractCurveCompensator(AbstractCompensator[Array, Estimate]):
    """The inverse of a curve. The state is the last estimate: 0 at first."""

    @abc.abstractmethod
    def find(self, y: Array, held: Array) -> Estimate:
        """The input behind a finite output; the one nearest to `held` where there are many."""

    def init(self) -> Array:
        return jnp.asarray(0.0)

    def step(self, state: Array, t: ArrayLike | None, y: ArrayLike) -> tuple[Array, Estimate]:
        y = jnp.asarray(y, state.dtype)
        valid = jnp.isfinite(y)
        value, status = self.find(jnp.where(valid, y, 0.0), state)
        value = jnp.where(valid, value, state)
        return value, Estimate(value, jnp.where(valid, status, Status.INVALID))

    def simulate(self, t: ArrayLike | None, y: ArrayLike, state: Array | None = None) -> Estimate:
        y = jnp.asarray(y, float)
        return scan_steps(self, None, y, self.init() if state is None else state)[1]


@register
class FoamCurveCompensator(AbstractCurveCompensator):
    """Compression from force, by Newton's method between bounds that the smallest slope gives."""

    model: FoamCurve

    def find(self, y: Array, held: Array) -> Estimate:
        model = self.model
        least = jnp.minimum(model.toe, model.plateau)
        rise = (y - model.offset) / (model.linear * least)
        value = newton(model.curve, y, jnp.minimum(rise, 0.0), jnp.maximum(rise, 0.0))
        return Estimate(value, jnp.full_like(y, Status.OK, int))


@register
class MonotoneCurveCompensator(AbstractCurveCompensator):
    """u from y by search for its cell. A flat cell holds the nearest u, FLAT.

    Beyond the nodes the curve goes straight on, EXTRAPOLATED, or is held where flat, SATURATED.
    """

    model: MonotoneCurve | MonotoneSpline

    def find(self, y: Array, held: Array) -> Estimate:
        nodes, outputs = self.model.nodes, self.model.outputs()
        starts, ends = self.model.cell_slopes()
        widths = jnp.diff(nodes)
        rounding = ROUNDING * float(jnp.finfo(y.dtype).eps)
        margin = rounding * jnp.abs(outputs).max()

        def place(y: Array, cell: Array) -> Array:
            """Where a cell's parabola has this output; its end where it is flat."""
            cell = jnp.clip(cell, 0, len(widths) - 1)
            rise, start, width = y - outputs[cell], starts[cell], widths[cell]
            inside = jnp.clip(rise, 0.0, outputs[cell + 1] - outputs[cell])
            # x = 2 rise / (start + slope at x): no difference of like numbers, whatever the slopes.
            square = start**2 + 2 * (ends[cell] - start) / width * inside
            some = square > 0
            both = start + jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 0.0)
            flat = jnp.where(y < outputs[cell + 1], 0.0, width)
            along = jnp.where(both > 0, 2 * inside / jnp.where(both > 0, both, 1.0), flat)
            outer = jnp.where(rise < 0, start, ends[cell])
            beyond = jnp.where(outer > 0, (rise - inside) / jnp.where(outer > 0, outer, 1.0), 0.0)
            return nodes[cell] + jnp.minimum(along, width) + beyond

        # The first input whose output is within the margin of y, and the last one.
        first = place(y - margin, jnp.searchsorted(outputs, y - margin, side="left") - 1)
        last = place(y + margin, jnp.searchsorted(outputs, y + margin, side="right") - 1)
        below, above = y < outputs[0] - margin, y > outputs[-1] + margin
        goes_on = jnp.where(below, starts[0] > 0, ends[-1] > 0)
        beyond = jnp.where(goes_on, Status.EXTRAPOLATED, Status.SATURATED)
        # In single precision the margin itself is wider than a millionth.
        flat = last - first > max(FLAT_WIDTH, 8 * rounding) * (nodes[-1] - nodes[0])
        inside = jnp.where(flat, Status.FLAT, Status.OK)
        return Estimate(jnp.clip(held, first, last), jnp.where(below | above, beyond, inside))


@register
class PolynomialCurveCompensator(AbstractCurveCompensator):
    """u from y by Newton's method between `low` and `high`, and along the tangents beyond."""

    model: PolynomialCurve

    def find(self, y: Array, held: Array) -> Estimate:
        model = self.model
        ends = jnp.stack([model.low, model.high])
        outputs, slopes = jax.jvp(model.curve, (ends,), (jnp.ones_like(ends),))
        inside = newton(model.curve, jnp.clip(y, outputs[0], outputs[1]), model.low, model.high)
        over = y - jnp.clip(y, outputs[0], outputs[1])
        end_slope = jnp.where(over < 0, slopes[0], slopes[1])
        goes_on = end_slope > 0
        value = inside + jnp.where(goes_on, over / jnp.where(goes_on, end_slope, 1.0), 0.0)
        margin = ROUNDING * jnp.finfo(y.dtype).eps * jnp.abs(outputs).max()
        beyond = jnp.where(goes_on, Status.EXTRAPOLATED, Status.SATURATED)
        return Estimate(value, jnp.where(jnp.abs(over) > margin, beyond, Status.OK))


@register
class ClipCompensator(AbstractCurveCompensator):
    """y itself. At an end every input beyond gives it, FLAT; farther out is SATURATED."""

    model: Clip

    def find(self, y: Array, held: Array) -> Estimate:
        low, high = self.model.low, self.model.high
        at_end = jnp.where((y == low) | (y == high), Status.FLAT, Status.OK)
        outside = (y < low) | (y > high)
        return Estimate(jnp.clip(y, low, high), jnp.where(outside, Status.SATURATED, at_end))


def newton(curve: Callable[[Array], Array], y: Array, low: Scalar, high: Scalar) -> Array:
    """u with curve(u) = y between `low` and `high`: Newton's steps, halving where one leads out.

    A step that has not halved the interval it is in is followed by one that does, so that the end
    comes after twice as many as a number has bits.
    """

    def step(k: Array, at: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        u, low, high = at
        value, slope = jax.jvp(curve, (u,), (jnp.ones_like(u),))
        low, high = jnp.where(value <= y, u, low), jnp.where(value >= y, u, high)
        there = u + (y - value) / jnp.where(slope > 0, slope, 1.0)
        halfway = low + (high - low) / 2
        usable = (slope > 0) & (there >= low) & (there <= high) & (k % 4 > 0)
        return jnp.where(value == y, u, jnp.where(usable, there, halfway)), low, high

    start = low + (high - low) / 2
    return jax.lax.fori_loop(0, NEWTON_STEPS, step, (start, low, high))[0]


@inverse_of.register
def _(model: FoamCurve) -> FoamCurveCompensator:
    return FoamCurveCompensator(model)


@inverse_of.register
def _(model: MonotoneCurve | MonotoneSpline) -> MonotoneCurveCompensator:
    rises = model.rises()
    if is_concrete(rises) and not np.any(np.asarray(rises) > 0):
        raise InputError(
            "not-invertible",
            "the curve does not rise, so the output says nothing about the input.",
            fix="fit a record whose output changes with its input.",
        )
    return MonotoneCurveCompensator(model)


@inverse_of.register
def _(model: PolynomialCurve) -> PolynomialCurveCompensator:
    if all(is_concrete(value) for value in jax.tree.leaves(model)):
        _check_rising(model)
    return PolynomialCurveCompensator(model)


@inverse_of.register
def _(model: Clip) -> ClipCompensator:
    return ClipCompensator(model)


def _check_rising(model: PolynomialCurve) -> None:
    """The least slope is at an end, or where the second derivative is 0."""
    slope = np.polynomial.Polynomial(np.asarray(model.coefficients)).deriv()
    roots = slope.deriv().roots()
    inner = roots.real[(np.abs(roots.imag) < 1e-9) & (np.abs(roots.real) < 1)]
    x = np.append(inner, [-1.0, 1.0])
    slopes, low, high = slope(x), float(model.low), float(model.high)
    size = np.abs(slope.coef).sum()
    # Of an inflection with a horizontal tangent, rounding makes a slope of either sign.
    if size == 0 or slopes.min() < -1e-12 * size:
        place = low + (high - low) * (x[slopes.argmin()] + 1) / 2
        raise InputError(
            "not-invertible",
            f"the polynomial does not rise at {place:.6g}, so an output there has several inputs.",
            fix="fit a lower degree, a narrower range, or a MonotoneCurve.",
        )
