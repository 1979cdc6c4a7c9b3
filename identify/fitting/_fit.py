"""`fit`: candidates, ranked on held-out parts, the winner refitted on the whole training part."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from hysteresis import AbstractModel, Burgers, InputError, LinearSponge, Mixture, Record
from hysteresis._verdict import ProgressNote
from hysteresis.numerics._compiled import forget_compiled
from hysteresis.numerics._functions import hats_of
from hysteresis.numerics._recurrence import slow_states
from hysteresis.records._abstract_record import KNOWN
from hysteresis.records._csv import with_known

from ..linear._composition_fit import DRIFT_GAIN
from ..noise._reml import kinds
from ..records._clocks import longest_sequence, repeats, usual_speed
from ..records._folds import NEARLY, as_good, earned, held_out_errors
from ..records._sequence_terms import (
    SequenceTerms,
    by_sequence,
    learnt,
    sequence_error,
    sequence_rms,
    with_past,
)
from ..results._detail import Composition, FoldedState, GridWeights
from ..results._fit_result import FitResult
from ..results._repeatability import with_repeatability
from ..results._trained_condition import misfit_of
from ._candidates import Asked, candidates
from ._like import like as mixture_of
from ._like import tells_little
from ._oscillator import fit_oscillator, oscillator_asked
from ._training_data import Candidate, Options, Report, Said, TrainingData, Trial, training_data
from ._verdict import check_purpose, judge

# The least score that any curve, or any linear viscoelastic model, can have on the rows that are held out.
#
#     y = a + b u + c t + d integral(u) + sum_k (e_k average_k(u) + f_k exp(-t / tau_k))
#
# fitted to the held-out rows of each fold themselves: every linear viscoelastic model has an output of this
# form, with relaxation times near those of a grid. A curve is a polygon of 100 pieces.
#
# `auto` needs not try a model that cannot be as good as one that it has found: each takes seconds to
# compile.

PIECES = 100
"""Of a curve."""

TIMES = 10
"""Relaxation times, from the sampling step to ten times the longest sequence."""


def least_score(kind: type[AbstractModel] | None, data: TrainingData) -> float:
    """In per cent of the output's range, as `FitResult.score`; 0 for a kind of which nothing is known."""
    record = data.record
    if kind is LinearSponge:
        u = record.input
        columns = hats_of(u, np.linspace(u[record.mask].min(), u[record.mask].max(), PIECES + 1))
    elif kind is Burgers and record.time is not None:
        columns = _linear(record)
    else:
        return 0.0
    columns = record.weights[:, None] * columns / np.maximum(np.abs(columns).max(0), 1e-300)
    y = record.weights * record.output

    def missed(_: object, test: tuple[int, ...]) -> np.ndarray:
        X, own = (x[np.isin(data.parts.label, test)] for x in (columns, y))
        return X @ np.linalg.lstsq(X, own, rcond=None)[0] - own

    blocks = held_out_errors(data.parts.folds, lambda _: None, missed)
    rms = float(np.sqrt(blocks.mean())) if len(blocks) else 0.0
    return 100 * rms / float(np.ptp(record.output[record.mask]))


def _linear(record: Record) -> np.ndarray:
    assert record.time is not None
    t, moved, slow = np.zeros(len(record)), np.zeros(len(record)), np.empty((len(record), TIMES))
    times = np.geomspace(usual_speed(record)[1], 10 * longest_sequence(record), TIMES)
    for _, rows in record.sequences():
        t[rows], u = record.time[rows] - record.time[rows.start], record.input[rows]
        moved[rows.start + 1 : rows.stop] = np.cumsum(np.diff(t[rows]) * (u[1:] + u[:-1]) / 2)
        slow_states(u, record.time[rows], times, slow[rows])
    gone = np.exp(-t[:, None] / times)
    return np.column_stack([np.ones(len(t)), record.input, t, moved, slow, gone])


PASTS = 2
"""Times that the pasts before known rows are told anew, at most."""

