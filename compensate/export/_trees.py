"""Models and what is around their inverses as trees of plain numbers: what the runtimes without JAX run."""

import numpy as np

from hysteresis import AbstractModel
from hysteresis.trees import FLAT_WIDTH, ROUNDING, Tree, node, part_tree, plain, precisions

from ..guards._guarded import ROUNDING as ROUNDING_OF_ENDS
from ..guards._guarded import GuardedCompensator
from ..inverses import inverse_of
from ..recalibration._adaptive import AdaptiveCompensator

ONE_WAY = ("moving", "oscillator")
"""Kinds of elements that run from reading to estimate only."""


def program_of(model: AbstractModel) -> Tree:
    """The tree of a model that can be inverted.

    Raises `InputError` where the model has no inverse, or no element is known for one of its parts.
    """
    inverse_of(model)
    return tree_of(model)


def tree_of(model: AbstractModel, precision: type = np.float64, depth: int = 64) -> Tree:
    """The tree of a model for numbers of a precision, and so many reversals of a Preisach model."""
    return plain(model.tree(float(np.finfo(precision).eps), depth))


def guard_tree(guard: GuardedCompensator, precision: type = np.float64) -> Tree:
    """The guard of a compensator, as an element."""
    low, high = float(guard.low), float(guard.high)
    least, most = guard.seen or (1.0, 0.0)  # no reading is between
    # In single precision an estimate just after a reversal is 1e-3 of the range off.
    rounding = 0.0 if precision is np.float64 else 1e3 * ROUNDING_OF_ENDS * (high - low)
    made = node(
        "guard",
        {
            "low": low, "high": high, "slack": max(float(guard.slack), rounding),
            "holds": guard.beyond == "limit", "decides": guard.decides, "within": guard.within,
            "least": least, "most": most,
        },
        {"beyond": 0},
    )  # fmt: skip
    return {"beyond": guard.beyond, **plain(made)}


def adaptive_tree(
    own: AdaptiveCompensator, fitted: Tree, precision: type = np.float64, depth: int = 64
) -> Tree:
    """The tree of an `AdaptiveCompensator`, as it was made; `fitted`: that of its model."""
    eps = float(np.finfo(precision).eps)
    p, n = own.settings, len(own.parts) + 2
    parts = [part_tree(part, eps, depth) for part in own.parts]
    begin = p.begin()
    reach = own.high - own.low
    made = node(
        "adaptive",
        {
            "low": own.low, "high": own.high, "rounding": ROUNDING * eps, **precisions(eps, reach),
            "flat": max(FLAT_WIDTH, 256 * eps) * reach, "parts": len(own.parts), "sign": own.sign,
            "floored": own.floored,
            "zero": p.zero, "centres": own.centres, "nominal": p.nominal, "least": p.least,
            "rises": p.rises, "widths": p.widths, "noise": p.noise, "correlation": p.correlation,
            "memory": p.memory, "settling": p.settling, "threshold": p.threshold, "spread": p.spread,
            "error": p.error,
        },
        {
            "value": own.low, "slope": 0.0, "reference": 0.0, "known": 0, "share": 0.0, "elapsed": 0.0,
            "idle": 0.0, "used": begin.used, "theta": begin.theta, "covariance": begin.covariance,
            "before": begin.before, "run": 0.0, "common": 0.0, "apart": 0.0,
            "evidence": 0.0, "excess": 0.0,
            "possible": 0.0, "settled": 0.0, "loss": begin.loss, "residual": 1.0, "changes": 0,
            "output": np.zeros(n), "shown": np.zeros(n), "along": np.zeros(n), "work": np.zeros(n * n),
        },
        [*parts, fitted],
    )  # fmt: skip
    return plain(made)
