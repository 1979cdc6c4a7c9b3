"""`fit`: candidates, ranked on held-out parts, the winner refitted on the whole training part."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hysteresis import (
    AbstractModel,
    InputError,
    Preisach,
    Record,
    check_identifiable,
)
from hysteresis.preisach import AbstractGridDensity

from ..linear._composition_fit import CompositionFit, find_lag, fit_compositions
from ..linear._preisach_fit import GRIDS, LinearFit, fit_preisach
from ..linear._preisach_unknowns import TOTALS
from ..noise._reml import kinds
from ..noise._residual_statistics import Noise
from ..parameters._precision import require_double
from ..parameters._settings import with_settings
from ..parameters._transform import transform_for
from ..records._channel_map import combine, fit_channel_map
from ..records._clocks import Clocks, is_held, shifted
from ..records._folds import Parts, as_good, parts
from ..records._orientation import initial_states, orientations, output_falls
from ..records._run_model import predict
from ..results._fit_result import FitResult, Parameter
from ..results._goodness_of_fit import evidence
from ..results._metrics import metrics
from ._candidates import Asked, Candidate, candidates
from ._parametric import fit_parametric
from ._settling import settled
from ._verdict import judge

Report = Callable[[str], None]
Said = Mapping[str, Mapping[str, Any]]

WORTH = 0.2
"""Part of the mean squared error that a lag must take away to be believed."""


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
    noise: str = "auto",
    parameters: Said | None = None,
    starts: int = 32,
    seed: int = 0,
    allow_float32: bool = False,
    progress: Report | None = None,
) -> FitResult:
    """Fit models to a record and give back the best, as a new model of its own type.

    Candidates are ranked by their error on parts of the training rows that were held out from them,
    whole sequences or cycles; the simplest within one standard error of the best is taken. Each is
    refitted to all of the training part. The test rows are
    used for nothing but the reported figures.

    **Arguments:**

    - `record`: the measurements; its mask says which rows count.
    - `model`: `"auto"`; a name, whatever its case, out of Composition and `hysteresis.model_names()`; a
      registered class; or a model to start from: its fixed parameters stay, the others are fitted. A list
      holds several of them.
    - `test`: a record to judge on; or `test_cycles`, the last so many of each sequence; or
      `test_tail`, the last fraction of each sequence.

    **Other arguments:**

    - `initial`: the relays before the first sample of each sequence: `"negative"`, `"positive"` or
      `"demagnetised"`; `"fit"` fits how many of each cell are up, for a record that starts in the
      middle of a history; `"auto"` tries those the record leaves open.
    - `conditioning`: `"auto"` leaves the first cycle of a single sequence out of the fit where that
      predicts a held-out later one better, and all but the last ones where one cycle is repeated until the
      sample has settled; `"keep"` never does.
    - `clocks`: `"auto"` makes an input linear between updates that come less often than rows, and looks
      for a constant lag between input and output where a composition predicts better with one; `"keep"`
      takes the input as it is.
    - `noise`: what the residuals of a model of few parameters are taken for: gaussian, student-t, ar1,
      arma11, growing (with the reading), input (errors in it), misfit (of the model, a smooth function of
      the input and its direction), or several with + between; student-t is the robust one. `"auto"` lets
      the evidence choose, and believes it where it leaves nothing that is coloured or follows the input.
    - `parameters`: what is known of the parameters of one model of few: name -> {"start", "bounds",
      "prior", "fixed", "tied"}, such as {"E1": {"prior": "log-normal(2, 1.5)"}, "offset": {"fixed": 0}}.
    - `starts`, `seed`: how many random starts for non-linear parameters, and their seed.
    - `allow_float32`: fit although JAX's double precision is off.
    - `progress`: called with a line of text now and then.

    Raises `InputError` where the record cannot identify anything, or double precision is off.
    """
    begin = time.perf_counter()
    say = progress or (lambda _: None)
    require_double(allow_float32)
    if sum(x is not None for x in (test, test_cycles, test_tail)) > 1:
        raise InputError("conflicting-options", "Give one of test, test_cycles and test_tail.")
    if test_cycles is not None:
        record, test = record.split_cycles(test_cycles)
    elif test_tail is not None:
        record, test = record.split_tail(test_tail)
    _check_choices(initial, conditioning, clocks, starts, seed)
    kinds(noise)
    asked = candidates(model)
    if parameters and (
        len(asked) > 1 or any(one.has_weights and one.template is None for one in asked)
    ):
        raise InputError(
            "unknown-parameter",
            f"{', '.join(parameters)}: parameters of which model?",
            fix="name one model of few parameters.",
        )
    channels = None
    if record.channels:
        channels, record = fit_channel_map(record, keep_conditioning=conditioning == "keep")
        test = None if test is None else combine(test, channels)
        say(record.history[-1])
    warnings = tuple(check_identifiable(record))
    before = Clocks(interpolated=clocks == "auto" and record.time is not None and is_held(record))
    record = before.applied(record)
    if conditioning == "auto" and (later := settled(record)) is not record:
        record = later
        say(record.history[-1])
    cut = parts(record, keep_conditioning=conditioning == "keep")
    if before.interpolated:
        say(f"{record.input_name} is updated less often than read: linear between its updates")
    say(f"{int(record.mask.sum())} training rows; candidates are ranked on {cut.how}")

    found: list[FitResult] = []
    skipped: dict[str, str] = {}
    one_way = any(warning.code == "one-way-input" for warning in warnings)
    for candidate in asked:
        name, since = candidate.name, time.perf_counter()
        try:
            if one_way and candidate.kind is Preisach and len(asked) > 1:
                raise InputError("one-way-input", "An input that goes one way shows no hysteresis.")
            if candidate.kind is None:
                # The channels' curves have taken up a lag between the clocks, if there is one.
                with_lag = clocks == "auto" and channels is None
                new = _fit_compositions(record, cut, initial, with_lag, seed, say)
            else:
                # Several are ranked by least squares; the noise is the business of the one chosen.
                about = (parameters or {}, noise if len(asked) == 1 else None)
                new = [_fit_one(candidate, record, cut, initial, starts, seed, about)]
        except InputError as error:
            if len(asked) == 1:
                raise
            skipped[name] = str(error)
            say(f"{name}: left out. {error}")
            continue
        seconds = time.perf_counter() - since
        for one in new:
            now = before._replace(lag=one.clocks.lag, lag_error=one.clocks.lag_error)
            found.append(
                _judged_on(test, replace(one, seconds=seconds, clocks=now, channels=channels))
            )
        say(f"{new[-1].name}: held-out {new[-1].score:.3g} %, {seconds:.1f} s")
    if not found:
        raise InputError("nothing-fits", " ".join(skipped.values()))
    ranked = sorted(found, key=lambda candidate: candidate.score)
    chosen = next(c for c in found if _as_good(c, ranked[0]))
    ranked = [chosen, *(c for c in ranked if c is not chosen)]
    if len(asked) > 1 and chosen.starts is not None:
        (won,) = (candidate for candidate in asked if candidate.name == chosen.name)
        again = _fit_one(won, record, cut, initial, starts, seed, (parameters or {}, noise))
        kept = {k: getattr(chosen, k) for k in ("seconds", "clocks", "channels")}
        ranked[0] = _judged_on(test, replace(again, **kept))
    ranked = [replace(c, verdict=judge(c, warnings)) for c in ranked]
    return replace(
        ranked[0],
        candidates=tuple(ranked),
        skipped=skipped,
        seconds=time.perf_counter() - begin,
    )


def _judged_on(test: Record | None, fit: FitResult) -> FitResult:
    """The fit with its figures on the test record, if there is one."""
    if test is None:
        return fit
    judged = replace(fit, test=fit.clocks.applied(test))
    held_out = metrics(test.output, judged.predict(test), test.mask)
    return replace(judged, metrics={**fit.metrics, "test": held_out})


def _as_good(simple: FitResult, best: FitResult) -> bool:
    """Whether its held-out error is above the best one's by less than that difference's standard error."""
    if simple is best:
        return True
    if simple.blocks is None or best.blocks is None or len(simple.blocks) != len(best.blocks):
        return False
    return as_good(simple.blocks, best.blocks)


def _fit_one(
    candidate: Candidate,
    record: Record,
    cut: Parts,
    initial: str,
    starts: int,
    seed: int,
    about: tuple[Said, str | None],
) -> FitResult:
    name, template = candidate.name, candidate.template
    if candidate.has_weights:
        return replace(_fit_preisach(template, record, cut, initial, seed), name=name)
    suggested = candidate.suggested(record)
    start = template or suggested
    assert start is not None  # a class without a model can start, or is not a candidate
    said, noise = about
    start, settings = with_settings(start, said)
    free = len(transform_for(start, record, settings).names)
    if not free:
        raise InputError(
            "nothing-free", f"every parameter of {name} is fixed or tied, so nothing is to fit."
        )
    check_identifiable(record, n_parameters=free)
    others = suggested if template and not said else None
    return fit_parametric(name, start, record, cut, starts, seed, others, noise, settings)


def _fit_preisach(
    template: AbstractModel | None, record: Record, cut: Parts, initial: str, seed: int
) -> FitResult:
    if output_falls(record):
        raise _falls(record)
    leadings, cells, dead_band = orientations(record), GRIDS, 0.0
    initials: tuple[Any, ...] = initial_states(record) if initial == "auto" else (initial,)
    if isinstance(template, Preisach):
        leadings, dead_band = (template.leading,), template.dead_band
        initials = (template.initial if initial == "auto" else initial,)
        if isinstance(template.density, AbstractGridDensity):
            cells = (template.density.cells,)
    linear = fit_preisach(record, cut, leadings, initials, cells, dead_band=dead_band)
    model = linear.model
    held_out = float(linear.blocks.mean()) * linear.meaning.scale**2
    left = evidence(record, cut, predict(model, record), linear.dropped, held_out)
    chosen = (
        f"Prior strength {linear.strength:g}, {linear.meaning.cells} cells along each threshold in"
        f" {linear.meaning.block.max() + 1} blocks, chosen on {cut.how}."
    )
    totals, covariance = _totals(linear, TOTALS, left.noise, record, seed)
    return FitResult(
        name="Preisach",
        model=model,
        parameters=totals,
        covariance=covariance,
        residuals=left.residuals,
        metrics=left.metrics,
        success=True,
        score=left.score,
        blocks=linear.blocks * linear.meaning.scale**2,
        noise=left.noise,
        train=record,
        notes=(chosen, *left.notes),
        internals={"used": left.used, "linear": linear},
        seed=seed,
    )


def _fit_compositions(
    record: Record, cut: Parts, initial: str, with_lag: bool, seed: int, say: Report
) -> list[FitResult]:
    """Compositions from a curve alone to the best one; see `fit_compositions`."""
    if output_falls(record):
        raise _falls(record)
    state = "negative" if initial in ("auto", "fit") else initial
    path, clocks = fit_compositions(record, cut, orientations(record), state), Clocks()
    if with_lag and record.time is not None:
        say(f"{path[-1].name}; is there a lag between the clocks?")
        found = find_lag(record, path[-1].meaning.floor)
        # A lag is believed where it takes a fifth of the squared error, held-out too, beyond doubt.
        if found.gain > WORTH:
            moved = shifted(record, found.lag)
            again = fit_compositions(moved, cut, (found.leading,), state)
            gain = path[-1].blocks - again[-1].blocks
            least = max(2 * np.std(gain) / np.sqrt(len(gain)), WORTH * path[-1].blocks.mean())
            if gain.mean() > least:
                record, path, clocks = moved, again, Clocks(found.lag, found.error)
    return [_composed(fit, record, cut, clocks, seed) for fit in path]


def _composed(
    fit: CompositionFit, record: Record, cut: Parts, clocks: Clocks, seed: int
) -> FitResult:
    meaning, model = fit.meaning, fit.model
    held_out = float(fit.blocks.mean()) * meaning.scale**2
    left = evidence(record, cut, predict(model, record), False, held_out)
    notes = [f"Prior strength {fit.strength:g}, chosen with the parts on {cut.how}."]
    if clocks.lag:
        notes.append(
            f"{record.output_name} lags {record.input_name} by {clocks.lag:.3g} +- {clocks.lag_error:.1g}"
            f" {record.time_unit}: taken out before the fit (--clocks keep leaves it in)."
        )
    names = meaning.total_names
    totals, covariance = _totals(fit, names, left.noise, record, seed)
    return FitResult(
        name=fit.name,
        model=model,
        parameters=totals,
        covariance=covariance,
        residuals=left.residuals,
        metrics=left.metrics,
        success=True,
        score=left.score,
        blocks=fit.blocks * meaning.scale**2,
        noise=left.noise,
        train=record,
        notes=(*notes, *left.notes),
        internals={"used": left.used, "composition": fit},
        clocks=clocks,
        seed=seed,
    )


def _totals(
    linear: LinearFit | CompositionFit,
    names: tuple[str, ...],
    noise: Noise,
    record: Record,
    seed: int,
) -> tuple[tuple[Parameter, ...], np.ndarray]:
    """The sums that tell what each part of a linear model does, with their errors.

    The covariance is that of projected draws about the fit, not about their mean: where the data
    leave much open the signs push the draws to one side, and the error has to reach there.
    """
    sums, scale = linear.meaning.totals, linear.meaning.scale
    values = scale * sums @ linear.at
    draws = scale * linear.draws(noise, 64, np.random.default_rng(seed)) @ sums.T
    away = draws - values
    covariance = away.T @ away / len(draws)
    errors = np.sqrt(np.diagonal(covariance))
    listed = tuple(
        Parameter(name, float(v), record.output_unit, float(e), "free")
        for name, v, e in zip(names, values, errors, strict=True)
    )
    return listed, covariance


def _falls(record: Record) -> InputError:
    return InputError(
        "output-falls",
        f"{record.output_name} falls as {record.input_name} rises: no model of rising parts does.",
        cause="the sign convention of one column.",
        fix="turn the sign of one column.",
    )


def _check_choices(initial: str, conditioning: str, clocks: str, starts: int, seed: int) -> None:
    for name, value, choices in (
        ("initial", initial, ("auto", "negative", "positive", "demagnetised", "fit")),
        ("conditioning", conditioning, ("auto", "keep")),
        ("clocks", clocks, ("auto", "keep")),
    ):
        if value not in choices:
            raise InputError("bad-option", f"{name}={value!r}; have {', '.join(choices)}.")
    if starts < 1 or seed < 0:
        raise InputError("bad-option", f"starts={starts}, seed={seed}: at least 1, and 0.")
