"""Fits that are linear in their unknowns: the weights of a grid, and compositions of parts."""

from dataclasses import replace
from typing import Any

import numpy as np

from hysteresis import InputError, Preisach
from hysteresis._format import quantity
from hysteresis.preisach import GridDensity

from .._levels import FEW
from ..linear._average import averaged
from ..linear._composition import CompositionUnknowns
from ..linear._composition_fit import Problem, Tried, fitted, path_of
from ..linear._composition_lag import fit_lagging
from ..linear._composition_parts import DRIFTS
from ..linear._conditioned_fit import fit_conditioned
from ..linear._linear_fit import LinearFit, outputs_together
from ..linear._preisach_fit import GRIDS, fit_preisach
from ..records._clocks import latest
from ..records._folds import earned
from ..records._new_record import predict
from ..results._detail import Composition, GridWeights
from ..results._fit_result import FitResult, Parameter
from ..results._goodness_of_fit import evidence
from ..results._trained_condition import trained_condition
from ._training_data import Candidate, Options, TrainingData, Trial

DRAWS = 100
"""From which the errors of the totals are estimated; `FEW` until a fit is chosen."""

SIGNED = "Its output need not rise with the input; --purpose compensate takes a model that does."


class GridCandidate(Candidate):
    """A Preisach model whose density is a weight for each cell of a grid; a template fixes its shape."""

    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        if not options.alone and any(note.code == "one-way-input" for note in data.warnings):
            raise InputError("one-way-input", "An input that goes one way shows no hysteresis.")
        template, initial = self.template, options.initial
        leadings, cells, dead_band = data.leadings, GRIDS, 0.0
        initials: tuple[Any, ...] = data.initials if initial == "auto" else (initial,)
        if isinstance(template, Preisach):
            leadings, dead_band = (template.leading,), template.dead_band
            initials = (template.initial if initial == "auto" else initial,)
            if isinstance(template.density, GridDensity):
                cells = (template.density.cells,)
        linear, parts = fit_preisach(data.record, data.parts, leadings, initials, cells, dead_band)
        note = (
            f"Prior strength {linear.strength:g}, {linear.meaning.cells} cells along each threshold in"
            f" {linear.meaning.block.max() + 1} blocks, chosen on {data.parts.how}."
        )
        data, detail = replace(data, parts=parts), GridWeights(linear)
        return [_trial(self.name, linear, detail, data, (note,), options.seed)]


class CompositionCandidate(Candidate):
    """Curves, relays and relaxations, as many as the record shows: every step from a curve alone.

    For `auto` an average replaces those that are better on held-out rows, see `path_of`.
    """

    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        seed, keeps_drift = options.seed, options.keeps_drift
        state = state_of(options.initial)
        path: tuple[LinearFit, ...]
        if data.condition is None:
            choices = path_of(
                data.record, data.parts, data.leadings, state, keeps_drift=keeps_drift
            )
            if data.seeks_lag:
                chosen = choices[-1].problem.whole.of(*choices[-1].parts)
                options.say(f"{chosen.name}; is there a lag between the clocks?")
                if (lagging := fit_lagging(choices, data.record, data.parts, state)) is not None:
                    choices, moved, lag = lagging
                    clocks = data.clocks._replace(lag=lag.lag, lag_error=lag.error)
                    data = replace(data, record=moved, clocks=clocks)
            choices, data = _of_latest(choices, data, state, keeps_drift)
            path = fitted(choices)
            for mean in averaged(choices[-1], options.either_sign) if options.is_auto else ():
                if not mean.meaning.shares:  # one of either sign stands beside
                    path = tuple(one for one in path if one.held_out > mean.held_out)
                path = (*path, mean)
        else:
            path = fit_conditioned(
                data.record, data.parts, data.condition, data.leadings, state,
                options.is_auto and options.either_sign,
            )  # fmt: skip
        outputs_together(path, data.record)
        results = []
        for linear in path:
            chosen = "" if linear.meaning.shares else f" {linear.strength:g}, chosen with the parts"
            notes = [f"Prior strength{chosen or 's of the parts, chosen'} on {data.parts.how}."]
            if getattr(linear.meaning, "members", ()):
                notes = [_average_in_words(linear.meaning)]
            if linear.meaning.shares:
                notes.append(SIGNED)
            if data.clocks.lag:
                notes.append(_lag_in_words(data))
            notes += _condition_in_words(linear, data)
            detail, name = Composition(linear), linear.meaning.name
            results.append(_trial(name, linear, detail, data, tuple(notes), seed))
        return results


