"""One density of every kind, and Everett's function from its definition: no tables, no tricks."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import integrate, stats

from hysteresis.internal import SumDensity
from hysteresis.preisach import GaussianDensity, GridDensity, LorentzianDensity

CELLS = 5
Coercive = GaussianDensity | LorentzianDensity
Make = Callable[[np.random.Generator, float, float], Any]


def warped(rng: np.random.Generator, low: float, high: float) -> GridDensity:
    """Cells whose widths differ up to fivefold, the same for every seed."""
    part = np.array([0.0, 0.3, 0.36, 0.5, 0.8, 1.0])
    nodes = tuple((low + (high - low) * part).tolist())
    return GridDensity(low, high, rng.uniform(0.1, 1.0, (CELLS, CELLS)), nodes=nodes)


def coercive(rng: np.random.Generator, low: float, high: float, kind: type[Coercive]) -> Coercive:
    total, size = rng.uniform(1, 3), high - low
    coercivity, width, bias_width = size * rng.uniform(0.1, 0.2, 3)
    bias = (low + high) / 2 + size * rng.uniform(-0.1, 0.1)
    return kind(low, high, total, coercivity, width, bias, bias_width)


def mixture(rng: np.random.Generator, low: float, high: float) -> SumDensity:
    """Two kinds, one of them on less than the whole range; wide enough for a short quadrature."""
    size = high - low
    total, coercivity, width, bias_width = rng.uniform(0.2, 0.3, 4)
    normal = GaussianDensity(
        low, high, total, size * coercivity, size * width, (low + high) / 2, size * bias_width,
        order=16,
    )  # fmt: skip
    return SumDensity((normal, warped(rng, low, low + 0.4 * size)))


KINDS: tuple[type[Coercive], ...] = (GaussianDensity, LorentzianDensity)
DENSITIES: dict[str, Make] = {
    "warped": warped,
    **{kind.__name__: partial(coercive, kind=kind) for kind in KINDS},
    "sum": mixture,
}


def plain_everett(density: Any, a: float, b: float) -> float:
    """E(a, b), the mass of {b <= beta <= alpha <= a}."""
    a, b = max(a, b), min(a, b)
    if isinstance(density, SumDensity):
        return sum(
            plain_everett(part, *np.clip([a, b], part.low, part.high).tolist())
            for part in density.parts
        )
    if isinstance(density, Coercive):
        whole = coercive_integral(density, density.high, density.low)
        return float(density.total) * coercive_integral(density, a, b) / whole
    left, width = density.edges[:-1], np.diff(density.edges)
    w = np.tril(np.asarray(density.weights))
    rows = np.clip((a - left) / width, 0, 1)
    columns = np.clip((left + width - b) / width, 0, 1)
    halves = np.clip((np.minimum(a, left + width) - np.maximum(b, left)) / width, 0, 1)
    return float(rows @ np.tril(w, -1) @ columns + np.diagonal(w) @ halves**2)


def coercive_integral(density: Coercive, a: float, b: float) -> float:
    """The integral over the bias, where the model's is over the coercivity."""
    middle, bias, bias_width = (a + b) / 2, float(density.bias), float(density.bias_width)
    below = _coercivity(density).cdf

    def at(m: np.ndarray) -> np.ndarray:
        z = (m - bias) / bias_width
        heavy = isinstance(density, LorentzianDensity)
        q = 1 / (1 + z * z) if heavy else np.exp(-z * z / 2)
        return q * (below(np.minimum(a - m, m - b)) - below(0.0))

    inside = np.clip([middle, *(bias + bias_width * np.array([-4.0, 0.0, 4.0]))], b, a)
    cuts = sorted({a, b, *inside.tolist()})
    return sum(integrate.fixed_quad(at, *piece, n=60)[0] for piece in pairwise(cuts))


def _coercivity(density: Coercive):
    centre, width = float(density.coercivity), float(density.coercivity_width)
    kind = stats.norm if isinstance(density, GaussianDensity) else stats.cauchy
    return kind(centre, width)
