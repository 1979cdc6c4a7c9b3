"""A model as a tree of plain numbers: what the runtimes without JAX run."""

from functools import singledispatch
from typing import Any

import jax.numpy as jnp
import numpy as np

from hysteresis import (
    AbstractModel,
    AbstractViscoelastic,
    BoucWen,
    Conditioned,
    CyclicDrift,
    DegradingBoucWen,
    DuhemOperator,
    FoamCurve,
    InputError,
    LinearSponge,
    ModulatedStops,
    MonotoneCurve,
    MovingPreisach,
    NonlinearMaxwell,
    Oscillator,
    OutputDependentPreisach,
    PrandtlIshlinskii,
    Preisach,
    Scaled,
    Series,
    Softening,
    Sum,
    TimeDrift,
    VelocityFriction,
)
from hysteresis.curves import Clip, MonotoneSpline, PolynomialCurve
from hysteresis.models._bouc_wen import NODES
from hysteresis.models._conditioned import AXES
from hysteresis.models._degrading_bouc_wen import SUBSTEPS
from hysteresis.preisach import saturated_outputs

from ..guards._guarded import ROUNDING as ROUNDING_OF_ENDS
from ..guards._guarded import GuardedCompensator
from ..inverses import inverse_of
from ..inverses._bisection import FLAT_WIDTH, ROUNDING, BracketedCompensator
from ..inverses._conditioned import ConditionedCompensator
from ..inverses._degrading_bouc_wen import LEAST_SLOPE
from ._node import Tree, node
from ._oscillator_tree import oscillator_node
from ._preisach_tree import preisach_node, preisach_parts


def program_of(model: AbstractModel, precision: type = np.float64, depth: int = 64) -> Tree:
    """The tree of elements of a model that can be inverted.

    **Arguments:** `precision`: of the numbers it will be run with; `depth`: reversals that a Preisach model
    remembers.

    Raises `InputError` where the model has no inverse, or no element is known for one of its parts.
    """
    inverse_of(model)
    return tree_of(model, precision, depth)


def tree_of(model: AbstractModel, precision: type = np.float64, depth: int = 64) -> Tree:
    """`program_of` a model that is known to have an inverse, or is only run forwards."""
    return _tree(model, float(np.finfo(precision).eps), depth)


def guard_tree(guard: GuardedCompensator, precision: type = np.float64) -> Tree:
    """The guard of a compensator, as an element."""
    low, high = float(guard.low), float(guard.high)
    least, most = guard.seen or (1.0, 0.0)  # no reading is between
    # In single precision an estimate just after a reversal is 1e-3 of the range off.
    rounding = 0.0 if precision is np.float64 else 1e3 * ROUNDING_OF_ENDS * (high - low)
    return {
        "beyond": guard.beyond,
        **node(
            "guard",
            {
                "low": low, "high": high, "slack": max(float(guard.slack), rounding),
                "holds": guard.beyond == "limit", "decides": guard.decides, "within": guard.within,
                "least": least, "most": most,
            },
            {"beyond": 0},
        ),
    }  # fmt: skip


@singledispatch
def _tree(model: AbstractModel, eps: float, depth: int) -> Tree:
    raise InputError(
        "not-exportable",
        f"{type(model).__name__} cannot be exported.",
        cause="the runtimes without JAX have no element for it.",
        fix="use the compensator itself, or fit a model that can.",
    )


@_tree.register
def _(model: LinearSponge, eps: float, depth: int) -> Tree:
    threshold = max(float(model.threshold), -1e30)
    least = threshold - max(1e-12, 8 * eps) * abs(threshold)
    return node("line", {"K": model.K, "b": model.b, "threshold": threshold, "least": least})


@_tree.register
def _(model: AbstractViscoelastic, eps: float, depth: int) -> Tree:
    chain = model.chain()
    rates, drives = np.asarray(chain.all_rates), np.asarray(chain.all_drives)
    none = np.zeros_like(rates)
    return node(
        "chain",
        {
            "branches": len(rates), "direct": chain.direct, "rates": rates, "drives": drives,
            "against": model.against_chain, "constant": model.hold == "constant",
            "offset": model.offset,
        },
        {"load": 0.0, "x": none, "dt": -1.0, "decay": none, "before": none, "now": none},
    )  # fmt: skip


@_tree.register
def _(model: Preisach, eps: float, depth: int) -> Tree:
    if model.up is not None or model.dead_band:
        return _bracketed(model, preisach_parts(model, eps, depth), eps)
    return preisach_node(model, eps, depth)