BY_SEQUENCE = (
    "Behind known rows terms that were learnt from the sequences predict, not the model's states."
)

INTERRUPTED = "interrupted"
"""Code of the note on a candidate that Ctrl-C ended."""


# Many small factorisations: threads of BLAS that wait for busy cores made them fifteen times slower.
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit(
    record: Record,
    model: Asked | Sequence[Asked] = "auto",
    *,
    test: Record | None = None,
    test_cycles: int | None = None,
    test_tail: float | None = None,
    initial: str = "auto",
    conditioning: str = "auto",
    clocks: str = "auto",
    drift: str = "auto",
    noise: str = "auto",
    parameters: Said | None = None,
    known: int | str | None = None,
    score: str = "rms",
    like: Sequence[FitResult] = (),
    starts: int = 32,
    seed: int = 0,
    purpose: str = "predict",
    period: int | None = None,
    oversampling: int = 20,
    budget: float | None = None,
    allow_float32: bool = False,
    progress: Report | None = None,
) -> FitResult:
    """Fit models to a record and give back the best, as a new model of its own type.

    Candidates are ranked by their error on parts of the training rows that were held out from them,
    whole sequences or cycles; of those within one standard error of the best, and less than a tenth
    above it, the simplest is taken: that of the fewest parts, then of the fewest parameters. Between kinds
    of models the tenth alone counts where one loop is repeated, which asks for no other motion. Each is
    refitted to all of the training part. The test rows are used for nothing but the reported figures.

    **Arguments:**

    - `record`: the measurements; its mask says which rows count.
    - `model`: `"auto"`; a name, whatever its case, out of Composition, EverettSurface, Butterfly and
      `hysteresis.model_names()`; Oscillator, or Oscillator(BoucWen) and others, which are fitted alone; a
      registered class; or a model to start from: its fixed parameters stay, the others are fitted. A list
      holds several of them.
    - `test`: a record to judge on; or `test_cycles`, the last so many of each sequence; or
      `test_tail`, the last fraction of each sequence.

    **Other arguments:**

    - `initial`: the relays before the first sample of each sequence: `"negative"`, `"positive"` or
      `"demagnetised"`; `"fit"` fits how many of each cell are up, for a record that starts in the
      middle of a history; `"auto"` tries those the record leaves open.
    - `conditioning`: `"auto"` leaves the first cycle of a single sequence out of the fit where that
      predicts held-out later ones better, and the verdict says so; `"keep"` never does. Baselines have all
      rows.
    - `drift`: `"auto"` lets a composition explain the training rows by a drift with the path or the time,
      and makes the model without it, as the specimen was at their end, because a drift tells of one run;
      `"keep"` leaves it in the model, which then drifts from its first row until the training's end.
    - `clocks`: `"auto"` makes an input linear between updates that come less often than rows, and looks
      for a constant lag between input and output where a composition predicts better with one; `"keep"`
      takes the input as it is.
    - `noise`: what the residuals of a model of few parameters are taken for: gaussian, student-t, ar1,
      arma11, growing (with the reading), input (errors in it), misfit (of the model, a smooth function of
      the input and its direction), or several with + between; student-t is the robust one. `"auto"` lets
      the evidence choose, and believes it where it leaves nothing that is coloured or follows the input.
    - `parameters`: what is known of the parameters of one model of few: name -> {"start", "bounds",
      "prior", "fixed", "tied"}, such as {"E1": {"prior": "log-normal(2, 1.5)"}, "offset": {"fixed": 0}}.
    - `known`: of how many first rows of each sequence the output will be known in use too, or the column
      that says so. They do not count: they tell the state in which the rest begins, in the training rows by
      the model of a first fit, in the test rows by that which is given back.
    - `score`: what is to be least: "rms", the error of all rows; or "sre", that of each sequence in parts
      of the rms of its output, so that small loops count.
    - `like`: fits of earlier specimens of the same kind. A `Mixture` of their models is tried too: few
      cycles tell its weights. It is ranked like every model; but where the record has a single cycle, or
      inputs of a smaller range than theirs, it is taken if the first cycle of each of them tells its later
      ones by the others as well as by a curve, as far as there are others and later cycles.
    - `starts`, `seed`: how many random starts for non-linear parameters, and their seed.
    - `purpose`: what the verdict is for: "predict"; "compensate", which also needs a compensator that is
      better than a straight line (`hysid.fit` tries it); or "constants", which also needs a standard error
      for every parameter.
    - `period`, `oversampling`: of an oscillator: rows in a period of the force (None looks for one, 0 means
      that it does not repeat), and steps of integration to a sample.
    - `budget`: seconds after which no further model or random start is begun.
    - `allow_float32`: fit in the precision that JAX has, also where it is single.
    - `progress`: called with a line of text now and then.

    Ctrl-C, or a spent budget, ends the search: the best candidate so far is the result, and `skipped` names
    the others.

    Raises `InputError` where the record cannot identify anything.

    **Example:**

        >>> found = identify.fit(record, "LinearSponge", test_cycles=1, noise="gaussian")
        >>> found.name, [p.name for p in found.parameters]
        ('LinearSponge', ['K', 'b', 'threshold'])
    """
    begin = time.perf_counter()
    say = progress or (lambda _: None)
    forget_compiled()
    if sum(x is not None for x in (test, test_cycles, test_tail)) > 1:
        raise InputError("conflicting-options", "Give one of test, test_cycles and test_tail.")
    if known is not None:
        record = with_known(record, known)
        test = None if test is None else with_known(test, known)
    if test_cycles is not None:
        record, test = record.split_cycles(test_cycles)
    elif test_tail is not None:
        record, test = record.split_tail(test_tail)
    if score == "sre":
        record, test = by_sequence(record), None if test is None else by_sequence(test)
    _check_choices(initial, conditioning, clocks, drift, score, starts, seed)
    if budget is not None and not budget > 0:
        raise InputError("bad-option", f"budget={budget} s; at least some time is needed.")
    kinds(noise)
    check_purpose(purpose)
    if (oscillator := oscillator_asked(model)) is not None:
        return fit_oscillator(
            oscillator, record, test, period=period, oversampling=oversampling, starts=starts,
            seed=seed, purpose=purpose, say=say,
        )  # fmt: skip
    if period is not None:
        raise InputError(
            "bad-option",
            "period is of oscillators.",
            fix="fit model='Oscillator', or leave it out.",
        )
    asked = candidates(model)
    if parameters and (
        len(asked) > 1 or any(one.has_weights and one.template is None for one in asked)
    ):
        raise InputError(
            "unknown-parameter",
            f"{', '.join(parameters)}: parameters of which model?",
            fix="name one model of few parameters.",
        )
    sequences = None
    if record.known is not None and not record.channels:
        again = partial(
            fit, initial=initial, conditioning=conditioning, clocks=clocks, drift=drift, noise="gaussian",
            parameters=parameters, starts=starts, seed=seed, progress=progress, budget=budget,
        )  # fmt: skip
        record, sequences, kind = _behind_pasts(record, model, again)
        # What was found is tried first: a spent budget, or Ctrl-C, then leaves nothing worse.
        asked = tuple(sorted(asked, key=lambda one: one.name != kind))
    data = training_data(
        record,
        test,
        keep_conditioning=conditioning == "keep",
        keep_clocks=clocks == "keep",
        may_modulate=model == "auto" and purpose == "predict",
        say=say,
    )
    data = replace(data, sequences=sequences)
    left: dict[str, str] = {}
    if model == "auto":
        suited = tuple(one for one in asked if one.suits(data, purpose))
        said = (
            f"its parameters do not depend on {data.condition}; --model {{0}} fits it all the same."
        )
        left = {
            one.name: said.format(one.name)
            for one in asked
            if one.kind is not None and one not in suited
        }
        asked = suited
    if like:
        asked = (mixture_of(like, record, test), *asked)
    options = Options(
        initial, starts, seed, noise, parameters or {}, len(asked) == 1, say, drift == "keep",
        is_auto=model == "auto" and purpose != "constants", either_sign=purpose == "predict",
        until=np.inf if budget is None else begin + budget,
    )  # fmt: skip
    tried, skipped = _tried(asked, data, options)
    chosen, *others = _ranked(tried, mixed=tells_little(data, like))
    try:
        best = with_repeatability(chosen.with_noise(noise, data))
    except KeyboardInterrupt:
        said = f"{chosen.fit.name}: interrupted before its noise was chosen."
        say(ProgressNote(INTERRUPTED, said, len(asked), len(asked)))
        best = replace(chosen.fit, notes=(*chosen.fit.notes, said))
    fits = [best, *(one.fit for one in others)]
    del tried, chosen, others  # the searches, which hold every row
    baselines = data.baselines()
    fits = [replace(one, baselines=baselines, purpose=purpose) for one in fits]
    if sequences is not None:
        fits[0] = replace(fits[0], notes=(*fits[0].notes, BY_SEQUENCE))
    if score == "sre" and test is not None:
        error = sequence_error(test, fits[0].predict(test))
        said = f"Held-out sequences: {error:.3g} % of the rms of each one's output, on average."
        say(said)
        fits[0] = replace(fits[0], notes=(*fits[0].notes, said))
    ranked = [replace(one, verdict=judge(one, data.warnings)) for one in fits]
    return replace(
        ranked[0],
        candidates=tuple(ranked),
        skipped=left | skipped,
        seconds=time.perf_counter() - begin,
    )


