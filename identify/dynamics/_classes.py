"""Which hysteresis an oscillator has: classes fitted one after the other, ranked by their evidence."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise, product
from operator import itemgetter
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from hysteresis import DuhemForce, GeneralizedPlays, InputError, interpolated
from hysteresis._precision import in_this_precision
from hysteresis.dynamics._recorder import stages_of
from hysteresis.numerics._recurrence import stops

from .._levels import MUCH, NOTHING, SURE
from ._linear_approximation import LinearApproximation
from ._measured_motion import MeasuredMotion
from ._output_error import (
    PLANT,
    STATE,
    Family,
    Optimum,
    Setting,
    covariance_of,
    hats,
    levenberg_marquardt,
)
from ._vector_fitting import real

# Oscillators with a plane of plays: starts by equation error, then output error.

PLAYS, LARGEST, POWER = 20, 0.95, 1.3
"""How many plays; the largest radius, of the range; radii are closer for small ones by this power."""

KNOTS = (2, 21, 31)
"""Of the curve of the smallest play; those of larger plays have as many per displacement."""

RANGES = np.geomspace(0.2, 0.85, 9)
"""Of the radii, as parts of the largest displacement."""

FINER, PASSES, ROUNDS = 10, 10, 2
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
    # Low-passed so far above the force's frequencies, displacements are known almost without noise.
    highest = linear.frequencies[-1] * MUCH
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


# Duhem oscillators: starts from the linear approximation, then as many knots as the evidence has.

SIZES = tuple(2**k + 1 for k in range(2, 6))
"""Knots, one more between each two of those before."""

SHARES, LOSSES, SKEWS = (0.5, 0.25, 0.75), (0.5, 0.1), (-0.5, 0.5)
"""Starts: the part of the stiffness that is hysteretic; how much of it the rms force takes away; how
unlike loading and unloading are."""


def duhem_family(knots: int, limit: float, symmetric: bool, free_state: bool) -> Family:
    """Unknowns: m, c, k; with a free state y, v, z at first; f at 0, its slope, and hinges at inner knots.

    Where symmetric f-(z) = f+(-z); otherwise f- has unknowns of its own.
    """
    at = np.linspace(-limit, limit, knots)
    inner = at[1:-1]
    hinges = [
        np.maximum(at - x, 0) if x > 0 else np.maximum(x - at, 0) if x < 0 else np.abs(at)
        for x in inner
    ]
    basis = np.column_stack([np.ones(knots), at, *hinges])
    first = PLANT + (STATE if free_state else 0)
    sides = np.vstack([basis, basis[::-1]]) if symmetric else block_diag(basis, basis)
    T: Any = block_diag(np.eye(PLANT + STATE)[:, :first], sides)
    # The hinge at 0 belongs to the least of these models: it is drawn to nothing by no prior.
    drawn = np.tile([False, False, *(inner != 0)], 1 if symmetric else 2)
    of_hinges = first + np.flatnonzero(drawn)
    rate = DuhemForce(np.zeros(knots), np.zeros(knots), limit)
    groups = ((of_hinges, 1.0),) if len(of_hinges) else ()
    words = {"knots": knots, "symmetric": symmetric, "first": first}
    return Family(rate, GeneralizedPlays.joined([]), T, groups, words)


def unknowns_of_bouc_wen(
    family: Family,
    values: Float[np.ndarray, " parameters"],
    initial: Float[np.ndarray, " free"],
) -> Float[np.ndarray, " unknowns"]:
    """Unknowns of three knots: of mass, damping, stiffness, alpha, beta gamma and beta delta, and of the
    displacement, velocity and force at first where these are free."""
    first = family.words["first"]
    q = np.zeros(family.T.shape[1])
    q[:3], q[3:first] = values[:3], initial
    q[first : first + 3] = values[3], -values[4], -values[5]
    return q


def started(
    setting: Setting, linear: LinearApproximation, count: int, seed: int
) -> tuple[Optimum, list[float]]:
    """The best fit of three knots, and chi2 of every start that was tried: those of a grid, then
    others drawn farther away, up to `count` in all, until one explains the record."""
    motion, random = setting.motion, np.random.default_rng(seed)
    family = duhem_family(3, float(np.std(motion.force)), True, not motion.periodic)
    initial = np.zeros(family.words["first"] - PLANT)
    initial[:1] = motion.displacement[0]

    def start(share: float, loss: float, skew: float) -> np.ndarray:
        """From stiffness, damping and the size of the motion alone."""
        alpha, damping = share * linear.stiffness, 0.5 * max(linear.damping, 0.0)
        size = float(motion.displacement.std())
        per_force = loss / size  # at the rms motion z loses `loss` of alpha
        plant = linear.mass, damping, linear.stiffness - alpha
        values = np.array([*plant, alpha, per_force, skew * per_force])
        return unknowns_of_bouc_wen(family, values, initial)

    def drawn() -> np.ndarray:
        share, skew = random.uniform(0.05, 1.0), random.uniform(-1.5, 1.5)
        q = start(share, float(np.exp(random.uniform(np.log(0.03), np.log(3.0)))), skew)
        q[:3] *= np.exp(random.normal(0, 0.2, 3))
        return q

    grid = [start(*point) for point in product(SHARES, LOSSES, SKEWS)]
    points = [*grid, *(drawn() for _ in range(count - len(grid)))]
    one = in_this_precision(lambda q: levenberg_marquardt(setting, family, q))
    tried: list[Optimum] = []
    # The compiled law lets other threads run: two starts side by side take hardly longer than one.
    with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        for k in range(0, len(points), SIDE_BY_SIDE):
            tried += pool.map(one, points[k : k + SIDE_BY_SIDE])
            if min(found.chi for found in tried) < motion.explained:
                break
    return min(tried, key=lambda found: found.chi), [found.chi for found in tried]


def refined(setting: Setting, found: Optimum, knots: int, symmetric: bool) -> Optimum:
    """The same f on more knots, as far as the present motion goes, fitted with evidence."""
    family = found.family
    z = setting.hysteretic_force(family, found.q)
    limit = 1.05 * float(np.abs(z).max())
    new = duhem_family(knots, limit, symmetric, not setting.motion.periodic)
    theta = family.T @ found.q
    old = len(theta) - PLANT - STATE
    sides = theta[PLANT + STATE :].reshape(2, old // 2)
    assert family.rate is not None
    at = hats(np.linspace(-limit, limit, knots), float(family.rate.limit), old // 2)
    values = np.concatenate([at @ side for side in sides])
    q = new.unknowns_of(np.concatenate([theta[: PLANT + STATE], values]))
    scale = float(np.abs(values).max()) / limit
    new = replace(new, groups=tuple((g, scale) for g, _ in new.groups))
    return levenberg_marquardt(setting, new, q, rounds=3, steps=8)


CLASSES = ("BoucWen", "Duhem", "GeneralizedPlays")

COARSER = 4
"""The search for a start takes so many times fewer steps of integration."""

FAR_FROM_ONE = 2.0
"""chi2 per row from which plays are tried from another start."""

MOST_WARM = 20
"""Periods before steady state, at most."""


def search(
    motion: MeasuredMotion,
    linear: LinearApproximation,
    hysteresis: str | None,
    *,
    oversampling: int = 20,
    starts: int = 32,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[list[Optimum], list[float]]:
    """Fit the class `hysteresis`, or all of them where it is None, and take the one of greatest evidence.

    **Returns:** every class, the best one first, of which the final fit; chi2 of every start.

    Raises `InputError` `fit-broke` where no start led to a motion that stays finite.
    """
    warm = periods_to_steady_state(motion, linear)
    coarse = Setting.of(motion, max(1, oversampling // COARSER), (), warm)
    tried: list[Optimum] = []
    chi2: list[float] = []

    def note(found: Optimum) -> None:
        if np.isfinite(found.chi):
            tried.append(found)
            said = f"Oscillator({found.title}): chi2 per row {found.chi:.4g}"
            say(f"{said}, {found.effective:.0f} parameters")

    if hysteresis != "GeneralizedPlays":
        # Other classes are tried where the grid of starts does not do.
        best, chi2 = started(coarse, linear, starts if hysteresis == "BoucWen" else 0, seed)
        note(best)
        if hysteresis != "BoucWen" and np.isfinite(best.chi):
            _more_knots(coarse, best, note)
    explained = bool(tried) and min(one.chi for one in tried) < motion.explained
    if hysteresis == "GeneralizedPlays" or (hysteresis is None and not explained):
        for _, family, q in candidates(motion, linear):
            found = levenberg_marquardt(coarse, family, q, rounds=3, steps=8)
            note(found)
            if found.chi < FAR_FROM_ONE:
                break
    if not tried:
        raise InputError(
            "fit-broke",
            "no oscillator with hysteresis follows this motion from any start.",
            cause="the record is too short, too noisy, or not that of a mass on a spring.",
            fix="measure a longer record about the resonance.",
        )
    best, *others = sorted(tried, key=lambda one: one.bic)
    setting = _recorder(motion, best, oversampling, warm)
    # Steps as fine as those of the model, and its priors once more by the evidence.
    steps, tolerance = (4, 1e-4) if best.family.groups else (15, 1e-7)
    final = levenberg_marquardt(
        setting, best.family, best.q, deviations=best.deviations, rounds=2, steps=steps,
        tolerance=tolerance, damping=1e-6,
    )  # fmt: skip
    say(f"Oscillator({best.name}): chi2 per row {final.chi:.4g} at {oversampling} steps a sample")
    return [final, *others], chi2


def _more_knots(coarse: Setting, best: Optimum, note: Callable[[Optimum], None]) -> None:
    """Duhem operators with more knots, equal for both directions and not, while the evidence rises."""
    for knots in SIZES:
        both = [refined(coarse, best, knots, symmetric) for symmetric in (True, False)]
        new = min(both, key=lambda one: one.bic)
        note(new)
        if new.bic > best.bic:
            return
        best = new


def _recorder(motion: MeasuredMotion, found: Optimum, oversampling: int, warm: int) -> Setting:
    """The setting whose recorder explains the record best; decimation in stages unless the data tell."""
    ways = dict.fromkeys((stages_of(oversampling), (), (oversampling,)))
    settings = [Setting.of(motion, oversampling, stages, warm) for stages in ways]
    left = []
    for setting in settings:
        y, _ = setting.simulated(found.family, found.q, jacobian=False)
        off = motion.whitened(motion.displacement - y)
        left.append(float(off @ off) / motion.sigma**2)
    best = int(np.argmin(left))
    return settings[best] if left[best] < left[0] - SURE**2 * max(1.0, found.chi) else settings[0]


def periods_to_steady_state(
    motion: MeasuredMotion, linear: LinearApproximation, rows: int | None = None
) -> int:
    """How many periods, of the motion or of so many rows, pass from rest until the transient is gone, which
    decays by a quarter of the linear damping."""
    rate = max(linear.damping, 0.0) / (8 * linear.mass)
    time = (rows or len(motion.force)) * motion.dt
    return int(np.clip(np.ceil(-np.log(NOTHING) / max(rate * time, 1e-9)), 1, MOST_WARM))
