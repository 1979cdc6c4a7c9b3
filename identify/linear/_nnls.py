"""Exact least squares with signs: block principal pivoting on the normal equations."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg.lapack import dposv  # pyright: ignore[reportAttributeAccessIssue]

Vector = Float[np.ndarray, " n"]
Matrix = Float[np.ndarray, "n n"]


def nonnegative_least_squares(
    H: Matrix,
    b: Vector,
    free: Bool[np.ndarray, " n"] | None = None,
    start: Bool[np.ndarray, " n"] | None = None,
) -> Vector:
    """The x that minimises x'Hx/2 - b'x with x_i >= 0 for every i that is not `free`.

    With H = A'A and b = A'y that is least squares in A x = y. H must be positive definite; a
    prior, however weak, makes it so. `start` guesses which x_i are not zero.

    All variables of the wrong sign change sides at once. Where three rounds in a row leave no fewer
    of them, an active set method goes on, one variable at a time: each of its steps lowers the
    objective, so it ends even where rounding would let pivots cycle. The answer satisfies x >= 0,
    Hx - b >= 0 on its zeros, to rounding: there is no step length and no tolerance on the objective.

    Source: Kim and Park, Fast nonnegative matrix factorization, SIAM J. Sci. Comput. 33 (2011);
    Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23.
    """
    n = len(b)
    free = np.zeros(n, bool) if free is None else free
    inside = np.ones(n, bool) if start is None else start | free
    rounding = _rounding(b)
    fewest, patience = n + 1, 3
    while True:
        x = _solve(H, b, inside)
        wrong = np.where(inside, (x < 0) & ~free, H @ x - b < -rounding)
        count = int(wrong.sum())
        if count == 0:
            return x
        if count >= fewest and patience == 0:
            return _active_set(H, b, free, np.where(free, x, np.maximum(x, 0.0)))
        patience = 3 if count < fewest else patience - 1
        fewest = min(count, fewest)
        inside ^= wrong


def _active_set(H: Matrix, b: Vector, free: Bool[np.ndarray, " n"], x: Vector) -> Vector:
    """The same from a feasible x, by steps that stay feasible."""
    inside = free | (x > 0)
    barred = np.zeros(len(b), bool)  # let in and thrown out at once: its slope was rounding
    while True:
        target = _solve(H, b, inside)
        while (leaving := inside & ~free & (target < 0)).any():
            # As far as the first variable to become zero, which leaves.
            step = np.where(leaving, x / np.where(leaving, x - target, 1.0), np.inf)
            first = int(step.argmin())
            x = np.where(inside, x + step[first] * (target - x), 0.0)
            x[first], inside[first], barred[first] = 0.0, False, step[first] == 0
            target = _solve(H, b, inside)
        x = target
        slope = np.where(inside | barred, np.inf, H @ x - b)
        entering = int(slope.argmin())
        if slope[entering] >= -_rounding(b):
            return x
        inside[entering] = True


def _solve(H: Matrix, b: Vector, inside: Bool[np.ndarray, " n"]) -> Vector:
    """The minimum without signs over the variables `inside`; the others are 0."""
    at = np.flatnonzero(inside)
    x = np.zeros(len(b))
    if not len(at):
        return x
    # Rows before columns, and LAPACK without its wrappers: half of the time of a few hundred variables.
    _, x[at], failed = dposv(H[at][:, at].T, b[at], overwrite_a=True)
    if failed:
        raise np.linalg.LinAlgError("The matrix of the normal equations is not positive definite.")
    return x


def _rounding(b: Vector) -> float:
    """Slopes below this are rounding."""
    return 1e-12 * float(np.abs(b).max(initial=1e-300))


def constrained_least_squares(
    H: Matrix,
    b: Vector,
    C: Float[np.ndarray, "constraints n"],
    free: Bool[np.ndarray, " n"] | None = None,
    start: Bool[np.ndarray, " n"] | None = None,
    rounds: int = 30,
    tolerance: float = 1e-9,
) -> Vector:
    """As `nonnegative_least_squares`, with C x >= 0 besides.

    Method of multipliers: C x = s, s >= 0 joins the unknowns under the quadratic penalty
    kappa |C x - s - m|^2 / 2, and m collects what is left over, until |C x - s| < tolerance * |x|.
    """
    n, k = len(b), len(C)
    free = np.zeros(n, bool) if free is None else free
    kappa = 100 * np.trace(H) / n / max(np.mean(np.sum(C**2, 1)), 1e-300)
    E = np.hstack([C, -np.eye(k)])
    big = kappa * E.T @ E
    big[:n, :n] += H
    all_free = np.append(free, np.zeros(k, bool))
    inside = None if start is None else np.append(start, np.ones(k, bool))
    multiplier = np.zeros(k)
    z = np.zeros(n + k)
    for _ in range(rounds):
        right = kappa * E.T @ multiplier
        right[:n] += b
        z = nonnegative_least_squares(big, right, all_free, inside)
        inside = z != 0
        left_over = E @ z
        if np.abs(left_over).max(initial=0.0) <= tolerance * np.abs(z[:n]).max(initial=1e-300):
            break
        multiplier -= left_over
    return z[:n]
