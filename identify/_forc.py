"""First-order reversal curves, found in a record.

From positive saturation the input falls to a reversal b and rises again: y(u | b). With relays of -1
and +1 the curves *are* the material's Everett function, whatever its density,

    E(u, b) = (y(u | b) - y(b | b)) / 2.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator

from hysteresis import InputError, Preisach, Record
from hysteresis.preisach import GridDensity


class Forc(NamedTuple):
    """One first-order reversal curve: the output while the input rises from a reversal.

    - `reversal`: the input where the curve starts.
    - `input`, `output` (samples,): along it; the input rises strictly.
    """

    reversal: float
    input: Float[np.ndarray, " samples"]
    output: Float[np.ndarray, " samples"]


def forc_curves(record: Record) -> tuple[Forc, ...]:
    """Find the first-order reversal curves of a record; they come with the lowest reversal first.

    The top of a record is everything within a hundredth of the input's range from its maximum. Each
    excursion from the top and back gives one curve: it starts at the lowest input reached, and holds the
    samples whose input exceeds all earlier ones of the rise. Smaller loops on the way are wiped out and do
    no harm. Rows before the first visit to the top are excluded, unless a sequence has no others: then it
    is taken to start in positive saturation, or on the descent from it.

    **Arguments:** `record`: input and output in any units; rows outside its mask are excluded.

    Raises `InputError` `too-few-curves` if there is no curve.

    Source: Mayergoyz, Mathematical models of hysteresis and their applications (2003), section 1.2.

    **Example:**

        >>> [curve.reversal for curve in identify.forc_curves(loops)]
        [0.0, 0.0, 0.0, 4.0, 8.0, 12.0, 16.0]
    """
    top = float(record.input.max() - np.ptp(record.input) / 100)
    found = []
    for _, rows in record.sequences():
        u, y, used = record.input[rows], record.output[rows], record.mask[rows]
        below = np.append(False, u < top)
        leaves = np.flatnonzero(below[1:] & ~below[:-1])
        if len(leaves) > 1 and leaves[0] == 0:
            leaves = leaves[1:]
        for a, b in pairwise([*leaves, len(u)]):
            lowest = b - 1 - int(np.argmin(u[a:b][::-1]))
            rise = np.arange(lowest, b)
            before = np.maximum.accumulate(np.append(-np.inf, u[rise]))[:-1]
            rise = rise[(u[rise] > before) & used[rise]]
            if len(rise) > 1:
                found.append(Forc(float(u[rise[0]]), u[rise], y[rise]))
    if not found:
        raise InputError(
            "too-few-curves",
            "the record does not contain a first-order reversal curve.",
            place=record.source,
            cause="the input never rises again after a descent from its top.",
            fix="name the column that tells the curves apart (--group COL), or measure such curves.",
        )
    return tuple(sorted(found, key=lambda curve: curve.reversal))


def check_curves(curves: tuple[Forc, ...], least: int) -> None:
    """Raise `InputError` unless there are `least` curves, sorted, with different reversals."""
    reversals = [curve.reversal for curve in curves]
    if len(curves) < least:
        raise InputError(
            "too-few-curves",
            f"there are {len(curves)} curves, and at least {least} are needed.",
            fix="measure more curves, or smooth over fewer.",
        )
    if (k := next((k for k, (a, b) in enumerate(pairwise(reversals)) if b <= a), None)) is not None:
        raise InputError(
            "not-increasing",
            f"the reversals of curves {k} and {k + 1} are {reversals[k]:g} and {reversals[k + 1]:g}.",
            cause="a curve was measured twice, or the curves are not sorted.",
            fix="keep one of them, and give the curves with the lowest reversal first.",
        )


# The FORC diagram: a material's density directly from its first-order reversal curves.


class ForcDiagram(NamedTuple):
    """The density at the measured points where enough neighbours were measured.

    - `reversal`, `input` (points,): b and u; thresholds beta and alpha of the relays that switch there.
    - `density`: rho = -1/2 d^2 y / (db du), in output / input^2.
    - `standard_error`: of the density, from the residuals of its local fit as if they were independent.
    """

    reversal: Float[np.ndarray, " points"]
    input: Float[np.ndarray, " points"]
    density: Float[np.ndarray, " points"]
    standard_error: Float[np.ndarray, " points"]

    @property
    def coercivity(self) -> Float[np.ndarray, " points"]:
        """(u - b) / 2: half the width of a relay's loop."""
        return (self.input - self.reversal) / 2

    @property
    def bias(self) -> Float[np.ndarray, " points"]:
        """(u + b) / 2: where a relay's loop is centred."""
        return (self.input + self.reversal) / 2


