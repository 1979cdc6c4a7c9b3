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

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.special
from jaxtyping import Complex, Float
from scipy.optimize import least_squares

from .._levels import CONFIDENCE, HELD, LITTLE
from ..linear._nnls import SignedMinimum
from ..noise._residual_statistics import Noise
from ._dense_spectrum import A_DECADE
from ._prony_series import Fitted, Input, Kind, Problem, response, to_unit

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


# Fractional elements as a summary of a spectrum: a springpot's two numbers, a fractional Zener's four.

FREQUENCIES_A_DECADE = 10
"""Frequencies at which an element is compared with its spectrum."""

Modulus = Complex[np.ndarray, " frequencies"]


class Fractional(NamedTuple):
    """A fractional element beside the spectrum that it sums up.

    - `name`: "springpot" or "fractional Zener". `names`: of its numbers.
    - `value`: of the fitted spectrum. `low`, `high`: over all spectra at the edge of what the rows allow
      with 90 % confidence.
    - `misfit`: rms of its complex modulus, relative to the spectrum's, over the frequencies of the rows.
    """

    name: str
    names: tuple[str, ...]
    value: Float[np.ndarray, " numbers"]
    low: Float[np.ndarray, " numbers"]
    high: Float[np.ndarray, " numbers"]
    misfit: float

    def __str__(self) -> str:
        each = zip(self.names, self.value, self.low, self.high, strict=True)
        said = ", ".join(f"{name} {x:.3g} ({low:.3g} to {high:.3g})" for name, x, low, high in each)
        return f"{self.name}: {said}; it is {100 * self.misfit:.2g} % off the spectrum"


def springpot(z: np.ndarray, omega: np.ndarray) -> Modulus:
    """V (i w)^alpha of z = (log V, alpha)."""
    return np.exp(z[0]) * (1j * omega) ** z[1]


def zener(z: np.ndarray, omega: np.ndarray) -> Modulus:
    """E_inf + (E_0 - E_inf) x / (1 + x), x = (i w tau)^alpha, of z = (log E_inf, log (E_0 - E_inf),
    log tau, logit alpha)."""
    x = (1j * omega * np.exp(z[2])) ** (1 / (1 + np.exp(-z[3])))
    return np.exp(z[0]) + np.exp(z[1]) * x / (1 + x)


def fractional_of(
    kind: Kind, allowed: Allowed, step: float, span: float
) -> tuple[Fractional, Fractional]:
    """Both elements, each nearest to the logarithm of the complex modulus of the first of these spectra."""
    omega = np.geomspace(
        1 / span, 1 / step, FREQUENCIES_A_DECADE * max(int(np.log10(span / step)), 1)
    )
    real, imaginary = np.hsplit(allowed.outputs(Input(kind, omega, oscillation=True)), 2)
    moduli = real + 1j * imaginary if kind == "relaxation" else 1 / (real - 1j * imaginary)
    size = np.log(np.abs(moduli[0]))
    alpha = np.polyfit(np.log(omega), size, 1)[0]
    middle = -float(np.mean(np.log(omega)))
    starts = [np.array([size.min() - 1, size.max(), middle, a]) for a in (-1.0, 0.0, 2.0)]
    pots = np.array([size.mean() + alpha * middle, alpha])
    return (
        _summed(springpot, ("V", "alpha"), [pots], moduli, omega),
        _summed(zener, ("E_inf", "E_0", "tau", "alpha"), starts, moduli, omega),
    )


def _summed(
    element: Callable[[np.ndarray, np.ndarray], Modulus],
    names: tuple[str, ...],
    starts: Sequence[np.ndarray],
    moduli: Complex[np.ndarray, "spectra frequencies"],
    omega: Float[np.ndarray, " frequencies"],
) -> Fractional:
    def nearest(start: np.ndarray, modulus: Modulus) -> Any:
        def off(z: np.ndarray) -> np.ndarray:
            apart = np.log(element(z, omega) / modulus)
            return np.append(np.real(apart), np.imag(apart))

        return least_squares(off, start, bounds=(start - 40, start + 40))

    best = min((nearest(start, moduli[0]) for start in starts), key=lambda found: found.cost).x
    each = [_numbers(names, nearest(best, modulus).x) for modulus in moduli]
    misfit = np.sqrt(np.mean(np.abs(element(best, omega) / moduli[0] - 1) ** 2))
    name = "springpot" if len(names) == 2 else "fractional Zener"
    return Fractional(
        name, names, _numbers(names, best), np.min(each, 0), np.max(each, 0), float(misfit)
    )


def _numbers(names: tuple[str, ...], z: np.ndarray) -> np.ndarray:
    if len(names) == 2:
        return np.array([np.exp(z[0]), z[1]])
    low, more, tau = np.exp(z[:3])
    return np.array([low, low + more, tau, 1 / (1 + np.exp(-z[3]))])
