"""The spectrum of time constants behind records of any clock, dense or as a short series."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell, InputError

from .._levels import FEWEST, SEAM, SOME_ROWS
from ..noise._arithmetic import Rows
from ..noise._reml import Linearised
from ..noise._residual_statistics import Noise, estimate_noise, lasting_noise
from ._dense_spectrum import dense_spectrum, short_series
from ._extrapolation import Allowed, Fractional, allowed, fractional_of
from ._prony_series import Fitted, Input, Kind, Problem, Way
from ._response import Response, problem_of, resolved, side_of

MOST = 10
"""Time constants of a short series, at most, where no number is asked for."""
SUPPORT = 10.0
"""What a further time constant must gain: very strong evidence, after Kass and Raftery, JASA 90 (1995)."""
TOGETHER = 2.0
"""Storage and loss contradict each other where together they leave so many times what each alone does, and
more than `SEAM` of the reading."""
BEYOND = 3.0
"""How far beyond the record's step and span a time constant is searched, as a factor."""


class Order(NamedTuple):
    """One row of the table of orders.

    - `order`: time constants; `parameters`: numbers fitted, of a dense spectrum as many as the rows choose;
      `rms`: of the weighted residuals, relative to the output at each row, or to its root mean square.
    - `evidence`: Bayesian information criterion, effective * log(rms^2) + parameters * log(effective),
      with the effective number of facts in the residuals of the best fit. The least is best.
    - `dense`: whether this is the dense spectrum and not a short series.
    """

    order: int
    parameters: int
    rms: float
    evidence: float
    dense: bool = False

    @classmethod
    def of(cls, fitted: Fitted, noise: Noise) -> "Order":
        """That of an answer, whose best one leaves this noise."""
        count, square = len(fitted.log_tau), fitted.mean_square
        # Without noise the residuals are those of the normal equations' rounding.
        evidence = noise.effective * np.log(max(square, 1e-16))
        evidence += fitted.parameters * np.log(noise.effective)
        rms, dense = float(np.sqrt(square)), fitted.prior is not None
        return cls(count, fitted.parameters, rms, evidence, dense)

    @property
    def words(self) -> str:
        """What it is called beside its model."""
        return f"of {self.order} log-spaced terms" if self.dense else f"of order {self.order}"


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
    """A spectrum of time constants: a short series, or one dense in log time where the rows call for that.

    - `model`: `GeneralizedKelvinVoigt` (creep) or `GeneralizedMaxwell` (relaxation, moduli).
    - `order`: its time constants; `table`: what each number of them gives, the dense spectrum last.
    - `noise`: what is left over, weighted as the fit was.
    - `allowed`: the spectra at the edge of what the record allows.
    - `step`, `span`: the shortest time that the record resolves, and the longest.
    - `notes`: what the record does not tell, in words.
    - `way`: to the hold that was fitted; None for a step and for a record with an input.
    - `dense`: whether the model is the dense spectrum.
    - `answers`: of every row of the table; not kept with a saved fit.
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
    dense: bool = False
    answers: tuple[Answer, ...] = ()

    @property
    def row(self) -> Order:
        """The row of the table that is the model's."""
        return next(row for row in self.table if (row.order, row.dense) == (self.order, self.dense))

    def predict(self, t: Any, input: Any = None) -> Band:
        """The output at times t: the fit's, and the range of all that the record allows.

        The range is that over non-negative spectra that fit the record as well as chance would have
        the true one do; see `_extrapolation`. Beyond the record's span it widens to what slow
        processes could still do. It is that of the curve: a measured row has noise besides.

        **Arguments:** times `t` since the load came on, shape `(times,)`, and for a spectrum of a
        record with an input that `input`, from the record's start.
        """
        way = self.way if input is None else None
        at = Input(
            self.kind,
            np.asarray(t, float),
            None if input is None else np.asarray(input, float),
            way,
        )
        outputs = self.allowed.outputs(at)
        return Band(outputs[0], outputs.min(0), outputs.max(0))

    def fractional(self) -> tuple[Fractional, Fractional]:
        """The springpot and the fractional Zener element that sum the spectrum up in two and four numbers:

            V (i w)^alpha,      E_inf + (E_0 - E_inf) (i w tau)^alpha / (1 + (i w tau)^alpha)

        Each is nearest to the complex modulus over the frequencies of the rows. Predictions stay those of
        the spectrum.

        **Example:**

            >>> w = np.geomspace(0.01, 10, 40)
            >>> found = identify.spectrum(identify.Response(w, 2 * (1j * w) ** 0.3, "modulus"))
            >>> found.fractional()[0].value.round(2).tolist()
            [2.0, 0.3]
        """
        return fractional_of(self.kind, self.allowed, self.step, self.span)


