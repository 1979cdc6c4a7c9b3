"""Spring, dashpot and branches on a record: strengths by least squares with signs, times around them.

The answer to an input u is linear in the strengths c (compliances in creep, stiffnesses in relaxation):

    creep:       y = c0 u + c1 (integral of u) + sum of c_k L_k + offset
    relaxation:  y = c0 u                      + sum of c_k (u - L_k) + offset,

L_k = u through tau_k L' = u - L. Variable projection leaves only log tau to the outer search.

Source: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973); Kaufman, BIT 15 (1975) for the Jacobian.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from hysteresis import GeneralizedKelvinVoigt

from ._nonnegative import nonnegative_least_squares

Kind = Literal["creep", "relaxation"]
Rows = Float[np.ndarray, " rows"]
Matrix = Float[np.ndarray, "rows columns"]
Vector = Float[np.ndarray, " columns"]
Times = Float[np.ndarray, " branches"]
Branches = Float[np.ndarray, "rows branches"]


@dataclass(frozen=True)
class Input:
    """What the columns of the problem are made from.

    - `t` (rows,): times since the load came on.
    - `u` (rows,): the input, or None for a unit step at t = 0; then there is no offset either.
    """

    kind: Kind
    t: Rows
    u: Rows | None

    @cached_property
    def memoryless(self) -> Float[np.ndarray, "rows memoryless"]:
        """Columns that no time constant changes: spring, dashpot (creep), offset (any input)."""
        if self.u is None:
            return np.stack([np.ones_like(self.t), self.t][: 2 if self.kind == "creep" else 1], 1)
        flow = np.append(0.0, np.cumsum(np.diff(self.t) * (self.u[1:] + self.u[:-1]) / 2))
        return np.stack([self.u, *([flow] if self.kind == "creep" else []), np.ones_like(flow)], 1)

    def branches(self, log_tau: Times) -> Branches:
        """One column for each time constant."""
        tau = np.exp(log_tau)
        if self.u is None:
            decay = np.exp(-self.t[:, None] / tau[None])
            return 1 - decay if self.kind == "creep" else decay
        delayed = np.asarray(_delayed(self.t, self.u, tau)).T
        return delayed if self.kind == "creep" else self.u[:, None] - delayed

    def slopes(self, log_tau: Times) -> Branches:
        """d branches / d log tau, by central differences: right to 1e-8 of a column."""
        h = 1e-4
        return (self.branches(log_tau + h) - self.branches(log_tau - h)) / (2 * h)


@jax.jit
def _delayed(t: jax.Array, u: jax.Array, tau: jax.Array) -> jax.Array:
    def one(tau: jax.Array) -> jax.Array:
        element = GeneralizedKelvinVoigt(jnp.inf, jnp.ones(1), tau[None])
        return element.simulate(t, u)

    return jax.vmap(one)(tau)


class Fitted(NamedTuple):
    """An answer: strengths of the memoryless columns and of the branches, and what is left over.

    - `used`: which memoryless columns were offered.
    - `fixed`: how many of the last time constants were given and not searched.
    - `residuals`: of the weighted rows.
    """

    log_tau: Times
    strengths: Vector
    residuals: Rows
    used: Bool[np.ndarray, " memoryless"]
    fixed: int

    @property
    def parameters(self) -> int:
        """Numbers that were fitted: strengths that are not zero, and their times."""
        branches = self.strengths[len(self.used) :]
        return int(
            (self.strengths != 0).sum() + (branches[: len(branches) - self.fixed] != 0).sum()
        )

    @property
    def mean_square(self) -> float:
        return float(np.mean(self.residuals**2))


@dataclass(frozen=True)
class Problem:
    """Rows with weights: residuals are `weights` * (y - columns @ strengths)."""

    input: Input
    y: Rows
    weights: Rows

    @cached_property
    def target(self) -> Rows:
        return self.weights * self.y

    @cached_property
    def free(self) -> Bool[np.ndarray, " memoryless"]:
        """An offset has either sign."""
        n = self.input.memoryless.shape[1]
        return np.arange(n) == (n - 1 if self.input.u is not None else n)

    def rows(self, which: slice) -> "Problem":
        """The problem on some rows: with an input on adjoining ones only, since its path matters."""
        u = self.input.u
        part = Input(self.input.kind, self.input.t[which], None if u is None else u[which])
        return Problem(part, self.y[which], self.weights[which])

    def columns(self, log_tau: Times) -> Matrix:
        """Weighted columns of all strengths."""
        return self.weights[:, None] * np.hstack(
            [self.input.memoryless, self.input.branches(log_tau)]
        )

    def solve(self, log_tau: Times, used: Bool[np.ndarray, " memoryless"]) -> tuple[Matrix, Vector]:
        """Columns and the best strengths for these time constants."""
        A = self.columns(log_tau)
        return A, strengths(A, self.target, self.free, used)

    def fit(
        self,
        log_tau: Times,
        bounds: tuple[float, float],
        used: Bool[np.ndarray, " memoryless"],
        fixed: int = 0,
        most: int = 60,
    ) -> Fitted:
        """The time constants refined by Levenberg-Marquardt, but for the last `fixed` ones, inside
        `bounds` (log)."""
        n = len(log_tau) - fixed
        x = np.append(np.clip(log_tau[:n], *bounds), log_tau[n:])
        A, c = self.solve(x, used)
        r = A @ c - self.target
        damping = 1e-3
        for _ in range(most if n else 0):
            J = self._jacobian(x[:n], A, c, len(used))
            size = np.linalg.norm(J, axis=0)
            g = J.T @ r
            # At a bound that it pushes against a time constant stays, and where nothing depends on it.
            inside = ((x[:n] > bounds[0]) | (g < 0)) & ((x[:n] < bounds[1]) | (g > 0))
            at = np.flatnonzero(inside & (size > 1e-12 * size.max()))
            U = J[:, at] / size[None, at]
            before = r @ r
            while damping < 1e9:
                trial = x.copy()
                H = U.T @ U + damping * np.eye(len(at))
                trial[at] -= np.linalg.solve(H, g[at] / size[at]) / size[at]
                trial[:n] = np.clip(trial[:n], *bounds)
                A, c = self.solve(trial, used)
                left = A @ c - self.target
                if left @ left < before:
                    x, r, damping = trial, left, max(damping / 10, 1e-9)
                    break
                damping *= 10
            if damping >= 1e9 or r @ r > (1 - 1e-9) * before:
                break
        x[:n] = np.sort(x[:n])
        A, c = self.solve(x, used)
        return Fitted(x, c, A @ c - self.target, used, fixed)

    def _jacobian(self, x: Times, A: Matrix, c: Vector, memoryless: int) -> Branches:
        """Kaufman's: what the strengths cannot make up for of the columns' slopes."""
        D = self.weights[:, None] * self.input.slopes(x) * c[None, memoryless:][:, : len(x)]
        B = A[:, c != 0] / np.linalg.norm(A[:, c != 0], axis=0)[None]
        H = B.T @ B + 1e-13 * np.eye(B.shape[1])
        return D - B @ np.linalg.solve(H, B.T @ D)

    def covariance(self, fitted: Fitted) -> Float[np.ndarray, "active active"]:
        """Inverse of J'J for the strengths that are not zero and their searched times.

        Directions that the rows do not tell are cut off where J'J, scaled to a unit diagonal, falls
        below 1e-12.
        """
        J = self.weights[:, None] * self.input_jacobian(self.input, fitted)
        scale = np.linalg.norm(J, axis=0)
        return np.linalg.pinv((J / scale[None]).T @ (J / scale[None]), 1e-12, hermitian=True) / (
            scale[:, None] * scale[None]
        )

    @staticmethod
    def input_jacobian(input: Input, fitted: Fitted) -> Float[np.ndarray, "rows numbers"]:
        """d y / d (strengths that are not zero, their searched times), on the rows of any input."""
        n, c = len(fitted.used), fitted.strengths
        columns = np.hstack([input.memoryless, input.branches(fitted.log_tau)])
        searched = np.arange(len(fitted.log_tau)) < len(fitted.log_tau) - fitted.fixed
        moving = searched & (c[n:] != 0)
        D = input.slopes(fitted.log_tau)[:, moving] * c[n:][None, moving]
        return np.hstack([columns[:, c != 0], D])


def strengths(
    A: Matrix,
    target: Rows,
    free: Bool[np.ndarray, " memoryless"],
    used: Bool[np.ndarray, " memoryless"],
) -> Vector:
    """Least squares with c >= 0, but for the free ones; 0 for memoryless columns that are not used."""
    branches = np.ones(A.shape[1] - len(used), bool)
    offered = np.append(used, branches)
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    scaled = (A / size[None])[:, offered]
    # Close time constants have columns that are alike: a weak prior keeps the factors.
    H = scaled.T @ scaled + 1e-13 * np.eye(offered.sum())
    c = np.zeros(A.shape[1])
    c[offered] = nonnegative_least_squares(
        H, scaled.T @ target, np.append(free, ~branches)[offered]
    )
    return c / size