@_tree.register
def _(model: BoucWen, eps: float, depth: int) -> Tree:
    x, weights = np.polynomial.legendre.leggauss(NODES)
    x = (1 + x) / 2
    return node(
        "bouc_wen",
        {
            "nodes": NODES, "powers": x ** (3 * float(model.n)), "cubes": x**3,
            "weights": 1.5 * x**2 * weights, "k": model.k, "alpha": model.alpha,
            "yield_at": model.yield_at, "n": model.n, "descent": model.descent(),
            "offset": model.offset, "rounding": ROUNDING * eps, "finest": max(1e-12, 32 * eps),
        },
        {"u": 0.0, "w": 0.0},
    )  # fmt: skip


@_tree.register
def _(model: DegradingBoucWen, eps: float, depth: int) -> Tree:
    inner, slip = model.inner, model.pinching
    return node(
        "degrading_bouc_wen",
        {
            "substeps": SUBSTEPS, "ahead": [0.5, 0.5, 1.0], "weights": [1 / 6, 1 / 3, 1 / 3, 1 / 6],
            "k": inner.k, "alpha": inner.alpha, "yield_at": inner.yield_at, "n": inner.n,
            "descent": inner.descent(), "offset": inner.offset,
            "strength_loss": 0.0 if model.strength_loss is None else model.strength_loss,
            "stiffness_loss": 0.0 if model.stiffness_loss is None else model.stiffness_loss,
            "slip": 0.0 if slip is None else slip.slip, "onset": 0.0 if slip is None else slip.onset,
            "level": 0.0 if slip is None else slip.level, "spread": 1.0 if slip is None else slip.spread,
            "severity": 1.0 if slip is None else slip.severity,
            "widening": 0.0 if slip is None or slip.widening is None else slip.widening,
            "least": max(float(model.least_slope()), LEAST_SLOPE * float(inner.k)),
            "rounding": ROUNDING * eps,
        },
        {"u": 0.0, "w": 0.0, "energy": 0.0, "rate": 0.0, "drive": 0.0},
    )  # fmt: skip


@_tree.register
def _(model: DuhemOperator, eps: float, depth: int) -> Tree:
    """Both directions' slopes, one after the other."""
    slopes = np.stack([np.asarray(model.rising, float), np.asarray(model.falling, float)])
    return node(
        "duhem",
        {
            "knots": slopes.shape[1], "low": model.low,
            "width": (model.high - model.low) / (slopes.shape[1] - 1), "slopes": slopes,
            "ways": [model._knots(jnp.asarray(one)) for one in slopes],
        },
        {"u": 0.0, "y": model.offset},
    )  # fmt: skip


@_tree.register
def _(model: Oscillator, eps: float, depth: int) -> Tree:
    return oscillator_node(model)


@_tree.register
def _(model: MovingPreisach, eps: float, depth: int) -> Tree:
    floor, ceiling = saturated_outputs(model.inner)
    return node(
        "moving", {"feedback": model.feedback, "floor": floor, "ceiling": ceiling},
        parts=[_tree(model.inner, eps, depth)],
    )  # fmt: skip


@_tree.register
def _(model: OutputDependentPreisach, eps: float, depth: int) -> Tree:
    """Its relays, then its polygon."""
    low, high = (float(end) for end in saturated_outputs(model.inner))
    nodes = np.linspace(low, high, len(model.increments) + 1)
    curve = MonotoneCurve(nodes, model.increments, model.offset)
    return _node_series([_tree(model.inner, eps, depth), _endless(_tree(curve, eps, depth))])


@_tree.register
def _(model: PrandtlIshlinskii, eps: float, depth: int) -> Tree:
    r, none = np.asarray(model.thresholds), np.zeros(len(model.thresholds))
    plays = node(
        "plays",
        {
            "plays": len(r), "thresholds": r, "weights": model.weights, "slope": model.slope,
            "rates": none if model.rates is None else model.rates,
            "offset": model.offset if model.bends is None else 0.0, "leading": model.leading,
            "nested": model.rates is None,
        },
        {"u": 0.0, "speed": 0.0, "z": none},
    )  # fmt: skip
    if model.bends is None:
        return plays
    # The bends are a polygon, which goes on beyond its ends as it begins.
    bends: Any = np.asarray(model.bends)
    nodes = np.unique(np.concatenate([bends, [0.0, bends[0] - 1.0, bends[-1] + 1.0]]))
    outputs = np.array([float(model.bend(jnp.asarray(x))) for x in nodes])
    curve = MonotoneCurve(nodes, np.diff(outputs), float(model.offset) + outputs[0])
    return _node_series([plays, _endless(_tree(curve, eps, depth))])