# Many small factorisations: threads of BLAS that wait for each other double the processor's time.
@threadpool_limits.wrap(limits=1, user_api="blas")
def spectrum(
    *responses: Response,
    terms: int | None = None,
    tau: Any = None,
    bounds: tuple[float, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    dense: bool = True,
) -> Spectrum:
    """The spectrum of time constants behind one or several records of one material.

    Creep, relaxation, any motion of the input and moduli over frequency are linear in the strengths of the
    same time constants, which are not negative. So they are fitted together: first as a dense spectrum
    whose smoothness the evidence chooses, then as short series of 0, 1, 2, ... time constants that start
    from it. The model is the shortest series with the support of the rows, or the dense spectrum where no
    series is as good.

    Moduli beside creep are inverted; creep beside relaxation is taken as the relaxation that its own
    spectrum has at the same times.

    **Arguments:**

    - `responses`: the records.
    - `terms`: a series of this many time constants. `tau`: one with these.
    - `bounds`: between which time constants are searched; by default a third of the first time, and
      three times the last.
    - `fixed`: known strengths by name: `E_inf` (0 for a liquid); in creep `E0` and `eta0` (infinite: none).
    - `dense`: whether the dense spectrum may be the model.

    Raises `InputError` for times that fall or begin before the step, too few rows, lengths that differ, an
    unknown kind, and time constants or bounds that are not above 0 and finite.

    **Example:**

        >>> w = np.geomspace(0.01, 10, 40)
        >>> found = identify.spectrum(identify.Response(w, 1 + 2j * w / (1 + 1j * w), "modulus"), terms=1)
        >>> float(found.model.tau[0].round(3)), float(found.predict([1.0]).value[0].round(3))
        (1.0, 1.736)
    """
    _check_times(terms, tau, bounds)
    kinds = {one.kind for one in responses}
    if {"creep", "relaxation"} <= kinds:
        responses = tuple(map(_relaxing, responses))
    kind, notes = side_of(responses), list[str]()
    problem = problem_of(responses, notes, _known(fixed or {}, kind))
    if (count := np.count_nonzero(problem.weights)) < FEWEST:
        raise InputError("too-few-rows", f"{count} rows: a spectrum needs at least {FEWEST}.")
    steps, spans = zip(*map(resolved, problem.inputs), strict=True)
    step, span = min(steps), max(spans)
    ends = np.log(bounds or (step / BEYOND, span * BEYOND))
    fits = _fits(problem, (float(ends[0]), float(ends[1])), terms, tau)
    finest = min(fits, key=lambda fitted: fitted.mean_square)
    edges = np.cumsum([len(one.memoryless) for one in problem.inputs])[:-1]
    left = noise_of(np.split(finest.residuals, edges), finest)
    table = tuple(Order.of(one, left) for one in fits)
    best = _best(table, dense and terms is None)
    if terms is not None and table[best].order < terms:
        notes.append(
            f"no more than {table[best].order} time constants come out with positive strengths."
        )
    noise = _lasting(problem, finest, left)
    answers = tuple(
        Answer(_model(f, problem), f, *_log_covariance(f, problem, noise.correlation_time))
        for f in fits
    )
    notes += [] if table[best].dense else _notes(fits[best], step, span, kind)
    notes += _contradiction(problem, fits[best], ends)
    around = allowed(problem.thinned(SOME_ROWS), fits[best], noise, step, span)
    way = responses[0].way if len(responses) == 1 else None
    return Spectrum(
        kind, answers[best].model, table[best].order, table, noise, around, step, span, tuple(notes), way,
        table[best].dense, answers,
    )  # fmt: skip


def _contradiction(problem: Problem, fitted: Fitted, ends: np.ndarray) -> list[str]:
    """A note where storage and loss moduli follow from no one spectrum, but each from one of its own."""
    if not all(one.oscillation for one in problem.inputs):
        return []
    parts = [np.repeat([True, False], len(one.t)) for one in problem.inputs]
    is_storage, counted = np.concatenate(parts), problem.weights > 0
    if not (counted & ~is_storage).any() or not (counted & is_storage).any():
        return []
    alone = np.zeros(len(counted))
    for part in (is_storage, ~is_storage):
        own = replace(problem, weights=np.where(part, problem.weights, 0.0))
        alone[part] = dense_spectrum(own, *ends).residuals[part]
    both, each = (float(np.sqrt(np.mean(x[counted] ** 2))) for x in (fitted.residuals, alone))
    if both < TOGETHER * each or both < SEAM:
        return []
    return [
        f"Storage and loss moduli contradict each other: one spectrum leaves {100 * both:.2g} % of the"
        f" reading, one for each of the two {100 * each:.2g} %. Shift factors, a resonance or the phase of"
        " the rig may be wrong (Kramers-Kronig relations)."
    ]


def _relaxing(response: Response) -> Response:
    """Creep as the relaxation of its own spectrum."""
    if response.kind != "creep":
        return response
    own, t = spectrum(response), np.asarray(response.t, float)
    there = t > 0
    weight = np.broadcast_to(np.asarray(response.weight, float), t.shape)[there]
    t = t[there] if response.input is None else np.geomspace(own.step, own.span, there.sum())
    return Response(t, np.asarray(own.model.relaxation_modulus(t)), "relaxation", weight=weight)


def _check_times(terms: int | None, tau: Any, bounds: Any) -> None:
    if tau is not None and not (terms is None and bounds is None):
        said = "Give the time constants, or their number and bounds, not both."
        raise InputError("conflicting-options", said)
    for name, given in (("tau", tau if tau is None else np.sort(tau)), ("bounds of tau", bounds)):
        if given is None or (np.isfinite(given).all() and (np.diff(given, prepend=0) > 0).all()):
            continue
        raise InputError(
            "bad-option", f"{name} = {', '.join(f'{x:g}' for x in given)} cannot be used.",
            fix="give times above 0, each once, the lower bound first.",
        )  # fmt: skip


def _known(fixed: Mapping[str, float], kind: Kind) -> tuple[tuple[int, float], ...]:
    """Strengths that are given, by column: in creep one over the stiffness or viscosity."""
    names = ("E0", "eta0") if kind == "creep" else ("E_inf",)
    for name, value in fixed.items():
        if name not in names or not value >= 0 or (kind == "creep" and value == 0):
            raise InputError(
                "bad-option",
                f"{name} = {value:g} cannot be fixed.",
                fix=f"fix {' or '.join(names)}, E_inf at 0 or more and others above 0, or give --tau.",
            )
    power = -1 if kind == "creep" else 1
    return tuple((names.index(name), float(value) ** power) for name, value in fixed.items())


def _fits(
    problem: Problem, ends: tuple[float, float], terms: int | None, tau: Sequence[float] | None
) -> list[Fitted]:
    """Short series of ever more time constants, as long as each adds something, and the dense spectrum."""
    if tau is not None:
        return [problem.at(np.sort(np.log(np.asarray(tau, float))))]
    dense = dense_spectrum(problem, *ends)
    # Half of the rows at least are left to tell what a number of parameters is worth.
    most = max(0, min(MOST, len(problem.y) // 4 - 1))
    counts = range(most, -1, -1) if terms is None else (terms + 1, terms)
    series = short_series(problem, dense, counts, ends)
    if terms is not None:
        return [series[terms], dense]
    kept: list[Fitted] = []
    for one in sorted(series.values(), key=lambda fitted: len(fitted.log_tau)):
        if not kept or one.mean_square < (1 - 1e-4) * kept[-1].mean_square:
            kept.append(one)
    return [*kept, dense]


def _best(table: Sequence[Order], dense: bool) -> int:
    """The shortest series with the support of the rows, or the dense spectrum, if that has much more."""
    short = [row for row in table if not row.dense]
    least = min(row.evidence for row in short)
    best = next(k for k, row in enumerate(short) if row.evidence <= least + SUPPORT)
    return (
        len(short) if dense and table[-1].dense and table[-1].evidence < least - SUPPORT else best
    )


def noise_of(parts: list[np.ndarray], fitted: Fitted) -> Noise:
    """Of residuals of several records; a row without a weight has none."""
    parts = [part[part != 0] for part in parts if part.any()] or parts
    return estimate_noise(parts, min(fitted.parameters, sum(map(len, parts)) // 2))


def _lasting(problem: Problem, fitted: Fitted, left: Noise) -> Noise:
    """What the rows are off the true spectrum by, of which a fitted one has `left` less where it lasts."""
    # Of many rows it takes in next to nothing.
    if left.sigma == 0 or left.samples > SOME_ROWS:
        return left
    counted = fitted.residuals != 0
    place = np.concatenate([np.arange(len(one.memoryless)) for one in problem.inputs], dtype=float)
    none = np.zeros(len(place))
    rows = Rows(counted, place, none, none, none[:, None], none + 1)
    J, precision, pull = problem.linearised(fitted)
    square = left.sigma**2
    at = Linearised(fitted.residuals, J, rows, pull / square, precision / square)
    return lasting_noise(at, left, min(fitted.parameters, left.samples // 2))


def _model(fitted: Fitted, problem: Problem) -> GeneralizedKelvinVoigt | GeneralizedMaxwell:
    n = fitted.memoryless
    spring, c, tau = fitted.strengths[0], fitted.strengths[n:], np.exp(fitted.log_tau)
    offset = fitted.strengths[n - 1] if problem.free.any() else 0.0
    if problem.kind == "relaxation":
        return GeneralizedMaxwell(spring, c, tau, offset)
    flow = fitted.strengths[1]
    return GeneralizedKelvinVoigt(
        1 / spring if spring > 0 else np.inf, 1 / c, tau / c, 1 / flow if flow > 0 else None, offset
    )


def _log_covariance(
    fitted: Fitted, problem: Problem, lasting: float
) -> tuple[tuple[str, ...], Float[np.ndarray, "names names"]]:
    """Names of the parameters that are there, and the covariance of their logarithms under noise that lasts
    so many rows or more.

    With strengths c and x = log tau, log E is -log c in creep and log c in relaxation, and log eta
    is x - log c. An offset stays as it is. What is known has no variance.
    """
    creep, n, c = problem.kind == "creep", fitted.memoryless, fitted.strengths
    memoryless = ["E0", "eta0"] if creep else ["E_inf"]
    moved = n - len(memoryless)
    memoryless += ["offset"] if moved == 1 else [f"offset{k + 1}" for k in range(moved)]
    count = len(fitted.log_tau)
    at = np.flatnonzero(c[:n])
    names = [memoryless[k] for k in at]
    names += [f"{name}{k + 1}" for k in range(count) for name in ("E", "eta" if creep else "tau")]
    # Rows: the names; columns: strengths, then x.
    way = np.zeros((len(names), len(c) + count))
    sign = -1 if creep else 1
    for row, k in enumerate(at):
        way[row, k] = 1.0 if memoryless[k].startswith("offset") else sign / c[k]
    for k in np.flatnonzero(c[n:]).tolist():
        row = len(at) + 2 * k
        way[row, n + k] = sign / c[n + k]
        way[row + 1, len(c) + k] = 1.0
        if creep:
            way[row + 1, n + k] = -1 / c[n + k]
    way = way[:, fitted.chosen]
    noise = noise_of([fitted.residuals], fitted)
    variance = noise.sigma**2 * max(noise.correlation_time, lasting)
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
