"""Order selection: the best fits with one, two, ... time constants, until another one adds nothing."""

import numpy as np
from jaxtyping import Float

from ._prony_series import Fitted, Input, Problem, strengths

A_DECADE = 4
"""Time constants of the first grid in each decade."""
BEYOND = 3.0
"""How far beyond the record's step and span a time constant is searched, as a factor."""
SEARCHED = 3000
"""About how many rows of a unit step the search looks at; the rest refine the times."""


def thinned(problem: Problem) -> Problem:
    """About `SEARCHED` rows of a unit step response; all rows if there is an input."""
    stride = max(1, len(problem.y) // SEARCHED) if problem.input.u is None else 1
    return problem.rows(slice(None, None, stride))


def orders(problem: Problem, step: float, span: float, most: int) -> list[Fitted]:
    """The best fits with 0, 1, 2, ... time constants, as long as each adds one."""
    bounds = np.log(step / BEYOND), np.log(span * BEYOND)
    memoryless = len(problem.free)
    grid = np.linspace(
        np.log(step), np.log(span), 1 + max(2, int(np.ceil(A_DECADE * np.log10(span / step))))
    )
    few = thinned(problem)
    columns = few.columns(grid)
    merged = _merged(grid, strengths(columns, few.target, few.free)[memoryless:])
    fits = [problem.fit(np.zeros(0), bounds)]
    while len(fits) <= most:
        n, best = len(fits), fits[-1]
        starts = [_one_more(few, best.log_tau, grid, columns)]
        starts += [_agglomerated(merged, n)] if len(merged) >= n else []
        tries = [few.fit(start, bounds) for start in starts]
        fitted = min(tries, key=lambda f: f.mean_square)
        if len(few.y) < len(problem.y):
            fitted = problem.fit(fitted.log_tau, bounds, most=4)
        idle = (fitted.strengths[memoryless:] == 0).any()
        if idle or fitted.mean_square > 0.9999 * best.mean_square:
            break
        fits.append(fitted)
    return fits


def _merged(
    grid: Float[np.ndarray, " grid"], strength: Float[np.ndarray, " grid"]
) -> Float[np.ndarray, "groups 2"]:
    """Log time constants and strengths of the grid's non-zero entries, neighbours as one."""
    at = np.flatnonzero(strength > 0)
    groups = np.split(at, 1 + np.flatnonzero(np.diff(at) > 1)) if len(at) else []
    return np.array(
        [(np.average(grid[g], weights=strength[g]), strength[g].sum()) for g in groups]
    ).reshape(-1, 2)


def _agglomerated(groups: Float[np.ndarray, "groups 2"], n: int) -> Float[np.ndarray, " n"]:
    """Merge the closest pair of groups until there are n."""
    while len(groups) > n:
        k = int(np.argmin(np.diff(groups[:, 0])))
        pair = groups[k : k + 2]
        joined = [np.average(pair[:, 0], weights=pair[:, 1]), pair[:, 1].sum()]
        groups = np.vstack([groups[:k], joined, groups[k + 2 :]])
    return groups[:, 0]


def _one_more(
    problem: Problem,
    log_tau: Float[np.ndarray, " n"],
    grid: Float[np.ndarray, " grid"],
    columns: Float[np.ndarray, "rows all"],
) -> Float[np.ndarray, " m"]:
    """The time constants plus the one of the grid that reduces the residuals most."""
    present, left = problem.columns(log_tau), []
    for k in range(len(grid)):
        A = np.hstack([present, columns[:, len(problem.free) + k, None]])
        c = strengths(A, problem.target, problem.free)
        left.append(np.sum((A @ c - problem.target) ** 2))
    return np.sort(np.append(log_tau, grid[int(np.argmin(left))]))


def resolved(at: Input) -> tuple[float, float]:
    """The shortest time that a record resolves (first row of a step response, or least step); its span."""
    times = at.t if at.u is None else np.diff(at.t)
    return float(times[times > 0].min()), float(at.t[-1])
