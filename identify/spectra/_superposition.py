"""Time-temperature superposition: one spectrum for all temperatures, whose times are a(T) times as long.

The factors a(T) and the spectrum are fitted together. With the strengths solved for inside, a residual's
slope along log a of its temperature is that along all log time constants, less what other strengths make
up for (variable projection), so the errors of the factors know of the freedom of the spectrum. What one
spectrum leaves over more than one of each temperature, beyond chance, is no noise: it widens the errors as
if it lay along whole runs. The search begins where neighbouring temperatures overlap best as one parabola
in the logarithms. Then a law follows:

    WLF:        log10 a = -C1 (T - Tr) / (C2 + T - Tr),
    Arrhenius:  ln a = E / R (1 / T - 1 / Tr).

Source: Ferry, Viscoelastic Properties of Polymers (1980), chapter 11; Williams, Landel, Ferry, J. Am. Chem.
Soc. 77 (1955); Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973).
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.constants import R, zero_Celsius
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from hysteresis import InputError

from .._levels import STEPS
from ._dense_spectrum import Smoothed, dense_spectrum, smoothed
from ._prony_series import Fitted, Problem
from ._response import Response, problem_of, resolved
from ._spectrum import BEYOND, Spectrum, noise_of, spectrum

PerTemperature = Float[np.ndarray, " temperatures"]
NEAR = 0.5
"""Kelvins within which a temperature is that of a run."""


class Shifts(NamedTuple):
    """How much longer all times are at each temperature.

    - `temperature` (degC), `log_a`: log10 a(T), 0 at the `reference`; `error`: its standard error.
    - `law`: "WLF", with `constants` C1 and C2 (K), or "Arrhenius", with E (kJ / mol); `law_error`: rms of
      log10 a about it.
    - `left`: rms of the weighted residuals at each temperature; `alone`: those of a spectrum of its own.
      What the first has more is what one spectrum for all temperatures leaves over.
    """

    temperature: PerTemperature
    log_a: PerTemperature
    error: PerTemperature
    reference: float
    law: Literal["WLF", "Arrhenius"]
    constants: tuple[float, ...]
    law_error: float
    left: PerTemperature
    alone: PerTemperature

    def at(self, temperature: float) -> float:
        """log10 a at a temperature (degC): that of a run within half a kelvin, else that of the law."""
        near = int(np.argmin(np.abs(self.temperature - temperature)))
        if abs(self.temperature[near] - temperature) <= NEAR:
            return float(self.log_a[near])
        return self.by_law(temperature)

    def by_law(self, temperature: float) -> float:
        """log10 a by the law alone."""
        constants = np.array(self.constants)
        return float(_law(self.law, constants, np.array([temperature]), self.reference)[0])


class MasterCurve(NamedTuple):
    """The spectrum at the reference temperature, and the shifts of the others."""

    spectrum: Spectrum
    shifts: Shifts


# As in `spectrum`: threads of BLAS wait for each other.
@threadpool_limits.wrap(limits=1, user_api="blas")
def master_curve(
    responses: Sequence[Response],
    temperatures: Any,
    reference: float | None = None,
    **asked: Any,
) -> MasterCurve:
    """One spectrum of responses at several temperatures, and by what factor each stretches the times.

    **Arguments:**

    - `responses`: one for each temperature, all of one kind: moduli, or answers to a unit step.
    - `temperatures`: in degC. `reference`: the one whose factor is 1, the nearest to it; by default the
      middle one.
    - `asked`: options of `spectrum`.

    Raises `InputError` as `spectrum` does, and for fewer than two temperatures.

    **Example:**

        >>> w = np.geomspace(0.1, 10, 12)
        >>> at = [1 + 9j * w * a / (1 + 1j * w * a) + 3j * w * a / (30 + 1j * w * a) for a in (1, 0.3)]
        >>> both = [identify.Response(w, y, "modulus") for y in at]
        >>> identify.master_curve(both, [20.0, 40.0], 20.0).shifts.log_a.round(2).tolist()
        [0.0, -0.52]
    """
    T = np.asarray(temperatures, float)
    if len(T) < 2 or len(T) != len(responses):
        raise InputError(
            "too-few-rows",
            f"{len(T)} temperatures for {len(responses)} responses: two runs at least can be shifted.",
            fix="leave out --condition, or name the column that tells runs apart (--group COL).",
        )
    order = np.argsort(T, kind="stable")
    T, responses = T[order], [responses[k] for k in order]
    at = len(T) // 2 if reference is None else int(np.argmin(np.abs(T - reference)))
    problem = problem_of(responses)
    own = [_alone(problem_of([one])) for one in responses]
    log_a, error = _fitted_shifts(problem, _overlapped(problem, at), at, own)
    reduced = [_reduced(one, s) for one, s in zip(responses, log_a, strict=True)]
    found = spectrum(*reduced, **asked)
    residuals = found.answers[found.table.index(found.row)].fitted.residuals
    left = np.array([_rms(part) for part in np.split(residuals, _edges(problem))])
    alone = np.array([_rms(one.residuals) for one in own])
    log_a, error = log_a / np.log(10), error / np.log(10)
    law = _best_law(T, log_a, error, T[at])
    return MasterCurve(found, Shifts(T, log_a, error, float(T[at]), *law, left, alone))


def _alone(problem: Problem) -> Fitted:
    """The spectrum of one temperature."""
    low, high = resolved(problem.inputs[0])
    return dense_spectrum(problem, np.log(low / BEYOND), np.log(high * BEYOND))


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(x @ x / max(np.count_nonzero(x), 1)))  # rows without a weight have none


def _edges(problem: Problem) -> np.ndarray:
    return np.cumsum([len(one.memoryless) for one in problem.inputs])[:-1]


def _reduced(response: Response, log_a: float) -> Response:
    """The response as it is at the reference temperature."""
    factor = np.exp(log_a if response.kind == "modulus" else -log_a)
    return response._replace(t=np.asarray(response.t, float) * factor)


def _shifted(problem: Problem, log_a: PerTemperature) -> Problem:
    inputs = [
        replace(one, t=one.t * np.exp(s if one.oscillation else -s))
        for one, s in zip(problem.inputs, log_a, strict=True)
    ]
    return replace(problem, inputs=tuple(inputs))


def _overlapped(problem: Problem, at: int) -> PerTemperature:
    """Shifts between neighbours, by a parabola through both of their first parts in the logarithms."""
    curves = []
    for one, y in zip(problem.inputs, np.split(problem.y, _edges(problem)), strict=True):
        x = -np.log(one.t) if one.oscillation else np.log(one.t)
        good = y[: len(x)] > 0
        if len(np.unique(x[good])) < 2:
            raise InputError(
                "too-few-rows",
                "a run at one temperature has fewer than two times or frequencies with a modulus above 0.",
                fix="a master curve needs a sweep at every temperature; leave shorter runs out.",
            )
        curves.append((x[good], np.log(y[: len(x)][good])))
    steps = [0.0]
    for (x, y), (u, v) in itertools.pairwise(curves):
        reach = 3 * max(np.ptp(x), np.ptp(u))
        tried = np.linspace(-reach, reach, 241)
        steps.append(float(min(tried, key=lambda s: _apart(np.append(x, u - s), np.append(y, v)))))
    total = np.cumsum(steps)
    return total - total[at]


def _apart(x: np.ndarray, y: np.ndarray) -> float:
    x = (x - x.mean()) / x.std()
    A = np.stack([np.ones_like(x), x, x**2], 1)
    return float(np.sum((A @ np.linalg.lstsq(A, y, rcond=None)[0] - y) ** 2))


def _fitted_shifts(
    problem: Problem, log_a: PerTemperature, at: int, own: Sequence[Fitted]
) -> tuple[PerTemperature, PerTemperature]:
    """The shifts that fit best with a spectrum, by Levenberg and Marquardt, and their standard errors.

    `own`: the spectrum of each temperature.
    """
    free = np.arange(len(log_a)) != at
    ends = np.array([resolved(one) for one in _shifted(problem, log_a).inputs])
    # Room for the shifts to move in.
    low, high = np.log(ends.min() / BEYOND**2), np.log(ends.max() * BEYOND**2)
    grid = np.linspace(low, high, 2 + int(np.ceil(3 * (high - low) / np.log(10))))
    found = smoothed(_shifted(problem, log_a), grid)
    for _ in range(STEPS):
        log_a = _descended(problem, log_a, free, grid, found)
        last, found = found, smoothed(_shifted(problem, log_a), grid)
        if found.strength == last.strength:
            break
    fitted = found.fitted
    J = _slopes(_shifted(problem, log_a), fitted)[:, free]
    # The shifts are parameters, too.
    noise = noise_of([fitted.residuals], fitted._replace(effective=fitted.effective + free.sum()))
    H = J.T @ J
    # A temperature at which nothing relaxes has no slope, and so no end to its error.
    scale = np.sqrt(np.maximum(np.diagonal(H), 1e-20 * np.diagonal(H).max()))
    inverse = np.linalg.inv(H / np.outer(scale, scale) + 1e-13 * np.eye(len(scale)))
    error, variance = np.zeros(len(log_a)), noise.sigma**2 * noise.correlation_time
    left_free = sum(max(np.count_nonzero(one.residuals) - one.effective, 0.0) for one in own)
    alone = sum(one.residuals @ one.residuals for one in own) / max(left_free, 1.0)
    # Below this in one of 40 that chance makes.
    if alone < noise.sigma**2 * (1 - 2 * np.sqrt(2 / max(left_free, 1.0))):
        variance += (noise.sigma**2 - alone) * noise.samples / len(log_a)
    error[free] = np.sqrt(variance * np.diagonal(inverse)) / scale
    return log_a, error


def _descended(
    problem: Problem, log_a: PerTemperature, free: np.ndarray, grid: np.ndarray, begin: Smoothed
) -> PerTemperature:
    """The best shifts for a spectrum of this smoothness."""
    fitted, damping = begin.fitted, 1e-3
    for _ in range(STEPS):
        J = _slopes(_shifted(problem, log_a), fitted)[:, free]
        H, g, before = J.T @ J, J.T @ fitted.residuals, _cost(fitted)
        size = np.diag(np.maximum(np.diagonal(H), 1e-12 * np.diagonal(H).max()))
        trial = log_a.copy()
        # No temperature moves by more than half a decade at once.
        trial[free] -= np.clip(np.linalg.solve(H + damping * size, g), -1.0, 1.0)
        next = smoothed(_shifted(problem, trial), grid, (begin.strength,)).fitted
        gain = before - _cost(next)
        if gain > 0:
            log_a, fitted, damping = trial, next, max(damping / 10, 1e-9)
        else:
            damping *= 10
        if damping > 1e6 or 0 < gain < 1e-6 * before:
            break
    return log_a


def _cost(fitted: Fitted) -> float:
    """What a spectrum with a prior minimises."""
    assert fitted.prior is not None
    prior = fitted.strengths @ fitted.prior @ fitted.strengths
    return float(fitted.residuals @ fitted.residuals + prior)


def _slopes(problem: Problem, fitted: Fitted) -> Float[np.ndarray, "rows temperatures"]:
    """d residuals / d log a, less what the strengths make up for."""
    A, there = problem.columns(fitted.log_tau), fitted.strengths != 0
    moved = problem.slopes(fitted.log_tau, A) @ fitted.strengths[fitted.memoryless :]
    if problem.kind == "creep":  # what flows does so for the reduced time
        moved -= problem.weights * problem.memoryless[:, 1] * fitted.strengths[1]
    edges = [0, *_edges(problem), len(moved)]
    J = np.zeros((len(moved), len(edges) - 1))
    for k, (begin, end) in enumerate(itertools.pairwise(edges)):
        J[begin:end, k] = moved[begin:end]
    assert fitted.prior is not None
    A = A[:, there]
    H = A.T @ A + fitted.prior[np.ix_(there, there)]
    H += 1e-13 * np.trace(H) * np.eye(len(H))
    return J - A @ np.linalg.solve(H, A.T @ J)


def _law(law: str, constants: np.ndarray, T: np.ndarray, reference: float) -> np.ndarray:
    if law == "WLF":
        return -constants[0] * (T - reference) / (constants[1] + T - reference)
    return (
        constants[0]
        / (R / 1e3 * np.log(10))
        * (1 / (T + zero_Celsius) - 1 / (reference + zero_Celsius))
    )


def _best_law(
    T: PerTemperature, log_a: PerTemperature, error: PerTemperature, reference: float
) -> tuple[Literal["WLF", "Arrhenius"], tuple[float, ...], float]:
    """The law that fits better for its number of parameters, by the Bayesian information criterion."""
    # A law holds to a hundredth of a decade at best.
    weight = 1 / np.hypot(error, 0.01)
    # The glass below its pole has no WLF: C2 keeps the pole outside the temperatures.
    beyond = max(float(reference - T.min()), 0.0) + 1.0
    starts: dict[Literal["WLF", "Arrhenius"], tuple[list[float], list[float]]] = {
        "WLF": ([15.0, beyond + 50.0], [0.0, beyond]),
        "Arrhenius": ([150.0], [-np.inf]),
    }
    best: tuple[float, Literal["WLF", "Arrhenius"], tuple[float, ...], float] | None = None
    for law, (start, low) in starts.items():
        fit = least_squares(
            lambda c, law=law: weight * (_law(law, c, T, reference) - log_a), start, bounds=(low, np.inf),
            x_scale=np.abs(start),
        )  # fmt: skip
        apart = _rms(fit.fun / weight)
        criterion = len(T) * np.log(max(2 * fit.cost / len(T), 1e-12)) + len(start) * np.log(len(T))
        if best is None or criterion < best[0]:
            best = criterion, law, tuple(map(float, fit.x)), apart
    assert best is not None
    return best[1:]
