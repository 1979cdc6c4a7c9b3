"""Duhem oscillators: starts from the linear approximation, then as many knots as the evidence has."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from hysteresis import DuhemForce, GeneralizedPlays
from hysteresis._precision import in_this_precision

from ._linear_approximation import LinearApproximation
from ._output_error import (
    PLANT,
    STATE,
    Family,
    Optimum,
    Setting,
    hats,
    levenberg_marquardt,
)

SIZES = tuple(2**k + 1 for k in range(2, 6))
"""Knots, one more between each two of those before."""

SIDE_BY_SIDE = 2
SHARES, LOSSES, SKEWS = (0.5, 0.25, 0.75), (0.5, 0.15), (-0.5, 0.5)
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
