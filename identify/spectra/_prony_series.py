"""Spring, dashpot and branches on a record: strengths by least squares with signs, times around them.

The answer to an input u is linear in the strengths c (compliances in creep, stiffnesses in relaxation):

    creep:       y = c0 u + c1 (integral of u) + sum of c_k L_k + offset
    relaxation:  y = c0 u                      + sum of c_k (u - L_k) + offset,

L_k = u through tau_k L' = u - L. In a hold at 1 from t = 0 on, after any way there, the integral is t and
that of the way, and 1 - L_k = left(tau_k) exp(-t / tau_k), with left = 1 - L_k at t = 0: 1 for a step.
Variable projection leaves only log tau to the outer search.

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

from ..linear._nnls import nonnegative_least_squares

Kind = Literal["creep", "relaxation"]
Rows = Float[np.ndarray, " rows"]
Matrix = Float[np.ndarray, "rows columns"]
Vector = Float[np.ndarray, " columns"]
Times = Float[np.ndarray, " branches"]
Branches = Float[np.ndarray, "rows branches"]


class Way(NamedTuple):
    """How an input came to the level of a hold: from rest, linear between its rows.

    - `t` (rows,): times before the hold, at most 0, increasing; the last is 0.
    - `u` (rows,): shares of the level, the last of them 1.
    """

    t: Float[np.ndarray, " rows"]
    u: Float[np.ndarray, " rows"]

    @property
    def sum(self) -> float:
        """Integral over the way."""
        return float(np.trapezoid(self.u, self.t))

    def left(self, tau: Float[np.ndarray, " branches"]) -> Float[np.ndarray, " branches"]:
        """1 - L at the hold's begin: sum over the ways du of the mean of exp(t / tau), a jump at first."""
        x = self.t[:, None] / tau
        length = np.diff(x, axis=0)
        mean = np.exp(x[1:]) * -np.expm1(-length) / np.maximum(length, 1e-300)
        return self.u[0] * np.exp(x[0]) + np.diff(self.u) @ mean