def _behind_pasts(
    record: Record, model: Asked | Sequence[Asked], fitted: Callable[..., FitResult]
) -> tuple[Record, SequenceTerms | None, str]:
    """The record behind the pasts that its known rows tell: by a fit from the virgin state, then by one of
    the same kind behind those pasts, and so on while that takes away a tenth of the error. Or the virgin
    record, and terms that predict held-out sequences better than the fit does those it has seen. And the
    kind of model that was found."""
    columns = {name: x for name, x in record.columns.items() if name != KNOWN}
    virgin = replace(record, columns=columns)
    found = fitted(virgin, model)
    kind = "Composition" if isinstance(found.detail, Composition) else found.name
    terms = learnt(found.clocks.applied(record))
    if terms is not None and NEARLY * terms.error < sequence_rms(record, found.predict(record)):
        return virgin, terms, kind
    behind = with_past(found.model, record, misfit_of(found))
    for _ in range(PASTS):
        again = fitted(behind, kind if model == "auto" else model)
        if NEARLY * misfit_of(again).rms > misfit_of(found).rms:
            break
        found, behind = again, with_past(again.model, record, misfit_of(again))
    return behind, None, kind


def _tried(
    asked: tuple[Candidate, ...], data: TrainingData, options: Options
) -> tuple[list[Trial], dict[str, str]]:
    """Every candidate that can be fitted, in the order of `asked`, and why the others cannot; with one
    found, none is begun after `options.until`.

    Raises `InputError` where none can, or where the only one cannot.
    """
    tried: list[Trial] = []
    skipped: dict[str, str] = {}
    say = options.say

    def skip(candidate: Candidate, why: str, done: int) -> None:
        skipped[candidate.name] = why
        say(ProgressNote("skipped", f"{candidate.name}: skipped. {why}", done, len(asked)))

    for done, candidate in enumerate(asked, 1):
        since = time.perf_counter()
        if tried and since > options.until:
            skipped |= dict.fromkeys(
                (one.name for one in asked[done - 1 :]), "no time was left for it."
            )
            break
        if tried and options.is_auto:
            least = least_score(candidate.kind, data)
            if least > NEARLY * min(one.fit.score for one in tried):
                skip(candidate, f"None can have a held-out error below {least:.3g} %.", done)
                continue
        try:
            new = candidate.fitted(data, options)
        except InputError as error:
            if options.alone:
                raise
            skip(candidate, str(error), done)
            continue
        except KeyboardInterrupt:
            # What was found is worth more than a clean end: the best of it is the result.
            if not tried:
                raise
            skipped |= {one.name: "interrupted before it was fitted." for one in asked[done - 1 :]}
            say(ProgressNote(INTERRUPTED, f"{candidate.name}: interrupted.", done, len(asked)))
            break
        seconds = time.perf_counter() - since
        for fit, explained in new:
            tried.append(Trial(data.tested(replace(fit, seconds=seconds)), explained))
        last = new[-1].fit
        said = f"{last.name}: held-out {last.score:.3g} %, {seconds:.1f} s"
        say(ProgressNote("candidate", said, done, len(asked)))
    if not tried:
        raise InputError("nothing-fits", " ".join(skipped.values()))
    return tried, skipped


