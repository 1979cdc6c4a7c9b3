"""Discrete spectrum of a creep curve, a relaxation curve or any record: the time constants it shows."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell, InputError

from ..noise._residual_statistics import Noise, estimate_noise
from ._extrapolation import Allowed, allowed
from ._order_selection import orders, resolved, thinned
from ._prony_series import Fitted, Input, Kind, Problem, Way

A_DECADE = 2
"""Time constants in each decade at most: closer ones are told apart by no noise above a millionth."""


class Order(NamedTuple):
    """One row of the table of orders.

    - `order`: time constants; `parameters`: numbers fitted; `rms`: of the weighted residuals, relative
      to the output at each row, or to its root mean square.
    - `evidence`: Bayesian information criterion, effective * log(rms^2) + parameters * log(effective),
      with the effective number of facts in the residuals of the richest order. The least is best.
    """

    order: int
    parameters: int
    rms: float
    evidence: float


class Answer(NamedTuple):
    """A model, and how well its parameters are known.

    - `fitted`: what it was made from.
    - `names`: parameters that are there: E0, eta0 or E_inf, then E1, eta1 or tau1, E2, ...
    - `covariance`: of their logarithms; of an offset itself.
    """

    model: GeneralizedKelvinVoigt | GeneralizedMaxwell
    fitted: Fitted
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "names names"]


class Band(NamedTuple):
    """A prediction, and the band that contains the whole curve with 90 % confidence."""

    value: Float[np.ndarray, " times"]
    low: Float[np.ndarray, " times"]
    high: Float[np.ndarray, " times"]


class Spectrum(NamedTuple):
    """A discrete spectrum of time constants.

    - `model`: `GeneralizedKelvinVoigt` (creep) or `GeneralizedMaxwell` (relaxation).
    - `order`: its time constants; `table`: what each order gives, from none on.
    - `noise`: what is left over, weighted as the fit was.
    - `allowed`: the spectra at the edge of what the record allows.
    - `step`, `span`: the shortest time that the record resolves, and the longest.
    - `notes`: what the record does not tell, in words.
    - `way`: to the hold that was fitted; None for a step and for a record with an input.
    - `answers`: of every order; not kept with a saved fit.

    **Example:**

        >>> times = np.geomspace(0.1, 100, 60)
        >>> found = identify.spectrum(times, 1 + 2 * (1 - np.exp(-times / 5)), most=2)
        >>> type(found.model).__name__
        'GeneralizedKelvinVoigt'
    """

    kind: Kind
    model: GeneralizedKelvinVoigt | GeneralizedMaxwell
    order: int
    table: tuple[Order, ...]
    noise: Noise
    allowed: Allowed
    step: float
    span: float
    notes: tuple[str, ...]
    way: Way | None = None
    answers: tuple[Answer, ...] = ()

    def predict(self, t: Any, input: Any = None) -> Band:
        """The output at times t: the fit's, and the range of all that the record allows.

        The range is that over non-negative spectra that fit the record as well as chance would have
        the true one do; see `_extrapolation`. Beyond the record's span it widens to what slow
        processes could still do. It is that of the curve: a measured row has noise besides.

        **Arguments:** times `t` since the load came on, shape `(times,)`, and for a spectrum of a
        record with an input that `input`, from the record's start.
        """
        way = self.way if input is None else None
        at = Input(self.kind, np.asarray(t, float), _array(input), way)
        outputs = self.allowed.outputs(at)
        return Band(outputs[0], outputs.min(0), outputs.max(0))


def spectrum(
    t: Any,
    y: Any,
    kind: str = "creep",
    order: int | None = None,
    *,
    input: Any = None,
    way: Way | None = None,
    relative: bool = True,
    most: int | None = None,
) -> Spectrum:
    """The discrete spectrum of time constants behind a record.

    Strengths on a grid of four time constants a decade come from non-negative least squares; what is
    left of the grid, neighbours merged, starts the search for one, two, ... time constants, and so
    does each order's best answer with one more put where it helps most. Each order is refined in log
    tau with the strengths solved for inside. The evidence chooses the order.

    **Arguments:**

    - `t`, `y`: times and outputs of one sequence, shape `(samples,)`.
    - `kind`: `"creep"`, displacement under a force, or `"relaxation"`, force under a displacement.
    - `order`: this many time constants; None for as many as the evidence supports, up to `most`:
      by default 8, or `A_DECADE` in each decade of a longer record.
    - `input`: the force (creep) or displacement (relaxation), linear between samples; None for a unit
      step at t = 0, when y is the compliance J or the modulus G.
    - `way`: how the input came to a unit hold from t = 0 on, without an `input`; None for a step.
    - `relative`: weigh errors by 1 / y, as a unit step's answer that spans decades needs; such rows
      with y <= 0 are left out. With an `input`, and where False, all rows weigh the same.

    Raises `InputError` for times that fall or begin before the step, too few rows, lengths that differ
    and for an unknown kind.

    **Example:**

        >>> times = np.geomspace(0.1, 100, 60)
        >>> found = identify.spectrum(times, 1 + 2 * (1 - np.exp(-times / 5)), most=2)
        >>> found.order, float(found.predict([10.0]).value[0].round(3))
        (1, 2.729)
    """
    t, y, u = np.asarray(t, float), np.asarray(y, float), _array(input)
    kind = _checked(t, y, u, kind)
    notes: list[str] = []
    relative = relative and u is None
    at_step = t <= 0 if way is None else t < 0
    if (left_out := relative & ((y <= 0) | at_step)).any():
        t, y = t[~left_out], y[~left_out]
        rows = "row" if left_out.sum() == 1 else "rows"
        notes.append(f"Left out: {left_out.sum()} {rows} not positive or at the step itself.")
    if len(t) < 8:
        raise InputError("too-few-rows", f"{len(t)} rows: a spectrum needs at least 8.")
    weights = 1 / y if relative else np.full_like(y, 1 / np.sqrt(np.mean(y**2)))
    problem = Problem(Input(kind, t if u is None else t - t[0], u, way), y, weights)
    step, span = resolved(problem.input)
    if most is None:
        most = max(8, int(A_DECADE * np.log10(span / step)))
    fits = orders(problem, step, span, most if order is None else order)
    noise = estimate_noise([fits[-1].residuals], fits[-1].parameters)
    evidence = [_evidence(fitted, noise) for fitted in fits]
    best = int(np.argmin(evidence)) if order is None else order
    if best >= len(fits):
        best = len(fits) - 1
        notes.append(f"no more than {best} time constants come out with positive strengths.")
    table = tuple(
        Order(n, fitted.parameters, float(np.sqrt(fitted.mean_square)), evidence[n])
        for n, fitted in enumerate(fits)
    )
    answers = tuple(Answer(_model(f, problem), f, *_log_covariance(f, problem)) for f in fits)
    notes += _notes(fits[best], step, span, kind)
    edges = allowed(thinned(problem), fits[best], noise, step, span)
    return Spectrum(
        kind, answers[best].model, best, table, noise, edges, step, span, tuple(notes), way, answers
    )


def _evidence(fitted: Fitted, noise: Noise) -> float:
    # Without noise the residuals are those of the normal equations' rounding.
    square = max(fitted.mean_square, 1e-16)
    return noise.effective * np.log(square) + fitted.parameters * np.log(noise.effective)


def _model(fitted: Fitted, problem: Problem) -> GeneralizedKelvinVoigt | GeneralizedMaxwell:
    n = fitted.memoryless
    spring, c, tau = fitted.strengths[0], fitted.strengths[n:], np.exp(fitted.log_tau)
    offset = 0.0 if problem.input.u is None else fitted.strengths[n - 1]
    if problem.input.kind == "relaxation":
        return GeneralizedMaxwell(spring, c, tau, offset)
    flow = fitted.strengths[1]
    return GeneralizedKelvinVoigt(
        1 / spring if spring > 0 else np.inf, 1 / c, tau / c, 1 / flow if flow > 0 else None, offset
    )


def _log_covariance(
    fitted: Fitted, problem: Problem
) -> tuple[tuple[str, ...], Float[np.ndarray, "names names"]]:
    """Names of the parameters that are there, and the covariance of their logarithms.

    With strengths c and x = log tau, log E is -log c in creep and log c in relaxation, and log eta
    is x - log c. An offset stays as it is.
    """
    creep, n, c = problem.input.kind == "creep", fitted.memoryless, fitted.strengths
    memoryless = (["E0", "eta0"] if creep else ["E_inf"]) + ["offset"]
    count = len(fitted.log_tau)
    at = np.flatnonzero(c[:n])
    names = [memoryless[k] for k in at]
    names += [f"{name}{k + 1}" for k in range(count) for name in ("E", "eta" if creep else "tau")]
    # Rows: the names; columns: strengths that are not 0, then x, as in the covariance.
    way = np.zeros((len(names), len(names)))
    sign = -1 if creep else 1
    for row, k in enumerate(at):
        way[row, row] = 1.0 if memoryless[k] == "offset" else sign / c[k]
    for k in range(count):
        row, strength, time = len(at) + 2 * k, len(at) + k, len(at) + count + k
        way[row, strength] = sign / c[n + k]
        way[row + 1, time] = 1.0
        if creep:
            way[row + 1, strength] = -1 / c[n + k]
    noise = estimate_noise([fitted.residuals], fitted.parameters)
    variance = noise.sigma**2 * noise.correlation_time
    return tuple(names), variance * way @ problem.covariance(fitted) @ way.T


def _notes(fitted: Fitted, step: float, span: float, kind: Kind) -> list[str]:
    """Notes on time constants outside the times that the record resolves."""
    slow, fast = {"creep": ("a dashpot", "a spring"), "relaxation": ("a spring", "a dashpot")}[kind]
    said = []
    for tau in np.exp(fitted.log_tau):
        if tau >= span:
            said.append(
                f"Time constant {tau:.3g} is not below the record's span of {span:.3g}: its element"
                f" is identifiable only as {slow}."
            )
        if tau <= step:
            said.append(
                f"Time constant {tau:.3g} is not above the record's first step of {step:.3g}: its"
                f" element is identifiable only as {fast}."
            )
    return said


def _array(values: Any) -> Float[np.ndarray, " samples"] | None:
    return None if values is None else np.asarray(values, float)


def _checked(t: np.ndarray, y: np.ndarray, u: np.ndarray | None, kind: str) -> Kind:
    if kind != "creep" and kind != "relaxation":
        raise InputError("bad-option", f"kind={kind!r}.", fix='give "creep" or "relaxation".')
    given = [t, y] if u is None else [t, y, u]
    if any(a.ndim != 1 or a.shape != t.shape for a in given):
        shapes = ", ".join(str(a.shape) for a in given)
        raise InputError("length-mismatch", f"t, y and input need one length each; have {shapes}.")
    if not all(np.isfinite(a).all() for a in given):
        raise InputError("not-finite", "t, y or input is NaN or infinite.", fix="drop those rows.")
    if len(t) and (np.diff(t) < 0).any():
        raise InputError(
            "time-backwards", "time decreases.", fix="sort the rows, or fit one sequence."
        )
    if u is None and len(t) and t[0] < 0:
        raise InputError(
            "time-backwards",
            f"t begins at {t[0]:g}.",
            fix="count time from where the step was made.",
        )
    return kind
