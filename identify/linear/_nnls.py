"""Exact least squares with signs: block principal pivoting on the normal equations."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import lapack

Vector = Float[np.ndarray, " n"]
Matrix = Float[np.ndarray, "n n"]


def nonnegative_least_squares(
    H: Matrix,
    b: Float[np.ndarray, "*draws n"],
    free: Bool[np.ndarray, " n"],
    start: Bool[np.ndarray, " n"] | None = None,
) -> Float[np.ndarray, "*draws n"]:
    """The x that minimises x'Hx/2 - b'x with x_i >= 0 for every i that is not `free`, for each b.

    With H = A'A and b = A'y that is least squares in A x = y. H must be positive definite; a
    prior, however weak, makes it so. `start` guesses which x_i are not zero.
    """
    return np.apply_along_axis(SignedMinimum(H, free).of, -1, b, start)


SHARE = 0.5
"""Part of a factor's variables by which another set may differ: up to there no dearer than a new one."""


class SignedMinimum:
    """The minima of x'Hx/2 - b'x with x_i >= 0 for every i that is not free, for one b after another.

    All variables of the wrong sign change sides at once. Where three rounds in a row leave no fewer
    of them, an active set method goes on from the round of the fewest, one variable at a time: each of
    its steps lowers the objective, so it ends even where rounding would let pivots cycle. The answer
    satisfies x >= 0, Hx - b >= 0 on its zeros, to rounding: there is no step length and no tolerance on
    the objective.

    Inside, minima without signs over sets of variables, the others being 0. A set B has a Cholesky factor
    L of its own, which serves sets near it, of every b. Of one with the further variables A and without
    R, with c the columns of H_BA and of the unit vectors of R,

        (D - Z'Z) w = d - Z'z,    x_B = L^-T (z - Z w),    x_A = w_A,    Z = L^-1 c,    z = L^-1 b_B,

    with D = diag(H_AA, 0) and d = (b_A, 0). The columns of Z are kept, so that a set that follows costs a
    few products. One such step more from an answer, on what it leaves of b, takes away their rounding.

    Source: Kim and Park, Fast nonnegative matrix factorization, SIAM J. Sci. Comput. 33 (2011);
    Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23; Gill, Golub, Murray, Saunders,
    Methods for modifying matrix factorizations, Math. Comp. 28 (1974).
    """

    def __init__(self, H: Matrix, free: Bool[np.ndarray, " n"]) -> None:
        self.H, self.free = H, free
        self._base: np.ndarray | None = None

    def of(self, b: Vector, start: Bool[np.ndarray, " n"] | None = None) -> Vector:
        """The minimum for this b. `start` guesses which x_i are not zero."""
        free = self.free
        inside = np.ones(len(b), bool) if start is None else start | free
        fewest, patience, nearest = len(b) + 1, 3, np.zeros(len(b))
        rounding = _rounding(b)
        while True:
            x = self._over(inside, b)
            slope = self.H @ x - b
            wrong = np.where(inside, (x < 0) & ~free, slope < -rounding)
            count = int(wrong.sum())
            if count == 0:
                return self._polished(x, inside, -slope)
            if count < fewest:
                fewest, patience, nearest = count, 3, x
            elif patience:
                patience -= 1
            else:
                return self.from_feasible(b, np.where(free, nearest, nearest.clip(0.0)))
            inside ^= wrong

    def from_feasible(self, b: Vector, x: Vector) -> Vector:
        """The same from an x >= 0 that is near, by steps that stay feasible."""
        inside = self.free | (x > 0)
        barred = np.zeros(len(b), bool)  # let in and thrown out at once: its slope was rounding
        while True:
            target = self._over(inside, b)
            while (leaving := inside & ~self.free & (target < 0)).any():
                # As far as the first variable to become zero, which leaves.
                step = np.where(leaving, x / np.where(leaving, x - target, 1.0), np.inf)
                first = int(step.argmin())
                x = np.where(inside, x + step[first] * (target - x), 0.0)
                x[first], inside[first], barred[first] = 0.0, False, step[first] == 0
                target = self._over(inside, b)
            x = target
            left = b - self.H @ x
            entering = int(np.where(inside | barred, -np.inf, left).argmax())
            if inside[entering] or left[entering] <= _rounding(b):
                return self._polished(x, inside, left)
            inside[entering] = True

    def _over(self, inside: Bool[np.ndarray, " n"], b: Vector) -> Vector:
        """The minimum over the variables `inside`, without signs."""
        if not inside.any():
            return np.zeros(len(b))
        if self._base is None or (inside ^ self._base).sum() > SHARE * len(self._at):
            self._begin_at(inside)
        changed = np.flatnonzero(inside ^ self._base)
        x, z = np.zeros(len(b)), self._solved(b[self._at])
        if not len(changed):
            x[self._at] = self._solved(z, transposed=True)
            return x
        Z, added = self._of(changed), inside[changed]
        D = self.H[changed[:, None], changed] * (added[:, None] & added)
        w = _lapack("gesv", D - Z.T @ Z, b[changed] * added - z @ Z)[-1]
        x[self._at] = self._solved(z - Z @ w, transposed=True)
        x[changed] = w * added
        return x

    def _polished(self, x: Vector, inside: Bool[np.ndarray, " n"], left: Vector) -> Vector:
        """The answer x, which leaves this of b, without the rounding of a set that is not the factor's."""
        if (inside == self._base).all():
            return x
        x = x + self._over(inside, left)
        return np.where(self.free, x, x.clip(0.0))

    def _begin_at(self, inside: Bool[np.ndarray, " n"]) -> None:
        """The factor is that of this set from now on."""
        self._base, self._at = inside.copy(), np.flatnonzero(inside)
        at = self._at
        # Rows before columns: half of the time of a few hundred variables.
        (self._factor,) = _lapack("potrf", self.H[at][:, at].T, lower=True, overwrite_a=True)
        self._columns = np.empty((len(at), len(self.H)), order="F")
        self._made = np.zeros(len(self.H), bool)

    def _of(self, changed: np.ndarray) -> Float[np.ndarray, "base changed"]:
        """Z, of the columns of variables."""
        new = changed[~self._made[changed]]
        if len(new):
            assert self._base is not None
            columns = self.H[new[:, None], self._at]
            columns[self._base[new]] = self._at == new[self._base[new], None]
            self._columns[:, new] = self._solved(columns.T)
            self._made[new] = True
        return self._columns[:, changed]

    def _solved(self, right: np.ndarray, transposed: bool = False) -> np.ndarray:
        return _lapack("trtrs", self._factor, right, lower=True, trans=int(transposed))[0]


