"""How many time constants a creep curve, a relaxation curve or any record holds, and which."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell, InputError

from ._noise import Noise, estimate_noise
from ._prony_fit import Fitted, Input, Kind, Problem, strengths

A_DECADE = 4
"""Time constants of the first grid in each decade."""
BEYOND = 3.0
"""How far beyond the record's step and span a time constant is searched, as a factor."""
SLOWEST = (1.0, 2.0, 5.0, 10.0, 30.0)
"""Times, in spans of the record, at which what flows (or stays) might yet come to rest (or relax)."""


REACH = 10.0
"""Orders whose evidence is worse than the chosen one's by more than this are ruled out."""
TRIED = 1 / 3
"""The part of the record from which the rest is predicted, as a trial."""
SEARCHED = 3000
"""About how many rows of a unit step the search for time constants looks at; the rest refine them."""


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


class Band(NamedTuple):
    """A prediction and its standard deviation."""

    value: Float[np.ndarray, " times"]
    deviation: Float[np.ndarray, " times"]


class Member(NamedTuple):
    """An answer that the evidence leaves open: its weight, and the covariance of its numbers."""

    weight: float
    fitted: Fitted
    covariance: Float[np.ndarray, "numbers numbers"]


class Spectrum(NamedTuple):
    """A discrete spectrum of time constants.

    - `model`: `GeneralizedKelvinVoigt` (creep) or `GeneralizedMaxwell` (relaxation).
    - `order`: its time constants; `table`: what other orders would have given.
    - `noise`: what is left over, weighted as the fit was.
    - `members`: what `predict` averages.
    - `span`: of the record.
    - `stretch`: by how much more than its band said a spectrum of the record's first third was wrong
      about the rest of it; at least 1.
    - `notes`: what the record does not tell, in words.
    """

    model: GeneralizedKelvinVoigt | GeneralizedMaxwell
    order: int
    table: tuple[Order, ...]
    noise: Noise
    members: tuple[Member, ...]
    span: float
    stretch: float
    notes: tuple[str, ...]
    kind: Kind

    def predict(self, t: Any, input: Any = None) -> Band:
        """The output at times t, with all that the record leaves open: mean over the members, and the
        root of their own variances plus their spread.

        Members are the orders that the evidence does not rule out, each with its linearised covariance,
        and each again with what flows for ever (creep) or stays for ever (relaxation) replaced by a
        branch of 1 to 30 times the record's span: inside the record these can hardly be told apart,
        beyond it they part. Beyond the record the deviation is stretched as much as the
        record's own first third turned out to need, in full from three spans on.

        **Arguments:** times `t` since the load came on, shape `(times,)`, and for a spectrum of a
        record with an input that `input`, from the record's start.
        """
        at = Input(self.kind, np.asarray(t, float), _array(input))
        mean, deviation = _predict(self.members, at)
        beyond = np.log(np.maximum(at.t / self.span, 1.0)) / np.log(1 / TRIED)
        return Band(mean, deviation * self.stretch ** np.minimum(beyond, 1.0))


def spectrum(
    t: Any,
    y: Any,
    kind: str = "creep",
    order: int | None = None,
    *,
    input: Any = None,
    relative: bool = True,
    most: int = 8,
) -> Spectrum:
    """The discrete spectrum of time constants behind a record.

    Strengths on a grid of four time constants a decade come from non-negative least squares; what is
    left of the grid, neighbours merged, starts the search for one, two, ... time constants, and so
    does each order's best answer with one more put where it helps most. Each order is refined in log
    tau with the strengths solved for inside. The evidence chooses the order.

    **Arguments:**

    - `t`, `y`: times and outputs of one sequence, shape `(samples,)`.
    - `kind`: `"creep"`, displacement under a force, or `"relaxation"`, force under a displacement.
    - `order`: this many time constants; None for as many as the evidence supports, up to `most`.
    - `input`: the force (creep) or displacement (relaxation), linear between samples; None for a unit
      step at t = 0, when y is the compliance J or the modulus G.
    - `relative`: weigh errors by 1 / y, as a unit step's answer that spans decades needs; such rows
      with y <= 0 are left out. With an `input`, and where False, all rows weigh the same.

    Raises `InputError` for times that fall or begin before the step, too few rows, lengths that differ,
    an unknown kind; for an `input` without JAX's double precision.
    """
    t, y, u = np.asarray(t, float), np.asarray(y, float), _array(input)
    kind = _checked(t, y, u, kind)
    notes: list[str] = []
    relative = relative and u is None
    if (left_out := relative & ((y <= 0) | (t <= 0))).any():
        t, y = t[~left_out], y[~left_out]
        notes.append(f"{left_out.sum()} rows that are not positive were left out.")
    if len(t) < 8:
        raise InputError("too-few-samples", f"{len(t)} rows: a spectrum needs at least 8.")
    weights = 1 / y if relative else np.full_like(y, 1 / np.sqrt(np.mean(y**2)))
    problem = Problem(Input(kind, t if u is None else t - t[0], u), y, weights)
    step, span = _times(problem.input)
    fits = _orders(problem, step, span, most if order is None else order)
    table, noise = _table(fits)
    best = int(np.argmin([row.evidence for row in table])) if order is None else order
    if best >= len(fits):
        best = len(fits) - 1
        notes.append(f"no more than {best} time constants come out with positive strengths.")
    members = _members(problem, fits, best, noise)
    stretch = _stretch(problem, most if order is None else order)
    notes += _notes(fits[best], step, span, kind)
    return Spectrum(
        _model(fits[best], problem), best, table, noise, members, span, stretch, tuple(notes), kind
    )


