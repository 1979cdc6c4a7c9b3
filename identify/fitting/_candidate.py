"""A candidate of a fit: what every way to a model offers to `fit`."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

from hysteresis import AbstractModel, Record
from hysteresis._registry import registered

from ..results._fit_result import FitResult
from ._training_data import TrainingData

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
