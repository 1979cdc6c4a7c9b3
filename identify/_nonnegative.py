"""Exact least squares with signs: block principal pivoting on the normal equations."""

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float

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

    All variables of the wrong sign change sides at once; after three rounds without fewer of them one
    at a time (the last one), which cannot cycle. The answer satisfies x >= 0, Hx - b >= 0 on its zeros,
    to rounding: there is no step length and no tolerance on the objective.

    Source: Kim and Park, Fast nonnegative matrix factorization, SIAM J. Sci. Comput. 33 (2011).
    """
    n = len(b)
    free = np.zeros(n, bool) if free is None else free
    inside = np.ones(n, bool) if start is None else start | free
    rounding = 1e-12 * np.abs(b).max(initial=1e-300)
    fewest, patience = n + 1, 3
    while True:
        at = np.flatnonzero(inside)
        x = np.zeros(n)
        factor = scipy.linalg.cho_factor(H[np.ix_(at, at)], overwrite_a=True, check_finite=False)
        x[at] = scipy.linalg.cho_solve(factor, b[at], check_finite=False)
        gradient = H[:, at] @ x[at] - b
        wrong = np.where(inside, (x < 0) & ~free, gradient < -rounding)
        count = int(wrong.sum())
        if count == 0:
            return x
        if count < fewest:
            fewest, patience = count, 3
            inside ^= wrong
        elif patience > 0:
            patience -= 1
            inside ^= wrong
        else:
            last = np.flatnonzero(wrong)[-1]
            inside[last] = not inside[last]


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