def _table(fits: list[Fitted]) -> tuple[tuple[Order, ...], Noise]:
    """The orders' figures, and the noise that the richest leaves."""
    noise = estimate_noise([fits[-1].residuals], fits[-1].parameters)
    rows = enumerate(fits)
    return tuple(
        Order(n, f.parameters, float(np.sqrt(f.mean_square)), _evidence(f, noise)) for n, f in rows
    ), noise


def _predict(members: tuple[Member, ...], at: Input) -> Band:
    """Mean over the members, root of their mean variance and their spread."""
    weight = np.array([member.weight for member in members])
    values, variances = [], []
    for _, fitted, covariance in members:
        J = Problem.input_jacobian(at, fitted)
        columns = np.hstack([at.memoryless, at.branches(fitted.log_tau)])
        values.append(columns @ fitted.strengths)
        variances.append(np.einsum("ti,ij,tj->t", J, covariance, J))
    mean = weight @ np.array(values)
    square = weight @ (np.array(variances) + (np.array(values) - mean[None]) ** 2)
    return Band(mean, np.sqrt(square))


def _stretch(problem: Problem, most: int) -> float:
    """Root mean square of (error / (deviation and noise)) where the record's first part predicts the
    rest; 1 where that is less, or where either part is short."""
    problem = _thinned(problem)
    t = problem.input.t
    cut = int(np.searchsorted(t, TRIED * t[-1]))
    if min(cut, len(t) - cut) < 20:
        return 1.0
    part = problem.rows(slice(0, cut))
    fits = _orders(part, *_times(part.input), most)
    table, noise = _table(fits)
    best = int(np.argmin([row.evidence for row in table]))
    predicted, deviation = _predict(_members(part, fits, best, noise), problem.input)
    error = (problem.weights * (predicted - problem.y))[cut:]
    expected = (problem.weights * deviation)[cut:] ** 2 + noise.sigma**2
    return max(1.0, float(np.sqrt(np.mean(error**2 / np.maximum(expected, 1e-16)))))


