"""What a fit works on: the record as the models see it, prepared once, and what it shows of itself."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hysteresis import AbstractModel, ChannelMap, Note, Record
from hysteresis._registry import registered
from hysteresis.records._excitation import check_identifiable

from ..diagnostics._residual_breakdown import extrapolation
from ..linear._channel_map_fit import fit_channel_map
from ..linear._conditioned_fit import by_condition
from ..records._clocks import Clocks, is_held, rates_differ
from ..records._conditions import condition_parts, name_of_condition
from ..records._folds import Parts, block_errors, parts
from ..records._new_record import as_condition, combine
from ..records._orientation import initial_states, orientations, output_falls, thinned
from ..records._sequence_terms import SequenceTerms
from ..results._fit_result import FitResult
from ..results._goodness_of_fit import Baseline, metrics
from ._baselines import baselines_of


@dataclass(frozen=True)
class TrainingData:
    """A record made ready for every candidate of a fit.

    - `record`: as the models see it: channels combined, clocks corrected.
    - `test`: the record to judge on, its channels combined too; None where nothing is held out.
    - `parts`: the training rows cut into parts, and the folds made of them.
    - `falls`: whether the output falls, on the whole, as the input rises.
    - `leadings`: orientations worth trying. `initials`: initial states worth trying.
    - `clocks`: what was done to the input. `channels`: what combined several channels into it.
    - `may_leave_out`: whether a fit may leave out first cycles.
    - `seeks_lag`: whether a constant lag between the clocks may be looked for.
    - `warnings`: what is wrong with the data though a fit is possible.
    - `condition`: the name of the condition that the output depends on; None without one.
    - `sequences`: what predicts the rows behind known ones in place of the model.
    """

    record: Record
    test: Record | None
    parts: Parts
    falls: bool
    leadings: tuple[bool, ...]
    initials: tuple[str, ...]
    clocks: Clocks
    channels: ChannelMap | None
    seeks_lag: bool
    warnings: tuple[Note, ...]
    may_leave_out: bool
    condition: str | None = None
    sequences: SequenceTerms | None = None

    @property
    def shown(self) -> dict[str, Any]:
        """What a fit of these data says of them."""
        return {"train": self.record, "clocks": self.clocks, "channels": self.channels}

    @property
    def rising(self) -> Record:
        """The record, its output's sign turned where that falls: what a model that rises starts from."""
        return replace(self.record, output=-self.record.output) if self.falls else self.record

    def tested(self, fit: FitResult) -> FitResult:
        """The fit with its figures on the test record, if there is one, all of `FitResult.predict`."""
        fit = replace(fit, sequences=self.sequences)
        (low, high), u = fit.trained, fit.train.input
        if ((u < low) | (u > high)).any():
            # Rows that do not count drive the model beyond the inputs it was fitted to, where the model
            # alone saturates and a prediction goes on.
            predicted = fit.predict(fit.train)
            residuals = np.where(fit.train.mask, predicted - fit.train.output, np.nan)
            figures = {
                **fit.metrics,
                "train": metrics(fit.train.output, predicted, fit.used, fit.train.weights),
            }
            fit = replace(fit, residuals=residuals, metrics=figures)
        if self.test is None:
            return fit
        judged = replace(fit, test=fit.clocks.applied(self.test))
        predicted, counted = judged.predict(self.test), self.test.mask
        weights = self.test.weights
        held_out = metrics(self.test.output, predicted, counted, weights)
        blocks = np.array(block_errors((weights * (predicted - self.test.output))[counted]))
        return replace(
            judged,
            metrics={**fit.metrics, "test": held_out},
            test_blocks=blocks,
            extrapolation=extrapolation(judged, predicted),
        )

    def baselines(self) -> tuple[Baseline, ...]:
        """Simple predictors on the same folds and rows as every candidate."""
        columns = () if self.channels is None else self.channels.names
        columns = (*columns, *self.record.conditions)
        test = None if self.test is None else self.clocks.applied(self.test)
        return baselines_of(self.record, self.parts, test, columns, self.channels is not None)