def _ranked(tried: list[Trial], mixed: bool) -> list[Trial]:
    """The one to take, which is the simplest one as good as the best, then the others, best first; with
    `mixed` the mixture of earlier specimens. Weights of either sign need more, see `DRIFT_GAIN`. Behind a
    map of channels, whose many weights have either sign, no model is simple or rises: the best is taken."""
    ranked = sorted(tried, key=lambda one: one.fit.score)
    if ranked[0].fit.channels is not None:
        return ranked
    rising = [
        one for one in ranked if not isinstance(one.fit.detail, Composition) or one.fit.detail.rises
    ]
    best, rises = ranked[0].fit, rising[0].fit
    signed = rises is not best and earned(
        np.asarray(rises.blocks), np.asarray(best.blocks), DRIFT_GAIN
    )
    able = ranked if signed else rising
    good = [one for one in able if _as_good(one.fit, able[0].fit)]
    if mixed:
        good = [one for one in tried if isinstance(one.fit.model, Mixture)] or good
    chosen = min(good, key=lambda one: _complexity(one.fit))
    return [chosen, *(one for one in ranked if one is not chosen)]


def _complexity(fit: FitResult) -> tuple[float, float, float]:
    """How many parts the model is a sum of, how many parameters it has, and its held-out error.

    Weights under a prior are many, and how many says nothing: of them the error decides.
    """
    parts, parameters = np.inf, np.inf  # a surface read off the record has neither
    match fit.detail:
        case GridWeights():
            parts = 2  # a curve and relays
        case Composition(linear) | FoldedState(linear):
            mapped, folded = bool(linear.meaning.first), isinstance(fit.detail, FoldedState)
            parts = len(linear.meaning.parts) + mapped + folded
        case _ if fit.parameter_count is not None:
            parts, parameters = 1, fit.parameter_count
    return parts, parameters, fit.score


