"""Preisach models whose density has few parameters: where their fits start, from the weights of a grid."""

from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Preisach
from hysteresis.preisach import GaussianDensity, GridDensity, LorentzianDensity
from hysteresis.preisach._density import AbstractDensity
from hysteresis.preisach._sum import SumDensity

from .._levels import LITTLE
from ..linear._preisach_fit import fit_preisach
from ..linear._preisach_problem import COARSE
from ._training_data import TrainingData

INCREMENTS = 8
"""Equal steps of the input over which the reversible part rises by a parameter each. More of them raise the
held-out error of measured loops, because each is a parameter beside a density of four or eight."""

ORDER = 12
"""Of the quadrature while a Gaussian density is fitted and used: errors of 1e-7 of the output's range."""

NEAR = 2.0
"""Cells from the diagonal within which relays of a grid count as reversible: a narrow loop and none are
alike to its cells."""


class Moments(NamedTuple):
    """Mass of relays, and mean and standard deviation of their coercivity and bias."""

    mass: float
    coercivity: float
    coercivity_width: float
    bias: float
    bias_width: float


class _MadeOfMoments(Protocol):
    def __call__(self, low: float, high: float, found: Moments) -> AbstractDensity: ...


def _gaussian(low: float, high: float, found: Moments) -> AbstractDensity:
    return GaussianDensity(low, high, *found, order=ORDER)


def _lorentzian(low: float, high: float, found: Moments) -> AbstractDensity:
    """Half widths are half of the deviations, which tails determine."""
    mass, h, h_width, m, m_width = found
    return LorentzianDensity(low, high, mass, h, h_width / 2, m, m_width / 2)


class Shape(NamedTuple):
    """A density of `count` equal parts, each of which `made` makes of moments."""

    made: _MadeOfMoments
    count: int = 1


SHAPES = {
    "GaussianPreisach": Shape(_gaussian),
    "TwoGaussianPreisach": Shape(_gaussian, 2),
    "LorentzianPreisach": Shape(_lorentzian),
}
"""Names of Preisach models with few parameters, and their densities."""


def starts_of_shape(name: str, data: TrainingData, initial: str) -> tuple[Preisach, ...]:
    """Models of few parameters to start from, all of one structure.

    A grid is fitted, and the moments of its weights are those of the parts. If the output falls, all are of
    its negative.
    """
    known = tuple(word for word in data.initials if word != "fit") or ("negative",)
    states = known if initial in ("auto", "fit") else (initial,)
    linear, _ = fit_preisach(data.rising, data.parts, data.leadings, states, (COARSE,))
    grid = linear.model
    assert isinstance(grid, Preisach)
    return of_grid(grid, SHAPES[name])


def of_grid(grid: Preisach, shape: Shape) -> tuple[Preisach, ...]:
    """Preisach models with densities of a few parameters, each with the moments of a grid's relays.

    Of two parts one start has the narrow and the wide loops, one those at low and at high inputs, and one a
    narrow and a wide distribution about the same centre. Relays near the diagonal join the reversible part.
    """
    density = grid.density
    assert isinstance(density, GridDensity)
    low, high, cells = density.low, density.high, density.cells
    masses, edges = np.tril(np.asarray(density.weights)), density.edges
    middle = (edges[1:] + edges[:-1]) / 2
    alpha, beta = np.meshgrid(middle, middle, indexing="ij")
    h, m = (alpha - beta) / 2, (alpha + beta) / 2
    far = np.tri(cells, k=-1, dtype=bool) & (2 * h > NEAR * (high - low) / cells)
    if not masses[far].sum() > 0:
        far = np.tri(cells, dtype=bool)
    least = LITTLE * (high - low)

    def moments(which: Bool[np.ndarray, "cells cells"]) -> Moments:
        weights = masses[which]
        total = float(weights.sum())
        if not total > 0:  # no relays there: as many as there are, everywhere
            return moments(far)
        means = [float(weights @ x[which]) / total for x in (h, m)]
        widths = [
            max(float(np.sqrt(weights @ (x[which] - mean) ** 2 / total)), least)
            for x, mean in zip((h, m), means, strict=True)
        ]
        return Moments(total, max(means[0], least), widths[0], means[1], widths[1])

    whole = moments(far)
    splits = [(whole,)]
    if shape.count == 2:
        halves = [far & (x <= mean) for x, mean in ((h, whole.coercivity), (m, whole.bias))]
        splits = [(moments(half), moments(far & ~half)) for half in halves]
        splits.append((_spread(whole, 0.5), _spread(whole, 1.5)))
    reversible = _reversible(grid, np.where(far, 0.0, masses), edges)
    densities = ([shape.made(low, high, part) for part in split] for split in splits)
    return tuple(
        Preisach(
            parts[0] if len(parts) == 1 else SumDensity(parts),
            reversible,
            float(grid.offset),
            leading=grid.leading,
            initial=grid.initial,
        )
        for parts in densities
    )


def _spread(found: Moments, factor: float) -> Moments:
    """Half of the relays, spread so many times as far about the same centre."""
    mass, h, h_width, m, m_width = found
    return Moments(mass / 2, h, factor * h_width, m, factor * m_width)


def _reversible(
    grid: Preisach,
    near: Float[np.ndarray, "cells cells"],
    edges: Float[np.ndarray, " nodes"],
) -> Float[np.ndarray, " increments"]:
    """Increments of the grid's reversible part and of the relays `near` its diagonal, over equal steps."""
    own = 0.0 if grid.reversible is None else np.asarray(grid.reversible)
    rises = np.broadcast_to(own + 2 * grid.orientation * near.sum(1), len(edges) - 1)
    level = np.interp(
        np.linspace(edges[0], edges[-1], INCREMENTS + 1), edges, np.append(0.0, np.cumsum(rises))
    )
    increments = np.diff(level)
    size = np.abs(increments).sum() or 1.0
    return np.maximum(increments, LITTLE * size)
