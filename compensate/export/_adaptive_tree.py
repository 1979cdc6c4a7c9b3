"""A compensator that recalibrates itself as a tree of plain numbers."""

import numpy as np

from ..inverses._bisection import FLAT_WIDTH, ROUNDING
from ..recalibration._adaptive import AdaptiveCompensator
from ._element_tree import is_search, precisions, tree_of
from ._node import Tree, node


def adaptive_tree(
    own: AdaptiveCompensator, fitted: Tree, precision: type = np.float64, depth: int = 64
) -> Tree:
    """The tree of an `AdaptiveCompensator`, as it was made; `fitted`: that of its model."""
    eps = float(np.finfo(precision).eps)
    p, n = own.settings, len(own.parts) + 2
    parts = [tree_of(part, precision, depth) for part in own.parts]
    begin = p.begin()
    reach = own.high - own.low
    return node(
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
        [*(part["parts"][0] if is_search(part) else part for part in parts), fitted],
    )  # fmt: skip
