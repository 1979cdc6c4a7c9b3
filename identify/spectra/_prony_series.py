"""Spring, dashpot and branches on records of any clock: signed least squares, and a search for the times.

The answer to an input u is linear in the strengths c (compliances in creep, stiffnesses in relaxation):

    creep:       y = c0 u + c1 (integral of u) + sum of c_k L_k + offset
    relaxation:  y = c0 u                      + sum of c_k (u - L_k) + offset,

L_k = u through tau_k L' = u - L. In a hold at 1 from t = 0 on, after any way there, the integral is t and
that of the way, and 1 - L_k = left(tau_k) exp(-t / tau_k), with left = 1 - L_k at t = 0: 1 for a step.
Under exp(i w t) the integral is 1 / (i w) and L_k = 1 / (1 + i w tau_k): real parts are rows of their own,
and imaginary parts with the sign that makes losses positive. One problem holds records of all these clocks.
Variable projection leaves only log tau to the outer search.

Source: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973); Kaufman, BIT 15 (1975) for the Jacobian; Ferry,
Viscoelastic Properties of Polymers (1980), chapter 3.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import leastsq

from hysteresis import GeneralizedKelvinVoigt

from ..linear._nnls import SignedMinimum

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
    """What the columns of one record are made from.

    - `t` (rows,): times since the load came on; of an `oscillation` angular frequencies, each of which has
      two rows: all in-phase ones, then all others.
    - `u` (rows,): the input, or None for a unit step at t = 0; then there is no offset either.
    - `way`: to a unit hold from t = 0 on, instead of a step.
    """

    kind: Kind
    t: Rows
    u: Rows | None = None
    way: Way | None = None
    oscillation: bool = False

    @cached_property
    def memoryless(self) -> Float[np.ndarray, "rows memoryless"]:
        """Columns that no time constant changes: spring and, in creep, dashpot."""
        if self.oscillation:
            none = np.zeros_like(self.t)
            spring, flowed = np.append(none + 1, none), np.append(none, 1 / self.t)
        elif self.u is None:
            spring = np.ones_like(self.t)
            flowed = self.t if self.way is None else self.t + self.way.sum
        else:
            spring = self.u
            flowed = np.append(0.0, np.cumsum(np.diff(self.t) * (self.u[1:] + self.u[:-1]) / 2))
        return np.stack([spring, flowed][: 2 if self.kind == "creep" else 1], 1)

    def branches(self, log_tau: Times) -> Branches:
        """One column for each time constant."""
        tau, creep = np.exp(log_tau), self.kind == "creep"
        if self.oscillation:
            x = self.t[:, None] * tau
            loss = 1 / (x + 1 / x)
            return np.concatenate([loss / x if creep else loss * x, loss])
        if self.u is None:
            decay = np.exp(-self.t[:, None] / tau[None])
            if self.way is not None:
                decay = decay * self.way.left(tau)
            return 1 - decay if creep else decay
        delayed = np.asarray(_delayed(self.t, self.u, tau)).T
        return delayed if creep else self.u[:, None] - delayed


@jax.jit
def _delayed(t: jax.Array, u: jax.Array, tau: jax.Array) -> jax.Array:
    def one(tau: jax.Array) -> jax.Array:
        element = GeneralizedKelvinVoigt(jnp.inf, jnp.ones(1), tau[None])
        return element.simulate(t, u)

    return jax.vmap(one)(tau)


class Fitted(NamedTuple):
    """An answer: strengths of the memoryless columns, then of the branches, and what is left over.

    - `memoryless`: how many strengths belong to memoryless columns.
    - `residuals`: of the weighted rows.
    - `known`: of each strength, whether it was given. `times_known`: whether the time constants were.
    - `prior`: precision of the strengths before any row was seen, in units of the squared residual, if any.
      `effective`: the number of parameters that the rows then choose.
    """

    log_tau: Times
    strengths: Vector
    memoryless: int
    residuals: Rows
    known: Bool[np.ndarray, " columns"]
    times_known: bool = False
    prior: Float[np.ndarray, "columns columns"] | None = None
    effective: float = 0.0

    @property
    def chosen(self) -> Bool[np.ndarray, " numbers"]:
        """Of strengths, then time constants: is it fitted and there?"""
        there = (self.strengths != 0) & ~self.known
        return np.append(there, (self.strengths[self.memoryless :] != 0) & (not self.times_known))

    @property
    def parameters(self) -> int:
        """Number of fitted parameters: strengths that are not zero, and their time constants."""
        return int(self.chosen.sum()) if self.prior is None else round(self.effective)

    @property
    def mean_square(self) -> float:
        """Of the residuals of rows that count: one without a weight has none."""
        return float(self.residuals @ self.residuals / max(np.count_nonzero(self.residuals), 1))

    def outputs(self, at: Input) -> Rows:
        """The response to an input. An offset belongs to an input that moves."""
        return response(at, self.log_tau, self.strengths)


def response(
    at: Input, log_tau: Times, strengths: Float[np.ndarray, "*spectra columns"]
) -> Float[np.ndarray, "*spectra rows"]:
    """The outputs of one or several spectra. An offset belongs to an input that moves."""
    own, first = at.memoryless, strengths.shape[-1] - len(log_tau)
    made = strengths[..., : own.shape[1]] @ own.T + strengths[..., first:] @ at.branches(log_tau).T
    return made if at.u is None else made + strengths[..., first - 1 : first]


@dataclass(frozen=True)
class Problem:
    """Rows with weights of one or several records: residuals are `weights` * (y - columns @ strengths).

    Each record whose input moves has an offset of its own. `known`: strengths that are given, by column.
    """

    inputs: tuple[Input, ...]
    y: Rows
    weights: Rows
    known: tuple[tuple[int, float], ...] = ()

    @property
    def kind(self) -> Kind:
        return self.inputs[0].kind

    @cached_property
    def memoryless(self) -> Float[np.ndarray, "rows memoryless"]:
        """Spring and dashpot of all records, then an offset of each whose input moves."""
        parts = [one.memoryless for one in self.inputs]
        moved = [k for k, one in enumerate(self.inputs) if one.u is not None]
        offsets = [
            np.concatenate([np.full(len(own), float(k == j)) for j, own in enumerate(parts)])
            for k in moved
        ]
        return np.column_stack([np.concatenate(parts), *offsets])

    @cached_property
    def given(self) -> Bool[np.ndarray, " memoryless"]:
        """Memoryless columns whose strengths are known."""
        return np.isin(np.arange(self.memoryless.shape[1]), [k for k, _ in self.known])

    @cached_property
    def target(self) -> Rows:
        return self.weights * (self.y - sum(x * self.memoryless[:, k] for k, x in self.known))

    @cached_property
    def free(self) -> Bool[np.ndarray, " memoryless"]:
        """An offset has either sign."""
        return np.arange(self.memoryless.shape[1]) >= self.inputs[0].memoryless.shape[1]

    def thinned(self, most: int) -> "Problem":
        """About so many rows of a single step, which is the same problem on any of its rows."""
        stride = len(self.y) // most
        one = self.inputs[0]
        if stride < 2 or len(self.inputs) > 1 or one.u is not None or one.oscillation:
            return self
        few = replace(one, t=one.t[::stride])
        return replace(self, inputs=(few,), y=self.y[::stride], weights=self.weights[::stride])

    def columns(self, log_tau: Times) -> Matrix:
        """Weighted columns of all strengths; those of known ones are 0."""
        branches = np.concatenate([one.branches(log_tau) for one in self.inputs])
        return self.weights[:, None] * np.hstack([self.memoryless * ~self.given, branches])

    def slopes(self, log_tau: Times, columns: Matrix) -> Branches:
        """Weighted d branches / d log tau, by differences from the columns: right to 1e-6 of one."""
        h = 1e-6
        return (self.columns(log_tau + h) - columns)[:, len(self.free) :] / h

    def solve(self, log_tau: Times) -> tuple[Matrix, Vector]:
        """Columns and the best strengths for these time constants."""
        A = self.columns(log_tau)
        return A, strengths(A, self.target, self.free)

    def answer(self, log_tau: Times, c: Vector, residuals: Rows, **how: Any) -> Fitted:
        """The strengths found, with those that were known in their places."""
        c, count = c.copy(), len(self.free)
        known = np.append(self.given, np.zeros(len(log_tau), bool))
        for k, value in self.known:
            c[k] = value
        return Fitted(log_tau, c, count, residuals, known, **how)

    def at(self, log_tau: Times) -> Fitted:
        """The answer with these time constants."""
        A, c = self.solve(log_tau)
        return self.answer(log_tau, c, A @ c - self.target, times_known=True)

    def fit(self, log_tau: Times, bounds: tuple[float, float], most: int = 60) -> Fitted:
        """The time constants refined inside `bounds` (log) by so many steps, at most."""

        # Residuals and Jacobian are asked for at the same point, one after the other.
        solved = lru_cache(1)(lambda point: self.solve(np.clip(np.frombuffer(point), *bounds)))

        def residuals(x: Times) -> Rows:
            A, c = solved(x.tobytes())
            return A @ c - self.target

        def jacobian(x: Times) -> Branches:
            # Beyond a bound nothing changes.
            return self._jacobian(near := np.clip(x, *bounds), *solved(x.tobytes())) * (near == x)

        x = np.clip(log_tau, *bounds)
        if 0 < len(x) <= len(self.y):
            # MINPACK's takes half of the time of SciPy's own, which knows bounds.
            how: Any = {"Dfun": jacobian, "ftol": 1e-7, "maxfev": most, "full_output": True}
            x = np.sort(np.clip(leastsq(residuals, x, **how)[0], *bounds))
        return self.at(x)._replace(times_known=False)

    def _jacobian(self, x: Times, A: Matrix, c: Vector) -> Branches:
        """Kaufman's Jacobian: the part of the columns' slopes that the strengths cannot compensate."""
        D = self.slopes(x, A) * c[len(self.free) :]
        B, _ = to_unit(A[:, c != 0])
        H = B.T @ B + 1e-13 * np.eye(B.shape[1])
        return D - B @ np.linalg.solve(H, B.T @ D)

    def linearised(
        self, fitted: Fitted
    ) -> tuple[Matrix, Float[np.ndarray, "numbers numbers"], Float[np.ndarray, " numbers"]]:
        """J = d residuals / d (fitted strengths that are not zero, log tau); the prior's precision of them,
        and its slope."""
        A, on = self.columns(fitted.log_tau), fitted.chosen
        D = self.slopes(fitted.log_tau, A) * fitted.strengths[fitted.memoryless :]
        J = np.hstack([A, D])[:, on]
        if fitted.prior is None:
            return J, np.zeros(2 * (J.shape[1],)), np.zeros(J.shape[1])
        own = on[: len(fitted.strengths)]
        prior = fitted.prior[np.ix_(own, own)]
        return J, prior, prior @ fitted.strengths[own]

    def covariance(self, fitted: Fitted) -> Float[np.ndarray, "numbers numbers"]:
        """Inverse of J'J and any prior, see `linearised`.

        J'J is scaled to a unit diagonal, and raised by 1e-13, lest what the rows cannot tell ends the
        computation: it gets a variance of 1e13.
        """
        J, prior, _ = self.linearised(fitted)
        H = J.T @ J + prior
        scale = np.sqrt(np.diagonal(H))
        inverse = np.linalg.inv(H / (scale[:, None] * scale) + 1e-13 * np.eye(len(scale)))
        return inverse / (scale[:, None] * scale[None])


def to_unit(A: Matrix) -> tuple[Matrix, Vector]:
    """Columns of unit size, and their sizes before; 1 for one that is 0."""
    size = np.sqrt(np.einsum("rc,rc->c", A, A))
    size[size == 0] = 1.0
    return A / size, size


def strengths(A: Matrix, target: Rows, free: Bool[np.ndarray, " memoryless"]) -> Vector:
    """Least squares with c >= 0, except for the free ones among the first, memoryless columns."""
    scaled, size = to_unit(A)
    # Close time constants have columns that are alike: a weak prior keeps the factors.
    H = scaled.T @ scaled + 1e-13 * np.eye(len(size))
    signs = np.append(free, np.zeros(len(size) - len(free), bool))
    return SignedMinimum(H, signs).of(scaled.T @ target) / size