def _lapack(name: str, *matrices: np.ndarray, **how: Any) -> tuple[Any, ...]:
    """What a routine of LAPACK returns, without the wrappers that cost as much for few variables."""
    *found, failed = getattr(lapack, f"d{name}")(*matrices, **how)
    if failed:
        said = "The matrix of the normal equations is not positive definite."
        raise np.linalg.LinAlgError(said)
    return tuple(found)


def _rounding(b: Vector) -> float:
    """Slopes below this are rounding."""
    return 1e-12 * float(np.abs(b).max(initial=1e-300))


def constrained_least_squares(
    H: Matrix,
    b: Float[np.ndarray, "*draws n"],
    C: Float[np.ndarray, "constraints n"],
    free: Bool[np.ndarray, " n"],
    start: Bool[np.ndarray, " n"] | None,
) -> Float[np.ndarray, "*draws n"]:
    """As `nonnegative_least_squares`, with C x >= 0 besides.

    Method of multipliers: C x = s, s >= 0 joins the unknowns under the quadratic penalty
    kappa |C x - s - m|^2 / 2, and m collects what is left over, until |C x - s| < 1e-9 |x|.
    """
    n, k = len(H), len(C)
    kappa = 100 * np.trace(H) / n / max(np.mean(np.sum(C**2, 1)), 1e-300)
    E = np.hstack([C, -np.eye(k)])
    big = kappa * E.T @ E
    big[:n, :n] += H
    signed = SignedMinimum(big, np.append(free, np.zeros(k, bool)))
    inside = None if start is None else np.append(start, np.ones(k, bool))

    def of(b: Vector) -> Vector:
        z, there, multiplier = np.zeros(n + k), inside, np.zeros(k)
        for _ in range(30):
            right = kappa * E.T @ multiplier
            right[:n] += b
            z = signed.of(right, there)
            there = z != 0
            left_over = E @ z
            if np.abs(left_over).max(initial=0.0) <= 1e-9 * np.abs(z[:n]).max(initial=1e-300):
                break
            multiplier -= left_over
        return z[:n]

    return np.apply_along_axis(of, -1, b)
