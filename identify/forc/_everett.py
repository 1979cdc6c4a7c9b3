"""A Preisach model directly from first-order reversal curves, without a fit.

On a grid whose nodes include every reversal, curve j rises by r_ij over the cell i (a row: switch-up
thresholds). Two curves differ in the relays between their reversals alone, so

    r_ij / 2 = R_i / 2 + sum of the masses w_ic over the columns c from reversal j up to the diagonal,

R the reversible part. Between two reversals r_i is interpolated; its differences are the masses. A
column between the last reversal below row i and the diagonal was not measured: there the density
continues as in the column beside it, and the remainder of the rise is R_i.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import PchipInterpolator

from hysteresis import Preisach
from hysteresis.preisach import GridDensity

from ._curves import Forc, check_curves


class EverettSurface(NamedTuple):
    """The Everett function E(u, b) = (y(u | b) - y(b | b)) / 2 of first-order reversal curves.

    - `nodes` (n + 1,): inputs; every reversal is one.
    - `everett` (n + 1, n + 1): E between nodes, symmetric; the reversible part R adds
      (R(u) - R(b)) / 2 to it.
    - `closure` (curves,): the distance of each curve from their mean at the greatest input, where all must
      meet: the repeatability of the curves, if they were measured up to there.
    - `model`: the Preisach model with this surface; it starts in positive saturation.
    """

    nodes: Float[np.ndarray, " nodes"]
    everett: Float[np.ndarray, "nodes nodes"]
    closure: Float[np.ndarray, " curves"]
    model: Preisach


def everett_surface(curves: tuple[Forc, ...], cells: int = 400) -> EverettSurface:
    """The Preisach model that reproduces every first-order reversal curve at the nodes, to rounding.

    Between curves the rises are interpolated by monotone cubics, so masses there are negative only if
    measured ones are. Noise and drift can cause that; the density is then `signed`. All curves meet one
    cell above the greatest input. A curve that ends earlier continues with the mean rise of the others,
    and its remaining difference is spread over the cells that it did not reach.

    **Arguments:**

    - `curves`: from `forc_curves`, each reversal once. The highest reversal should lie where the loop is
      closed, because everything above it is taken to be reversible.
    - `cells`: about the largest number of cells, but at least one between two reversals. Within this limit
      the gaps between reversals are divided as finely as the curves are sampled.

    Raises `InputError` `too-few-curves`, `not-increasing`.

    Source: Mayergoyz, Mathematical models of hysteresis and their applications (2003), section 1.2.

    **Example:**

        >>> surface = identify.everett_surface(curves)
        >>> surface.closure.shape, surface.model.initial
        ((5,), 'positive')
    """
    check_curves(curves, 2)
    nodes, first = _nodes(curves, cells)
    rises, closure, end = _rises(curves, nodes, first)
    masses, reversible = _masses(rises / 2, nodes, first)
    masses[np.abs(masses) < 1e-14 * np.abs(masses).sum()] = 0.0  # rounding has no sign
    density = GridDensity(
        nodes[0], nodes[-1], masses, nodes=tuple(nodes.tolist()), signed=bool(masses.min() < 0)
    )
    offset = end - reversible.sum() - masses.sum()
    model = Preisach(density, reversible, offset, initial="positive")
    R = np.append(0.0, np.cumsum(reversible))
    everett = np.asarray(density.tabulate().node) + np.abs(R[:, None] - R) / 2
    return EverettSurface(nodes, everett, closure, model)


def _nodes(
    curves: tuple[Forc, ...], cells: int
) -> tuple[Float[np.ndarray, " nodes"], Int[np.ndarray, " curves"]]:
    """Grid nodes, and the node of each reversal."""
    greatest = max(curve.input[-1] for curve in curves)
    step = float(np.median(np.concatenate([np.diff(curve.input) for curve in curves])))
    step = max(step, (greatest - curves[0].reversal) / cells)
    knots = np.array([*(curve.reversal for curve in curves), greatest])
    parts = np.maximum(np.rint(np.diff(knots) / step).astype(int), 1)
    first = np.append(0, np.cumsum(parts))
    nodes = np.interp(np.arange(first[-1] + 1), first, knots)
    return np.append(nodes, 2 * nodes[-1] - nodes[-2]), first[:-1]


def _rises(
    curves: tuple[Forc, ...],
    nodes: Float[np.ndarray, " nodes"],
    first: Int[np.ndarray, " curves"],
) -> tuple[Float[np.ndarray, "cells curves"], Float[np.ndarray, " curves"], float]:
    """Rise of each curve over each cell above its reversal; closures; the output where all meet."""
    y = np.stack([np.interp(nodes, c.input, c.output, right=np.nan) for c in curves], 1)
    row = np.arange(len(nodes) - 1)[:, None]
    rises = np.where(row >= first, np.diff(y, axis=0), 0.0)
    unknown = np.isnan(rises)
    measured = (row >= first) & ~unknown
    # As steep as the mean of the curves measured there; beyond all of them, as in the cell before.
    typical = np.where(measured, rises, 0.0).sum(1) / np.maximum(measured.sum(1), 1)
    typical[-1] = typical[-2]
    rises = np.where(unknown, typical[:, None], rises)
    ends = y[first, np.arange(len(curves))] + rises.sum(0)
    closure = ends - ends.mean()
    widths = np.diff(nodes)[:, None] * unknown
    return rises - closure * widths / widths.sum(0), closure, float(ends.mean())


def _masses(
    half: Float[np.ndarray, "cells curves"],
    nodes: Float[np.ndarray, " nodes"],
    first: Int[np.ndarray, " curves"],
) -> tuple[Float[np.ndarray, "cells cells"], Float[np.ndarray, " cells"]]:
    """Masses and the increments of the reversible part from half the rises."""
    cells = len(half)
    masses, reversible = np.zeros((cells, cells)), np.zeros(cells)
    width = np.diff(nodes)
    for i in range(cells):
        known = int(np.searchsorted(first, i, side="right"))  # curves that start below this row
        last = first[known - 1]
        if known > 1:
            between = PchipInterpolator(nodes[first[:known]], half[i, :known])
            masses[i, :last] = -np.diff(between(nodes[: last + 1]))
            if known < len(first):
                gap = slice(first[known - 2], last)
                beside = masses[i, gap].sum() / width[gap].sum()
                masses[i, last : i + 1] = beside * width[last : i + 1]
                masses[i, i] /= 2  # half a cell
        rise, beyond = half[i, known - 1], masses[i, last : i + 1]
        if (total := beyond.sum()) > rise:  # the extrapolated masses exceed the measured rise
            beyond *= max(rise / total, 0.0) if total > 0 else 1.0
        remainder = rise - beyond.sum()
        reversible[i] = 2 * max(remainder, 0.0)
        masses[i, i] += min(remainder, 0.0)
    return masses, reversible
