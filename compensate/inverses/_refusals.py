"""Which models have an inverse, and why others have none."""

from typing import Any

import jax
import numpy as np

from hysteresis import (
    BoucWenForce,
    CyclicDrift,
    DegradingBoucWen,
    DuhemForce,
    GeneralizedPlays,
    InputError,
    LinearSponge,
    MonotoneCurve,
    Oscillator,
    Preisach,
    StopsAndPowers,
    TimeDrift,
)
from hysteresis._parameter import is_concrete
from hysteresis.curves import MonotoneSpline, PolynomialCurve
from hysteresis.preisach import GridDensity

from .._contract import AbstractCompensator
from ._bisection import BracketedCompensator
from ._inverse_of import inverse_of
from ._law import LawCompensator


@inverse_of.register
def _(model: LinearSponge) -> AbstractCompensator:
    if is_concrete(model.K) and not np.all(np.asarray(model.K) != 0):
        raise InputError(
            "not-invertible",
            "the line's slope K is 0, so the output says nothing about the input.",
            fix="fit a record whose output changes with its input.",
        )
    return LawCompensator(model)


@inverse_of.register
def _(model: MonotoneCurve | MonotoneSpline) -> AbstractCompensator:
    rises = model.rises()
    if is_concrete(rises) and not np.any(np.asarray(rises) > 0):
        raise InputError(
            "not-invertible",
            "the curve does not rise, so the output says nothing about the input.",
            fix="fit a record whose output changes with its input.",
        )
    return LawCompensator(model)


@inverse_of.register
def _(model: PolynomialCurve) -> AbstractCompensator:
    """The least slope is at an end, or where the second derivative is 0."""
    if not all(is_concrete(value) for value in jax.tree.leaves(model)):
        return LawCompensator(model)
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
    return LawCompensator(model)


@inverse_of.register
def _(model: DegradingBoucWen) -> AbstractCompensator:
    least = model.least_slope()
    if is_concrete(least) and model.strength_loss is not None and float(least) <= 0:
        raise InputError(
            "not-invertible",
            f"alpha = {float(model.inner.alpha):.3g} with strength_loss ="
            f" {float(model.strength_loss):.3g}: strength may be lost faster than the line rises, and an"
            " output then has several inputs.",
            cause="what is left of the stiffness after yield is too small for this loss.",
            fix="fit with strength_loss < n alpha / (1 - alpha), or without strength_loss.",
        )
    return LawCompensator(model)


@inverse_of.register
def _(model: Preisach) -> AbstractCompensator:
    density = model.density
    if isinstance(density, GridDensity):
        if all(map(is_concrete, jax.tree.leaves(model))):  # else the fit has seen to its slopes
            _check_slopes(model)
        return LawCompensator(model)
    if model.leading:
        raise InputError(
            "not-invertible",
            f"nothing says that a leading model with a {type(density).__name__} rises with its input.",
            cause="its relays fall as the input rises, and their slope is known on a grid alone.",
            fix="fit a GridDensity, or swap input and output and fit the lagging direction.",
        )
    return BracketedCompensator(model, *model.search_range())


def _check_slopes(model: Preisach) -> None:
    """Raise `InputError` where the output of a model on a grid can fall while its input rises."""
    grid: Any = model.density
    slope, widths = np.asarray(model.least_slope()), np.diff(grid.edges)
    scale = float(np.abs(np.asarray(grid.weights)).max())
    if (slope * widths < -1e-9 * scale).any():
        k = int(slope.argmin())
        raise InputError(
            "not-invertible",
            f"the output can fall while the input rises from {grid.edges[k]:g} to {grid.edges[k + 1]:g}.",
            cause="a signed density, or a reversible part too flat for a leading model.",
            fix="fit the model with its slopes constrained, which identify.fit does.",
        )


@inverse_of.register
def _(model: StopsAndPowers | BoucWenForce | DuhemForce | GeneralizedPlays) -> AbstractCompensator:
    raise InputError(
        "not-invertible",
        f"the output of a {type(model).__name__} need not rise with its input.",
        cause="its stiffnesses may have either sign.",
        fix="fit PrandtlIshlinskii, or a sum of parts that rise.",
    )


@inverse_of.register
def _(model: CyclicDrift | TimeDrift) -> AbstractCompensator:
    raise InputError(
        "not-invertible",
        f"the output of a {type(model).__name__} does not depend on the present input.",
        fix="add a part that rises with it: Sum([part, drift]).",
    )


@inverse_of.register
def _(model: Oscillator) -> AbstractCompensator:
    raise InputError(
        "not-invertible",
        "the force of an oscillator cannot be recovered sample by sample.",
        cause="its mass answers with an acceleration, and the second derivative of a noisy displacement is"
        " noise.",
        fix="low-pass the displacement of a whole record to the band that is wanted, and take m y'' + c y'"
        " + k y + z[y] of it; invert(model.hysteresis) is the inverse without the mass.",
    )