@_tree.register
def _(model: MonotoneCurve | MonotoneSpline, eps: float, depth: int) -> Tree:
    nodes, outputs = np.asarray(model.nodes), np.asarray(model.outputs())
    starts, ends = model.cell_slopes()
    flat = max(FLAT_WIDTH, 8 * ROUNDING * eps) * (nodes[-1] - nodes[0])
    return node(
        "curve",
        {
            "cells": len(nodes) - 1, "nodes": nodes, "outputs": outputs, "starts": starts, "ends": ends,
            "margin": ROUNDING * eps * np.abs(outputs).max(), "flat": flat, "endless": 0,
        },
        {"value": 0.0},
    )  # fmt: skip


@_tree.register
def _(model: PolynomialCurve, eps: float, depth: int) -> Tree:
    first, last = model.curve(jnp.asarray([model.low, model.high]))
    return node(
        "polynomial",
        {
            "degree": len(model.coefficients) - 1, "coefficients": model.coefficients, "low": model.low,
            "high": model.high, "first": first, "last": last,
            "margin": ROUNDING * eps * max(abs(float(first)), abs(float(last))),
        },
    )  # fmt: skip


@_tree.register
def _(model: FoamCurve, eps: float, depth: int) -> Tree:
    u1 = model.toe_length
    u2 = u1 + model.linear_length
    none = jnp.zeros(())
    return node(
        "foam",
        {
            "linear": model.linear, "toe": model.toe, "plateau": model.plateau, "u1": u1, "u2": u2,
            "u3": u2 + model.plateau_length, "rounding": model.rounding,
            "densification": model.densification, "offset": model.offset,
            "least": model.linear * np.minimum(model.toe, model.plateau),
            "origin": model._integral(none),
        },
    )  # fmt: skip


@_tree.register
def _(model: Clip, eps: float, depth: int) -> Tree:
    low, high = max(float(model.low), -1e30), min(float(model.high), 1e30)
    return node("clip", {"low": low, "high": high})


@_tree.register
def _(model: Softening, eps: float, depth: int) -> Tree:
    weights = np.triu(np.asarray(model.weights))
    n = len(weights)
    part = node(
        "softening",
        {
            "cells": n, "low": model.low, "scale": n / (model.high - model.low), "weights": weights,
            "columns": weights.sum(0), "forgetting": 1 / float(model.recovery), "leading": model.leading,
        },
        {"reached": np.zeros(n)},
    )  # fmt: skip
    return _bracketed(model, [part], eps)


@_tree.register
def _(model: NonlinearMaxwell, eps: float, depth: int) -> Tree:
    n, cells = len(model.times), model.cells
    none = np.zeros(n)
    increments = np.zeros((n, cells)) if model.increments is None else np.asarray(model.increments)
    springs = np.pad(np.cumsum(increments, 1), ((0, 0), (1, 0)))
    strengths = np.zeros((n, cells + 1)) if model.strengths is None else np.asarray(model.strengths)
    above, below = np.broadcast_to(strengths, (2, n, cells + 1))
    part = node(
        "maxwell",
        {
            "branches": n, "cells": cells, "low": model.low, "scale": cells / (model.high - model.low),
            "rates": 1 / np.asarray(model.times), "springs": springs, "increments": increments,
            "above": above, "below": below, "offset": model.offset, "leading": model.leading,
            "sprung": bool(increments.any()),
        },
        {
            "u": model.init().u, "spring": none, "linear": none, "dt": -1.0, "decay": none, "gain": none,
            "begun": 0, "held": none, "rise": none, "rest": 0.0,
        },
    )  # fmt: skip
    return _bracketed(model, [part], eps)


@_tree.register
def _(model: ModulatedStops, eps: float, depth: int) -> Tree:
    begin = model.init()
    slopes, springs = model.of_stops()
    part = node(
        "stops",
        {
            "stops": len(model.thresholds), "count": len(model.levels), "thresholds": model.thresholds,
            "levels": model.levels, "slopes": slopes, "springs": springs,
            "offset": model.offset, "rest": model.rest, "by_position": model.by == "position",
        },
        {
            "u": begin.u, "least": begin.least, "largest": begin.largest, "z": begin.z,
            "level": -1.0, "spring": 0.0, "weights": np.zeros(len(model.thresholds)),
        },
    )  # fmt: skip
    return _bracketed(model, [part], eps)