def forc_diagram(curves: tuple[Forc, ...], smoothing: int = 3) -> ForcDiagram:
    """The density rho = -1/2 d^2 y / (db du) at every measured point, by a local quadratic surface.

    Around each point (b0, u0) the surface

        y = a0 + a1 B + a2 B^2 + a3 U + a4 U^2 + a5 B U,      B = b - b0, U = u - u0

    is fitted by least squares to (2 smoothing + 1)^2 neighbours: 2 smoothing + 1 curves, and on each of
    them as many samples around u0; spacings need not be even. Then rho = -a5 / 2. Where the surface is not
    quadratic the error grows as smoothing^2; the effect of noise falls as smoothing^-3. Points with fewer
    than half of their neighbours measured are excluded.

    **Arguments:**

    - `curves`: from `forc_curves`, each reversal once.
    - `smoothing`: the smoothing factor SF, 1 or more.

    Raises `InputError` `bad-option`, `too-few-curves`, `too-few-rows`, `not-increasing`.

    Source: Pike, Roberts, Verosub, Characterizing interactions in fine magnetic particle systems
    using first order reversal curves, J. Appl. Phys. 85 (1999).

    **Example:**

        >>> diagram = identify.forc_diagram(curves, smoothing=1)
        >>> diagram.density.shape == diagram.standard_error.shape == diagram.bias.shape
        True
    """
    if smoothing < 1:
        raise InputError(
            "bad-option", f"a smoothing of {smoothing} is too small.", fix="give 1 or more."
        )
    width = 2 * smoothing + 1
    check_curves(curves, width)
    if max(len(curve.input) for curve in curves) < width:
        raise InputError(
            "too-few-rows",
            f"no curve has the {width} samples that a smoothing of {smoothing} needs.",
            fix="smooth less, or measure more samples a curve.",
        )
    padded = [_padded(curve, width) for curve in curves]
    parts = []
    for k, curve in enumerate(curves):
        near = slice(max(k - smoothing, 0), k + smoothing + 1)
        b, u, y, there = _neighbours(curves[near], padded[near], curve.input, smoothing)
        enough = there.sum(1) > max(width**2 / 2, 6)
        fitted = _mixed_coefficient(
            b[enough] - curve.reversal, u[enough] - curve.input[enough, None],
            y[enough], there[enough],
        )  # fmt: skip
        at = curve.input[enough]
        parts.append([np.full_like(at, curve.reversal), at, -fitted[0] / 2, fitted[1] / 2])
    return ForcDiagram(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _padded(curve: Forc, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Input, output and whether measured, with `width` places more at either end, evenly spaced.

    A window near an end then finds padding instead of samples that lie further in.
    """
    u, more = curve.input, np.arange(1, width + 1)
    below, above = u[0] - (u[1] - u[0]) * more[::-1], u[-1] + (u[-1] - u[-2]) * more
    measured = np.zeros(len(u) + 2 * width, bool)
    measured[width:-width] = True
    return np.concatenate([below, u, above]), np.pad(curve.output, width), measured


def _neighbours(
    curves: tuple[Forc, ...],
    padded: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    centre: Float[np.ndarray, " points"],
    smoothing: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Reversal, input, output and whether measured of the samples of `curves` about each centre."""
    found = []
    step = np.arange(-smoothing, smoothing + 1)
    for curve, (u, y, measured) in zip(curves, padded, strict=True):
        nearest = np.searchsorted((u[1:] + u[:-1]) / 2, centre)
        rows = np.clip(nearest[:, None] + step, 0, len(u) - 1)
        found.append((np.full(rows.shape, curve.reversal), u[rows], y[rows], measured[rows]))
    b, u, y, there = (np.concatenate(part, 1) for part in zip(*found, strict=True))
    return b, u, y, there


def _mixed_coefficient(
    B: Float[np.ndarray, "points neighbours"],
    U: Float[np.ndarray, "points neighbours"],
    y: Float[np.ndarray, "points neighbours"],
    there: Bool[np.ndarray, "points neighbours"],
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """The coefficient of B U in each point's quadratic surface, and its standard error."""
    # In units of the window's half width the normal equations are well conditioned.
    size_b, size_u = (np.abs(x * there).max(1, keepdims=True) for x in (B, U))
    B, U = B / size_b, U / size_u
    A = np.stack([np.ones_like(B), B, B**2, U, U**2, B * U], -1) * there[..., None]
    y = np.where(there, y - y.mean(1, keepdims=True), 0.0)
    covariance = np.linalg.inv(np.swapaxes(A, 1, 2) @ A)
    at = (covariance @ (np.swapaxes(A, 1, 2) @ y[..., None]))[..., 0]
    residual = y - (A @ at[..., None])[..., 0]
    variance = (residual**2).sum(1) / (there.sum(1) - 6)
    unit = (size_b * size_u)[:, 0]
    return at[:, 5] / unit, np.sqrt(variance * covariance[:, 5, 5]) / unit


# A Preisach model directly from first-order reversal curves, without a fit.
#
# On a grid whose nodes include every reversal, curve j rises by r_ij over the cell i (a row: switch-up
# thresholds). Two curves differ in the relays between their reversals alone, so
#
#     r_ij / 2 = R_i / 2 + sum of the masses w_ic over the columns c from reversal j up to the diagonal,
#
# R the reversible part. Between two reversals r_i is interpolated; its differences are the masses. A
# column between the last reversal below row i and the diagonal was not measured: there the density
# continues as in the column beside it, and the remainder of the rise is R_i.


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