def _thinned(problem: Problem) -> Problem:
    """About `SEARCHED` rows of a unit step's answer; with an input all of them."""
    stride = max(1, len(problem.y) // SEARCHED) if problem.input.u is None else 1
    return problem.rows(slice(None, None, stride))


def _orders(problem: Problem, step: float, span: float, most: int) -> list[Fitted]:
    """The best answers with 0, 1, 2, ... time constants, as long as each adds one."""
    bounds = np.log(step / BEYOND), np.log(span * BEYOND)
    used = np.ones(problem.input.memoryless.shape[1], bool)
    grid = np.linspace(
        np.log(step), np.log(span), 1 + max(2, int(np.ceil(A_DECADE * np.log10(span / step))))
    )
    few = _thinned(problem)
    columns = few.columns(grid)
    merged = _merged(grid, strengths(columns, few.target, few.free, used)[len(used) :])
    fits = [problem.fit(np.zeros(0), bounds, used)]
    while len(fits) <= most:
        n, best = len(fits), fits[-1]
        starts = [_one_more(few, best.log_tau, grid, columns, used)]
        starts += [_agglomerated(merged, n)] if len(merged) >= n else []
        tries = [few.fit(start, bounds, used) for start in starts]
        fitted = min(tries, key=lambda f: f.mean_square)
        if len(few.y) < len(problem.y):
            fitted = problem.fit(fitted.log_tau, bounds, used, most=4)
        if (
            fitted.strengths[len(used) :] == 0
        ).any() or fitted.mean_square > 0.9999 * best.mean_square:
            break
        fits.append(fitted)
    return fits


def _merged(
    grid: Float[np.ndarray, " grid"], strength: Float[np.ndarray, " grid"]
) -> Float[np.ndarray, "groups 2"]:
    """Log time constants and strengths of the grid's non-zero entries, neighbours as one."""
    at = np.flatnonzero(strength > 0)
    groups = np.split(at, 1 + np.flatnonzero(np.diff(at) > 1)) if len(at) else []
    return np.array(
        [(np.average(grid[g], weights=strength[g]), strength[g].sum()) for g in groups]
    ).reshape(-1, 2)


def _agglomerated(groups: Float[np.ndarray, "groups 2"], n: int) -> Float[np.ndarray, " n"]:
    """The groups joined, the closest pair first, until there are n."""
    while len(groups) > n:
        k = int(np.argmin(np.diff(groups[:, 0])))
        pair = groups[k : k + 2]
        joined = [np.average(pair[:, 0], weights=pair[:, 1]), pair[:, 1].sum()]
        groups = np.vstack([groups[:k], joined, groups[k + 2 :]])
    return groups[:, 0]


def _one_more(
    problem: Problem,
    log_tau: Float[np.ndarray, " n"],
    grid: Float[np.ndarray, " grid"],
    columns: Float[np.ndarray, "rows all"],
    used: Bool[np.ndarray, " memoryless"],
) -> Float[np.ndarray, " m"]:
    """The time constants with one of the grid's beside them: the one that helps most."""
    present, left = problem.columns(log_tau), []
    for k in range(len(grid)):
        A = np.hstack([present, columns[:, len(used) + k, None]])
        c = strengths(A, problem.target, problem.free, used)
        left.append(np.sum((A @ c - problem.target) ** 2))
    return np.sort(np.append(log_tau, grid[int(np.argmin(left))]))


def _members(problem: Problem, fits: list[Fitted], best: int, noise: Noise) -> tuple[Member, ...]:
    """The answers in reach, each again with what lasts for ever ending at one of the `SLOWEST` times."""
    few = _thinned(problem)
    step, span = _times(problem.input)
    bounds = np.log(step / BEYOND), np.log(span)
    lasts = 1 if problem.input.kind == "creep" else 0
    limit = _evidence(fits[best], noise) + REACH
    reach = [f for f in fits if _evidence(f, noise) <= limit]
    answers = list(reach)
    for fitted in reach:
        used = fitted.used.copy()
        used[lasts] = False
        for slow in SLOWEST:
            start = np.append(np.minimum(fitted.log_tau, np.log(span)), np.log(slow * span))
            near = few.fit(start, bounds, used, fixed=1, most=15)
            answers.append(problem.fit(near.log_tau, bounds, used, fixed=1, most=2))
    evidence = np.array([_evidence(answer, noise) for answer in answers])
    weight = np.exp(-(evidence - evidence.min()) / 2)
    weight /= weight.sum()
    return tuple(
        Member(
            float(w),
            answer,
            answer.mean_square * noise.correlation_time * problem.covariance(answer),
        )
        for w, answer in zip(weight, answers, strict=True)
        if w > 1e-3
    )


def _evidence(fitted: Fitted, noise: Noise) -> float:
    # Without noise the residuals are those of the normal equations' rounding.
    square = max(fitted.mean_square, 1e-16)
    return noise.effective * np.log(square) + fitted.parameters * np.log(noise.effective)


def _model(fitted: Fitted, problem: Problem) -> GeneralizedKelvinVoigt | GeneralizedMaxwell:
    n = len(fitted.used)
    spring, c, tau = fitted.strengths[0], fitted.strengths[n:], np.exp(fitted.log_tau)
    tau, c = tau[c > 0], c[c > 0]
    offset = 0.0 if problem.input.u is None else fitted.strengths[n - 1]
    if problem.input.kind == "relaxation":
        return GeneralizedMaxwell(spring, c, tau, offset)
    flow = fitted.strengths[1]
    return GeneralizedKelvinVoigt(
        1 / spring if spring > 0 else np.inf, 1 / c, tau / c, 1 / flow if flow > 0 else None, offset
    )


def _notes(fitted: Fitted, step: float, span: float, kind: Kind) -> list[str]:
    """What time constants outside the record's own times amount to."""
    slow, fast = {"creep": ("a dashpot", "a spring"), "relaxation": ("a spring", "a dashpot")}[kind]
    said = []
    for tau in np.exp(fitted.log_tau):
        if tau >= span:
            said.append(
                f"Time constant {tau:.3g} is not below the record's span of {span:.3g}: what the "
                f"record tells of it is {slow}."
            )
        if tau <= step:
            said.append(
                f"Time constant {tau:.3g} is not above the record's first step of {step:.3g}: what "
                f"the record tells of it is {fast}."
            )
    return said


def _times(at: Input) -> tuple[float, float]:
    """The shortest time a record resolves, a unit step's first row or the shortest step, and its span."""
    times = at.t if at.u is None else np.diff(at.t)
    return float(times[times > 0].min()), float(at.t[-1])


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
    if u is not None and not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise InputError(
            "float32",
            "JAX's double precision is off.",
            fix='jax.config.update("jax_enable_x64", True) before anything else.',
        )
    return kind