def _as_good(simple: FitResult, best: FitResult) -> bool:
    """Whether its held-out error is above the best one's by less than a tenth, and by less than that
    difference's standard error, which one uneven block makes large.

    Where one loop is repeated, a tenth is enough between kinds of models: the error of that difference is
    of the same loop again, and any other motion moves it by more.
    """
    if simple is best:
        return True
    if simple.blocks is None or best.blocks is None or len(simple.blocks) != len(best.blocks):
        return False
    of_one_loop = type(simple.detail) is not type(best.detail) and repeats(best.train, 2)
    near = simple.score < NEARLY * best.score
    return near and (of_one_loop or as_good(simple.blocks, best.blocks))


def _check_choices(
    initial: str, conditioning: str, clocks: str, drift: str, score: str, starts: int, seed: int
) -> None:
    for name, value, choices in (
        ("initial", initial, ("auto", "negative", "positive", "demagnetised", "fit")),
        ("conditioning", conditioning, ("auto", "keep")),
        ("clocks", clocks, ("auto", "keep")),
        ("drift", drift, ("auto", "keep")),
        ("score", score, ("rms", "sre")),
    ):
        if value not in choices:
            raise InputError("bad-option", f"{name}={value!r}; have {', '.join(choices)}.")
    if starts < 1 or seed < 0:
        raise InputError("bad-option", f"starts={starts}, seed={seed}: at least 1, and 0.")
