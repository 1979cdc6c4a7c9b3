"""Oscillators with a plane of plays: starts by equation error, then output error."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from operator import itemgetter
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from hysteresis import GeneralizedPlays, interpolated
from hysteresis._precision import in_this_precision
from hysteresis.numerics._input_memory import stops

from ._linear_approximation import LinearApproximation
from ._measured_motion import MeasuredMotion
from ._output_error import PLANT, STATE, Family, covariance_of, hats
from ._vector_fitting import real

PLAYS, LARGEST, POWER = 20, 0.95, 1.3
"""How many plays; the largest radius, of the range; radii are closer for small ones by this power."""

KNOTS = (2, 21, 31)
"""Of the curve of the smallest play; those of larger plays have as many per displacement."""

RANGES = np.geomspace(0.2, 0.85, 9)
"""Of the radii, as parts of the largest displacement."""

BAND = 1.5
"""Displacements are low-passed at this many times the highest frequency of the force, and then known
almost without noise."""

FINER, PASSES, ROUNDS = 8, 5, 2
LEAST_REACH = 0.15
SIDE_BY_SIDE = 2


Equation = tuple[float, Family, Float[np.ndarray, " unknowns"]]
"""How well a family follows the equation of motion, by the Bayesian criterion, and with which unknowns."""


def plays_family(
    reach: float, knots: int, stiffness: float, free_state: bool, plays: int = PLAYS
) -> Family:
    """Unknowns: m, c, k; y and v at first where free; a constant force; slope and hinges of each curve.

    The curves are in units of the `stiffness`. The play of radius 0 is the displacement itself, whose slope
    is k.
    """
    radii = reach * LARGEST * (np.arange(plays) / (plays - 1)) ** POWER
    ends = np.maximum(reach - radii, LEAST_REACH * reach)
    counts = np.maximum(2, 2 * np.round((knots - 1) / 2 * ends / reach).astype(np.int64) + 1)
    if knots == 2:
        counts[:] = 2
    model = GeneralizedPlays(radii, ends, np.zeros(int(counts.sum())), counts.tolist())
    blocks = []
    for j, (end, count) in enumerate(zip(ends, counts, strict=True)):
        at = np.linspace(-end, end, count)
        hinges = [np.maximum(at - x, 0) if x >= 0 else np.maximum(x - at, 0) for x in at[1:-1]]
        # Beside the play of radius 0, the displacement itself, is a constant force: its slope is k.
        shapes = np.column_stack([at if j else np.full(count, 1 / stiffness), *hinges])
        blocks.append(stiffness * shapes)
    first = PLANT + (2 if free_state else 0)
    T: Any = block_diag(np.eye(PLANT + STATE)[:, :first], *blocks)
    begin = first + np.cumsum([0, *(block.shape[1] for block in blocks)])
    slopes, first_curve = begin[1:-1], np.arange(begin[0] + 1, begin[1])
    curves = np.setdiff1d(np.arange(begin[1], begin[-1]), slopes)
    found = (slopes, 0.1), (curves, 0.03), (first_curve, 0.1)
    groups = tuple(one for one in found if len(one[0]))
    words = {"reach": reach, "knots": knots}
    return Family(None, model, T, groups, words)


def equation_error(motion: MeasuredMotion, linear: LinearApproximation, family: Family) -> Equation:
    """Least squares of the equation of motion in the frequency domain, with the plays of the low-passed
    displacement.

    Each line is divided by the dynamic stiffness of the linear approximation, so that the residual is a
    displacement. A record without a period has the ends of its derivatives as two more unknowns.
    """
    n, w = len(motion.force), 2 * np.pi * motion.frequencies
    highest = linear.frequencies[-1] * BAND
    use = motion.frequencies <= min(highest, 0.9 * motion.frequencies[-1])
    U, Y = np.fft.rfft(motion.force), np.fft.rfft(motion.displacement)
    smooth = np.fft.irfft(np.where(use, Y, 0), n)
    path = interpolated(smooth, FINER, "band-limited", motion.periodic)
    own = family.plays
    reach, radii = np.asarray(own.reach), np.asarray(own.radii)
    rounds = np.tile(path, ROUNDS if motion.periodic else 1)
    plays = rounds[:, None] - stops(np.append(0.0, rounds), radii)[1:]
    plays = plays[-len(path) :: FINER][:n]
    columns = [-(w**2) * Y, 1j * w * Y, Y]
    columns += [np.zeros(len(w))] * STATE
    for j, (first, end) in enumerate(pairwise(own.first)):
        columns += list(np.fft.rfft(hats(plays[:, j], reach[j], end - first), axis=0).T)
    A = np.column_stack(columns)[use] @ family.T
    free = 0 if motion.periodic else 2
    if free:
        A = np.column_stack([A, np.ones(len(A)), 1j * w[use]])
    stiffness = -linear.mass * w[use] ** 2 + 1j * linear.damping * w[use] + linear.stiffness
    root = np.concatenate([family.prior_root([d for _, d in family.groups]), np.zeros(free)])
    A, b = A / stiffness[:, None], U[use] / stiffness
    both, right = real(A), real(b)
    normal, projected, square = both.T @ both, both.T @ right, float(right @ right)
    least = (0.5 * motion.sigma) ** 2 * n
    variance = (10 * motion.sigma) ** 2 * n
    q = np.zeros(len(root))
    for _ in range(PASSES):
        covariance = covariance_of(normal / variance + np.diag(root**2))
        q = covariance @ projected / variance
        rest = square - 2 * q @ projected + q @ normal @ q
        variance = max(rest / use.sum(), least)
    rows = 2 * int(use.sum())
    effective = len(root) - float(np.sum(np.diag(covariance) * root**2))
    bic = rows * float(np.log(variance)) + effective * float(np.log(rows))
    q = q[: len(q) - free]
    if free:
        q[PLANT] = motion.displacement[0]
    return bic, family, q


def candidates(motion: MeasuredMotion, linear: LinearApproximation) -> list[Equation]:
    """Ranges of the radii and sizes of the curves by equation error, the least criterion first."""
    largest = float(np.abs(motion.displacement).max())

    def best_of(knots: int) -> Equation:
        each = (
            plays_family(reach, knots, linear.stiffness, not motion.periodic)
            for reach in RANGES * largest
        )
        return min((equation_error(motion, linear, one) for one in each), key=itemgetter(0))

    # FFTs and products of matrices let other threads run.
    with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        return sorted(pool.map(in_this_precision(best_of), KNOTS), key=itemgetter(0))
