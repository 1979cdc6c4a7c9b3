"""What a spectrum's record allows beyond its own span: the range over all spectra that fit it.

With strengths c >= 0 on a fine grid of time constants, tau from a third of the record's step to a
hundred spans, the record's squared residuals are a quadratic q(c) with minimum q0. The whole curve of
the true spectrum lies, with 90 % (Scheffé), among the curves of

    C = { c >= 0 :  q(c) <= q0 (1 + p F / (m - p)) },

p numbers fitted, m independent facts in the residuals, F the 90 % point of F(p, m - p). At a time t the
range is the least and the largest e(t)'c over C, e(t) the answer of each column. Each is found from
the minimum of q(c) / 2 -+ lambda e'c, with lambda as large as C lets it be: of one lambda inside and one
beyond, the mixture of both spectra that is at the limit. No prior is needed: where the record says
nothing of slow processes, the range runs from none of them to as many as fit.

Source: Stark, Inference in infinite-dimensional inverse problems, J. Geophys. Res. 97 (1992), strict
bounds; Scheffé, The Analysis of Variance (1959).
"""

from typing import NamedTuple

import numpy as np
import scipy.special
from jaxtyping import Float

from .._levels import CONFIDENCE, HELD, LITTLE
from ..linear._nnls import SignedMinimum
from ..noise._residual_statistics import Noise
from ._dense_spectrum import A_DECADE
from ._prony_series import Fitted, Input, Problem, response, to_unit

BEYOND = np.geomspace(1.0, 100.0, 10)
"""Times, in spans of the record, at which the extremes of a step's answer are looked for. Inside the record
they are as many a decade as the grid has; in between the range is a little narrow."""
TRIED = 10
"""Values of lambda tried, at most; one so near to the limit is taken for it."""


class Allowed(NamedTuple):
    """Spectra at the edge of what a record allows, on one grid.

    - `log_tau`: time constants of the branches.
    - `strengths`: of the memoryless columns and of the branches, one row for each spectrum; the first
      is that of the fit.
    """

    log_tau: Float[np.ndarray, " branches"]
    strengths: Float[np.ndarray, "spectra columns"]

    def outputs(self, at: Input) -> Float[np.ndarray, "spectra times"]:
        """The responses of all of them to an input."""
        return response(at, self.log_tau, self.strengths)

    def fitted(self, at: Input) -> Float[np.ndarray, " times"]:
        """The response of the fit."""
        return self._replace(strengths=self.strengths[:1]).outputs(at)[0]


def allowed(problem: Problem, fitted: Fitted, noise: Noise, step: float, span: float) -> Allowed:
    """The fitted spectrum, and those that minimise and maximise the step response at each time."""
    slowest = span * BEYOND[-1]
    count = int(A_DECADE * np.log10(3 * slowest / step))
    even = np.linspace(np.log(step / 3), np.log(slowest), count)
    # A time constant beside a fitted one changes no range by 0.2 %, and costs a third of the time.
    beside = np.abs(even[:, None] - fitted.log_tau).min(1, initial=np.inf) < 0.25 * (
        even[1] - even[0]
    )
    log_tau = np.append(fitted.log_tau, even[~beside])
    fit = np.zeros(fitted.memoryless + len(log_tau))
    fit[: len(fitted.strengths)] = fitted.strengths

    A, size = to_unit(problem.columns(log_tau))
    # The grid's columns are alike to rounding: a weak prior, 3e-5 of the output, keeps the factors.
    H = A.T @ A + 1e-9 * np.eye(len(size))
    b, free = A.T @ problem.target, np.append(problem.free, np.zeros(len(log_tau), bool))

    def left(c: Float[np.ndarray, " columns"]) -> Float[np.ndarray, " rows"]:
        return A @ c - problem.target

    signed = SignedMinimum(H, free)
    best = signed.from_feasible(b, fit * size)
    least = float(np.sum(left(best) ** 2))
    facts = max(min(noise.effective, len(A)) - fitted.parameters, 1.0)
    quantile = float(scipy.special.fdtri(fitted.parameters, facts, CONFIDENCE))
    limit = least * (1 + fitted.parameters * quantile / facts)

    found, near = [fit], dict.fromkeys((1.0, -1.0), (LITTLE, best))
    for e in _step_answers(problem, log_tau, step, span) / size:
        unit = limit / (np.linalg.norm(e) * np.linalg.norm(best))
        # The edge at the time before is near.
        for sign, (way, c) in near.items():
            inner, low, outer, high = best, 0.0, None, np.inf
            for _ in range(TRIED):
                c = signed.from_feasible(b + way * sign * unit * e, c)
                used = (np.sum(left(c) ** 2) - least) / (limit - least)
                if used <= 1:
                    inner, low = c, way
                else:
                    outer, high = c, way
                if low and used < 2 and (outer is not None or used > 1 - HELD):
                    break
                # Among spectra of the same branches the square grows by that of lambda.
                aim = 0.8 if used > 1 else 1.2
                guess = way * float(np.clip(np.sqrt(aim / max(used, 1e-12)), 1e-3, 1e3))
                way = guess if low < guess < high else float(np.sqrt(low * high))
            near[sign] = way, c
            if outer is not None:
                inner = inner + _share(left(inner), A @ (outer - inner), limit) * (outer - inner)
            found.append(inner / size)
    rows = np.array(found)
    for k, value in problem.known:
        rows[:, k] = value
    return Allowed(log_tau, rows)


def _share(r: Float[np.ndarray, " rows"], d: Float[np.ndarray, " rows"], limit: float) -> float:
    """The s > 0 of |r + s d|^2 = limit."""
    square, cross, rest = d @ d, r @ d, r @ r - limit
    return float((np.sqrt(cross**2 - square * rest) - cross) / square)


def _step_answers(
    problem: Problem, log_tau: Float[np.ndarray, " branches"], step: float, span: float
) -> Float[np.ndarray, "times columns"]:
    """The unit step response of each column, 0 for an offset, at the times of the search."""
    count = 1 + int(A_DECADE * np.log10(span / step))
    inside = np.geomspace(step, span, count, endpoint=False)
    way = problem.inputs[0].way
    at = Input(problem.kind, np.append(inside, span * BEYOND), way=way)
    memoryless = np.zeros((len(at.t), len(problem.free)))
    memoryless[:, : at.memoryless.shape[1]] = at.memoryless
    return np.hstack([memoryless, at.branches(log_tau)])