def training_data(
    record: Record,
    test: Record | None,
    *,
    keep_conditioning: bool,
    keep_clocks: bool,
    may_modulate: bool,
    say: Callable[[str], None],
) -> TrainingData:
    """Prepare a record, each step once and in the order in which the models see its effects.

    `keep_conditioning` keeps first cycles that differ from the later ones; `keep_clocks` keeps the input as
    it is; `may_modulate`: one of two channels may become a condition of the other.

    Raises `InputError` where the record cannot identify anything.
    """
    channels = None
    if record.channels:
        given = thinned(record)
        channels, record, missed = fit_channel_map(given, keep_conditioning=keep_conditioning)
        two = may_modulate and len(channels.names) == len(given.channels) == 2
        if two and (other := by_condition(given, missed)) is not None:
            channels, record = None, other
        if test is not None:
            test = as_condition(thinned(test), record.input_name, record.conditions)
            test = combine(test, channels)
        say(record.history[-1])
    warnings = tuple(check_identifiable(record))
    condition = name_of_condition(record)
    if condition is not None and not np.ptp(record.columns[condition][record.mask]):
        said = f"{condition!r} is constant in the training rows, so its effect is not fitted."
        record, condition = record.noted("constant-condition", said, conditions={}), None
    updates_late = not keep_clocks and record.time is not None and is_held(record)
    clocks = Clocks(interpolated=updates_late)
    rows, record = len(record), thinned(clocks.applied(record))
    if len(record) < rows:
        say(record.history[-1])
    test = None if test is None else thinned(clocks.applied(test))
    falls, leadings, initials = output_falls(record), orientations(record), initial_states(record)
    cut = (
        parts(record, keep_conditioning=keep_conditioning)
        if condition is None
        else condition_parts(record, condition)
    )
    if clocks.interpolated:
        say(f"{record.input_name} is updated less often than read: linear between its updates")
    say(f"{int(record.mask.sum())} training rows; candidates are ranked on {cut.how}")
    return TrainingData(
        record, test, cut, falls, leadings, initials, clocks, channels,
        # At a single rate a lag between the clocks is one loop more, and curves of channels take it up.
        seeks_lag=not keep_clocks and channels is None and not condition and rates_differ(record),
        warnings=warnings, may_leave_out=not keep_conditioning, condition=condition,
    )  # fmt: skip


# A candidate of a fit: what every way to a model offers to `fit`.

Report = Callable[[str], None]
Said = Mapping[str, Mapping[str, Any]]


class Options(NamedTuple):
    """What the user chose about a fit beside its models, see `fit`.

    `alone`: no other candidate is fitted. `say`: takes a line of progress. `keeps_drift`: what drifts in
    the training rows stays in the model. `is_auto`: models that cannot be as good are left out, and
    compositions averaged with simpler ones, with parts of `either_sign` if they may be. `until`: when no
    further model or start is begun, by `time.perf_counter`.
    """

    initial: str
    starts: int
    seed: int
    noise: str
    parameters: Said
    alone: bool
    say: Report
    keeps_drift: bool = False
    is_auto: bool = False
    either_sign: bool = False
    until: float = float("inf")


class Trial(NamedTuple):
    """A candidate that was fitted; `explained` gives the chosen one a noise of its own, or more draws."""

    fit: FitResult
    explained: Callable[[str], FitResult] | None = None

    def with_noise(self, noise: str, data: TrainingData) -> FitResult:
        """The chosen fit, its noise and errors explained, from the optimum that the search found."""
        if self.explained is None:
            return self.fit
        return replace(data.tested(self.explained(noise)), seconds=self.fit.seconds)


@dataclass(frozen=True)
class Candidate(ABC):
    """A model to fit: its name in the result, its class, and the model to start from, if one was given.

    The class is None where the fit looks for one. `has_weights`: it is fitted as weights, linear in the
    output, not as few parameters.
    """

    name: str
    kind: type[AbstractModel] | None = None
    template: AbstractModel | None = None

    has_weights: ClassVar[bool] = True

    @abstractmethod
    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        """The fits, several of one that grows.

        Raises `InputError` where the data do not allow any.
        """

    def suits(self, data: TrainingData, purpose: str) -> bool:
        """Whether `"auto"` tries it on these data."""
        return self.kind is None or data.condition is None

    def suggested(self, record: Record) -> AbstractModel | None:
        """The model that the record suggests; None where a model is given and its class has no guess.

        Raises `InputError` where neither is known to start from.
        """
        known = None if self.kind is None else registered(self.kind)
        if known is not None and (self.template is None or known.guess is not None):
            return known.start(record)
        return None