@dataclass(frozen=True)
class Input:
    """What the columns of the problem are made from.

    - `t` (rows,): times since the load came on.
    - `u` (rows,): the input, or None for a unit step at t = 0; then there is no offset either.
    - `way`: to a unit hold from t = 0 on, instead of a step.
    """

    kind: Kind
    t: Rows
    u: Rows | None
    way: Way | None = None

    @cached_property
    def memoryless(self) -> Float[np.ndarray, "rows memoryless"]:
        """Columns that no time constant changes: spring, dashpot (creep), offset (any input)."""
        if self.u is None:
            flowed = self.t if self.way is None else self.t + self.way.sum
            return np.stack([np.ones_like(self.t), flowed][: 2 if self.kind == "creep" else 1], 1)
        flow = np.append(0.0, np.cumsum(np.diff(self.t) * (self.u[1:] + self.u[:-1]) / 2))
        return np.stack([self.u, *([flow] if self.kind == "creep" else []), np.ones_like(flow)], 1)

    def branches(self, log_tau: Times) -> Branches:
        """One column for each time constant."""
        tau = np.exp(log_tau)
        if self.u is None:
            decay = np.exp(-self.t[:, None] / tau[None])
            if self.way is not None:
                decay = decay * self.way.left(tau)
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
    """An answer: strengths of the memoryless columns, then of the branches, and what is left over.

    - `residuals`: of the weighted rows.
    """

    log_tau: Times
    strengths: Vector
    residuals: Rows

    @property
    def memoryless(self) -> int:
        """Number of strengths that belong to memoryless columns."""
        return len(self.strengths) - len(self.log_tau)

    @property
    def parameters(self) -> int:
        """Number of fitted parameters: strengths that are not zero, and their time constants."""
        return int((self.strengths != 0).sum() + (self.strengths[self.memoryless :] != 0).sum())

    @property
    def mean_square(self) -> float:
        return float(np.mean(self.residuals**2))

    def outputs(self, at: Input) -> Rows:
        """The response to an input."""
        return np.hstack([at.memoryless, at.branches(self.log_tau)]) @ self.strengths


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
        u = None if u is None else u[which]
        part = Input(self.input.kind, self.input.t[which], u, self.input.way)
        return Problem(part, self.y[which], self.weights[which])

    def columns(self, log_tau: Times) -> Matrix:
        """Weighted columns of all strengths."""
        return self.weights[:, None] * np.hstack(
            [self.input.memoryless, self.input.branches(log_tau)]
        )

    def solve(self, log_tau: Times) -> tuple[Matrix, Vector]:
        """Columns and the best strengths for these time constants."""
        A = self.columns(log_tau)
        return A, strengths(A, self.target, self.free)

    def fit(self, log_tau: Times, bounds: tuple[float, float], most: int = 60) -> Fitted:
        """The time constants refined by Levenberg-Marquardt inside `bounds` (log)."""
        x = np.clip(log_tau, *bounds)
        A, c = self.solve(x)
        r = A @ c - self.target
        damping = 1e-3
        for _ in range(most if len(x) else 0):
            J = self._jacobian(x, A, c)
            size = np.linalg.norm(J, axis=0)
            g = J.T @ r
            # At a bound that it pushes against a time constant stays, and where nothing depends on it.
            inside = ((x > bounds[0]) | (g < 0)) & ((x < bounds[1]) | (g > 0))
            at = np.flatnonzero(inside & (size > 1e-12 * size.max()))
            U = J[:, at] / size[None, at]
            before = r @ r
            while damping < 1e9:
                trial = x.copy()
                H = U.T @ U + damping * np.eye(len(at))
                trial[at] -= np.linalg.solve(H, g[at] / size[at]) / size[at]
                trial = np.clip(trial, *bounds)
                A, c = self.solve(trial)
                left = A @ c - self.target
                if left @ left < before:
                    x, r, damping = trial, left, max(damping / 10, 1e-9)
                    break
                damping *= 10
            if damping >= 1e9 or r @ r > (1 - 1e-9) * before:
                break
        x = np.sort(x)
        A, c = self.solve(x)
        return Fitted(x, c, A @ c - self.target)

    def _jacobian(self, x: Times, A: Matrix, c: Vector) -> Branches:
        """Kaufman's Jacobian: the part of the columns' slopes that the strengths cannot compensate."""
        D = self.weights[:, None] * self.input.slopes(x) * c[None, len(c) - len(x) :]
        B = A[:, c != 0] / np.linalg.norm(A[:, c != 0], axis=0)[None]
        H = B.T @ B + 1e-13 * np.eye(B.shape[1])
        return D - B @ np.linalg.solve(H, B.T @ D)

    def covariance(self, fitted: Fitted) -> Float[np.ndarray, "numbers numbers"]:
        """Inverse of J'J, J = d residuals / d (strengths that are not zero, log tau of such branches).

        J'J is scaled to a unit diagonal, and raised by 1e-13, lest what the rows cannot tell ends the
        computation: it gets a variance of 1e13.
        """
        c, n = fitted.strengths, fitted.memoryless
        D = self.input.slopes(fitted.log_tau) * c[n:][None]
        J = np.hstack([self.columns(fitted.log_tau), self.weights[:, None] * D])
        J = J[:, np.append(c, c[n:]) != 0]
        scale = np.linalg.norm(J, axis=0)
        J /= scale[None]
        inverse = np.linalg.inv(J.T @ J + 1e-13 * np.eye(len(scale)))
        return inverse / (scale[:, None] * scale[None])


def strengths(A: Matrix, target: Rows, free: Bool[np.ndarray, " memoryless"]) -> Vector:
    """Least squares with c >= 0, except for the free ones among the first, memoryless columns."""
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    scaled = A / size[None]
    # Close time constants have columns that are alike: a weak prior keeps the factors.
    H = scaled.T @ scaled + 1e-13 * np.eye(len(size))
    signs = np.append(free, np.zeros(len(size) - len(free), bool))
    return nonnegative_least_squares(H, scaled.T @ target, signs) / size