def _of_latest(
    path: list[Tried], data: TrainingData, initial: Any, keeps_drift: bool
) -> tuple[list[Tried], TrainingData]:
    """The choices learnt from the last cycles alone where that is earned on the rows held out from both.

    They are looked for where the parts that were found with all cycles are better so.
    """
    if not data.may_leave_out:
        return path, data
    found, best = data, next(one for one in reversed(path) if not one.problem.whole.first)
    for parts in latest(data.record, data.parts):
        own = best.problem
        few = Problem(data.record, parts.merged, own.whole, own.memory)
        same = few.tried(best.parts, best.strength)
        if not earned(best.blocks, same.blocks):
            continue
        again = path_of(data.record, parts, data.leadings, initial, keeps_drift=keeps_drift)
        # Few cycles may not lead part by part to where all of them have led; a drift they tell less of.
        if not set(DRIFTS) & {*same.parts} and earned(again[-1].blocks, same.blocks):
            again.append(same)
        if earned(path[-1].blocks, again[-1].blocks):
            path, found = again, replace(data, parts=parts)
    return path, found


def state_of(initial: str) -> Any:
    """The relays of a composition before the first sample, where the user left that open: all down."""
    return "negative" if initial in ("auto", "fit") else initial


def _trial(
    name: str,
    linear: LinearFit,
    detail: GridWeights | Composition,
    data: TrainingData,
    notes: tuple[str, ...],
    seed: int,
) -> Trial:
    model = linear.model
    predicted = linear.outputs(data.record)
    predicted = predict(model, data.record) if predicted is None else predicted
    judged = evidence(data.record, data.parts, predicted, linear.held_out)

    def drawn(count: int) -> dict[str, Any]:
        totals, covariance = linear.totals(judged.noise, count, np.random.default_rng(seed))
        errors = np.sqrt(np.diagonal(covariance))
        parameters = _parameters(linear, totals, errors, data.record.output_unit)
        return {"parameters": parameters, "covariance": covariance}

    found = FitResult(
        name=name,
        model=model,
        **drawn(FEW),
        **judged._asdict(),
        success=True,
        blocks=linear.blocks * linear.meaning.scale**2,
        notes=notes,
        detail=detail,
        **data.shown,
        seed=seed,
    )
    return Trial(found, lambda _: replace(found, **drawn(DRAWS)))


def _parameters(
    linear: LinearFit, totals: np.ndarray, errors: np.ndarray, unit: str
) -> tuple[Parameter, ...]:
    """The sums with their errors, where the data know them, and the shares that the data leave open."""
    known = np.ones(len(totals), bool) if linear.known is None else linear.known.determined
    sums = [
        Parameter(name, float(value), unit, float(error), "free") if there
        else Parameter(name, float(value), unit, None, "unidentified")
        for name, value, error, there in zip(
            linear.meaning.total_names, totals, errors, known, strict=True
        )
    ]  # fmt: skip
    shares = [
        Parameter(share.name, share.value, unit, None, "inseparable", share.low, share.high)
        for share in linear.open_shares()
    ]
    return (*sums, *shares)


def _condition_in_words(linear: LinearFit, data: TrainingData) -> list[str]:
    blocks, unit = linear.blocks * linear.meaning.scale**2, data.record.output_unit
    found = trained_condition(linear.model, data.record, blocks)
    if found is None:
        return []
    if found.error is None:
        least = "Fewer than three values were trained, so the error between them is not known."
        return [str(found), least] if found.values is not None else [str(found)]
    said = f"At trained values that were held out it errs by {quantity(found.error, unit, 3)} rms."
    return [str(found), said]


def _average_in_words(mean: CompositionUnknowns) -> str:
    members = " and ".join(f"{one.name} (weight {one.weight:.2f})" for one in mean.members)
    return f"The average of {members}, by their held-out errors."


def _lag_in_words(data: TrainingData) -> str:
    record, clocks = data.record, data.clocks
    return (
        f"{record.output_name} lags {record.input_name} by {clocks.lag:.3g} +-"
        f" {clocks.lag_error:.1g} {record.time_unit}: taken out before the fit (--clocks keep"
        " leaves it in)."
    )