@_tree.register
def _(model: VelocityFriction, eps: float, depth: int) -> Tree:
    part = node(
        "friction",
        {
            "speeds_count": len(model.speeds), "count": len(model.levels), "speeds": model.speeds,
            "levels": model.levels, "weights": model.weights, "viscous": model.viscous,
            "rate": 1 / model.smoothing, "offset": model.offset,
        },
        {"begun": 0, "u": 0.0, "lead": 0.0, "dt": -1.0, "decay": 0.0, "gain": 0.0},
    )  # fmt: skip
    return _bracketed(model, [part], eps)


@_tree.register
def _(model: CyclicDrift, eps: float, depth: int) -> Tree:
    """Part of a sum: alone it has no inverse."""
    return node(
        "drift",
        {
            "count": len(model.levels), "levels": model.levels, "drift": model.rates, "least": model.least,
            "most": min(model.most - model.least, 1e30), "length": model.length + model.least,
            "offset": model.offset,
        },
        {"begun": 0, "u": 0.0, "path": 0.0},
    )  # fmt: skip


@_tree.register
def _(model: TimeDrift, eps: float, depth: int) -> Tree:
    """Part of a sum: alone it has no inverse."""
    rates = 1 / np.asarray(model.times)
    return node(
        "time_drift",
        {"count": len(rates), "rates": rates, "ends": model.rates, "most": min(model.most, 1e30),
         "offset": model.offset},
        {"begun": 0, "elapsed": 0.0},
    )  # fmt: skip


@_tree.register
def _(model: Scaled, eps: float, depth: int) -> Tree:
    parameters = {"factor": model.factor, "offset": model.offset}
    return node("scaled", parameters, parts=[_tree(model.inner, eps, depth)])


@_tree.register
def _(model: Conditioned, eps: float, depth: int) -> Tree:
    """A sum of shares, which is looked for as a whole."""
    compensator = inverse_of(model)
    assert isinstance(compensator, ConditionedCompensator)
    sign = -1.0 if compensator.falls else 1.0
    knots, axis = np.asarray(model.knots, float), AXES.index(model.axis)
    at = knots if axis == 0 else np.log(knots) if axis == 1 else -1 / knots
    around = np.concatenate([at[:1] - 1, at, at[-1:] + 1])
    parts = []
    for k, one in enumerate(model.models):
        own = {"before": around[k], "at": around[k + 1], "after": around[k + 2]}
        ends = {"axis": axis, "low": knots[0], "high": knots[-1]}
        turned = Scaled(one, sign) if sign < 0 else one
        parts.append(node("share", ends | own, {"share": 0.0}, [_tree(turned, eps, depth)]))
    whole = _bracketed(model, parts, eps)
    if sign > 0:
        return whole
    return node("scaled", {"factor": sign, "offset": 0.0}, parts=[whole])


@_tree.register
def _(model: Series, eps: float, depth: int) -> Tree:
    return _node_series([_tree(part, eps, depth) for part in model.parts])


@_tree.register
def _(model: Sum, eps: float, depth: int) -> Tree:
    parts = [_tree(part, eps, depth) for part in model.parts]
    if len(parts) == 1:
        return parts[0]
    if any(part["kind"] == "moving" for part in parts):
        raise InputError("not-exportable", "a MovingPreisach within a sum cannot be exported.")
    return _bracketed(model, [p["parts"][0] if is_search(p) else p for p in parts], eps)


def is_search(tree: Tree) -> bool:
    """A single part that is only looked for."""
    return tree["kind"] == "sum" and len(tree["parts"]) == 1


def _endless(tree: Tree) -> Tree:
    return tree | {"parameters": tree["parameters"] | {"endless": 1}}


def _node_series(parts: list[Tree]) -> Tree:
    return {"kind": "series", "parts": parts}


def _bracketed(model: AbstractModel, parts: list[Tree], eps: float) -> Tree:
    compensator = inverse_of(model)
    assert isinstance(compensator, BracketedCompensator | ConditionedCompensator)
    low, high = compensator.low, compensator.high
    return node(
        "sum",
        {
            "low": low, "high": high, "rounding": ROUNDING * eps, "size": compensator.size(),
            "flat": max(FLAT_WIDTH, 256 * eps) * (high - low), **precisions(eps, high - low),
        },
        {"value": low, "slope": 0.0}, parts,
    )  # fmt: skip


def precisions(eps: float, reach: float) -> dict[str, float]:
    """How close two inputs are between which one is found, without a bend of the output and with one."""
    return {"finest": max(1e-9, 2 * eps) * reach, "closest": 2 * eps * reach}
