"""Exact least squares with signs: block principal pivoting on the normal equations."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import lapack

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
    of them, an active set method goes on from the round of the fewest, one variable at a time: each of
    its steps lowers the objective, so it ends even where rounding would let pivots cycle. The answer
    satisfies x >= 0, Hx - b >= 0 on its zeros, to rounding: there is no step length and no tolerance on
    the objective.

    Source: Kim and Park, Fast nonnegative matrix factorization, SIAM J. Sci. Comput. 33 (2011);
    Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23.
    """
    n = len(b)
    free = np.zeros(n, bool) if free is None else free
    inside = np.ones(n, bool) if start is None else start | free
    minima = _Minima(H, b)
    rounding = _rounding(b)
    fewest, patience, nearest = n + 1, 3, np.zeros(n)
    while True:
        x = minima(inside)
        wrong = np.where(inside, (x < 0) & ~free, H @ x - b < -rounding)
        count = int(wrong.sum())
        if count == 0:
            if minima.is_exact:
                return x
            minima.begin_at(inside)
            continue
        if count < fewest:
            fewest, patience, nearest = count, 3, x
        elif patience:
            patience -= 1
        else:
            return _active_set(H, b, free, np.where(free, nearest, nearest.clip(0.0)), minima)
        inside ^= wrong


def _active_set(
    H: Matrix, b: Vector, free: Bool[np.ndarray, " n"], x: Vector, minima: "_Minima"
) -> Vector:
    """The same from a feasible x, by steps that stay feasible."""
    inside = free | (x > 0)
    barred = np.zeros(len(b), bool)  # let in and thrown out at once: its slope was rounding
    while True:
        target = minima(inside)
        while (leaving := inside & ~free & (target < 0)).any():
            # As far as the first variable to become zero, which leaves.
            step = np.where(leaving, x / np.where(leaving, x - target, 1.0), np.inf)
            first = int(step.argmin())
            x = np.where(inside, x + step[first] * (target - x), 0.0)
            x[first], inside[first], barred[first] = 0.0, False, step[first] == 0
            target = minima(inside)
        x = target
        slope = np.where(inside | barred, np.inf, H @ x - b)
        entering = int(slope.argmin())
        if slope[entering] < -_rounding(b):
            inside[entering] = True
        elif minima.is_exact:
            return x
        else:
            minima.begin_at(inside)


SHARE = 0.2
"""Part of a factor's variables by which another set may differ: both ways then cost the same."""


class _Minima:
    """Minima of x'Hx/2 - b'x without signs over sets of variables, the others being 0.

    The first set B has a Cholesky factor L of its own, and so has a set that differs from it much. Of one
    with the further variables A and without R, with c the columns of H_BA and of the unit vectors of R,

        (D - Z'Z) w = d - Z'z,    x_B = L^-T (z - Z w),    x_A = w_A,    Z = L^-1 c,    z = L^-1 b_B,

    with D = diag(H_AA, 0) and d = (b_A, 0). The columns of Z are kept, so that a set that follows costs a
    few products. `is_exact`: the last minimum came from a factor of its own set.

    Source: Gill, Golub, Murray, Saunders, Methods for modifying matrix factorizations, Math. Comp. 28
    (1974).
    """

    def __init__(self, H: Matrix, b: Vector) -> None:
        self.H, self.b, self.is_exact = H, b, False
        self._base: np.ndarray | None = None

    def begin_at(self, inside: Bool[np.ndarray, " n"]) -> None:
        """The factor is that of this set from now on."""
        self._base, self._at = inside.copy(), np.flatnonzero(inside)
        at = self._at
        # Rows before columns, and LAPACK without its wrappers: half of the time of a few hundred variables.
        factored: Any = lapack.dpotrf  # pyright: ignore[reportAttributeAccessIssue]
        self._factor, failed = factored(self.H[at][:, at].T, lower=True, overwrite_a=True)
        if failed:
            said = "The matrix of the normal equations is not positive definite."
            raise np.linalg.LinAlgError(said)
        self._right = self._solved(self.b[at])
        self._place = np.cumsum(inside) - 1
        self._columns: dict[int, np.ndarray] = {}

    def __call__(self, inside: Bool[np.ndarray, " n"]) -> Vector:
        """The minimum over the variables `inside`."""
        if not inside.any():
            self.is_exact = True
            return np.zeros(len(self.b))
        if self._base is None or (inside ^ self._base).sum() > SHARE * len(self._at):
            self.begin_at(inside)
        x = np.zeros(len(self.b))
        changed = np.flatnonzero(inside ^ self._base)
        self.is_exact = not len(changed)
        z = self._right
        if self.is_exact:
            x[self._at] = self._solved(z, transposed=True)
            return x
        added = np.flatnonzero(inside[changed])
        Z = self._of(changed)
        S, d = -Z.T @ Z, -Z.T @ z
        S[np.ix_(added, added)] += self.H[np.ix_(changed[added], changed[added])]
        d[added] += self.b[changed[added]]
        w = np.linalg.solve(S, d)
        x[self._at] = self._solved(z - Z @ w, transposed=True)
        x[changed] = 0.0
        x[changed[added]] = w[added]
        return x

    def _of(self, changed: np.ndarray) -> Float[np.ndarray, "base changed"]:
        new = [k for k in changed.tolist() if k not in self._columns]
        if new:
            assert self._base is not None
            columns = np.zeros((len(self._at), len(new)), order="F")
            for column, k in zip(columns.T, new, strict=True):
                if self._base[k]:
                    column[self._place[k]] = 1.0
                else:
                    column[:] = self.H[k, self._at]
            for column, k in zip(self._solved(columns).T, new, strict=True):
                self._columns[k] = column
        return np.stack([self._columns[k] for k in changed.tolist()], 1)

    def _solved(self, right: np.ndarray, transposed: bool = False) -> np.ndarray:
        solve: Any = lapack.dtrtrs  # pyright: ignore[reportAttributeAccessIssue]
        return solve(self._factor, right, lower=True, trans=int(transposed))[0]


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
