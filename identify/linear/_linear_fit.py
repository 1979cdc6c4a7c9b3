"""A model that is linear in its unknowns, fitted: the minimum, and the posterior about it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float

from hysteresis import AbstractModel, Record
from hysteresis.numerics._functions import NORMAL_95

from ..noise._residual_statistics import Noise
from ..records._new_record import same_inputs
from ._composition import CompositionUnknowns
from ._composition_parts import PARTS, MemoryLayout, memory_blocks
from ._conditioned_unknowns import ConditionedUnknowns
from ._preisach_unknowns import NOT_SEPARABLE, GridUnknowns
from ._unknown_vectors import in_units

Unknowns = TypeVar("Unknowns", GridUnknowns, CompositionUnknowns, ConditionedUnknowns)
"""What the unknowns of a linear model stand for.

`model` makes the model of them, `minimum` finds them among the possible models, `scale` is their unit of
the output, offsets are counted from `centre`, and the rows of `totals` sum them up to what `total_names`
names.
"""


class OpenShare(NamedTuple):
    """A figure that the data leave open between two ends; None where there is no end."""

    name: str
    value: float
    low: float | None
    high: float | None


class KnownSums(NamedTuple):
    """What a fit of a grid knows of the rows of `GridUnknowns.sums`, over scale.

    - `covariance`: of the sums, by correlated noise and the prior's bias.
    - `determined`: which of `totals` the data know rather than the prior.
    - `shift`: how far a prior of a tenth of the strength moves them; None in a fit that was loaded.
    """

    covariance: Float[np.ndarray, "all_sums all_sums"]
    determined: Bool[np.ndarray, " sums"]
    shift: Float[np.ndarray, " all_sums"] | None = None


@dataclass(frozen=True, eq=False)
class LinearFit(Generic[Unknowns]):
    """A linear model fitted, and what its posterior needs.

    - `unknowns`: those at the minimum, `meaning` what they stand for.
    - `H`, `b`: the minimised x'Hx/2 - b'x over `rows` rows, prior included.
    - `strength`: of the prior.
    - `blocks`: held-out mean squared errors, over scale^2, at that choice.
    - `last`: the record on which outputs were computed last, and they.
    - `known`: of a grid, what it knows of its sums; None: all of them, and draws give errors.
    """

    unknowns: Float[np.ndarray, " unknowns"]
    meaning: Unknowns
    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    rows: int
    strength: float
    blocks: Float[np.ndarray, " blocks"]
    known: KnownSums | None = None
    last: tuple[Record, Float[np.ndarray, " samples"]] | None = field(default=None, repr=False)

    @cached_property
    def model(self) -> AbstractModel:
        """The model of the unknowns."""
        return self.meaning.model(self.unknowns)

    @property
    def shift(self) -> Float[np.ndarray, " sums"]:
        """How far a weaker prior moves the sums, over scale; 0 where that is not known."""
        count = len(self.meaning.totals)
        known = None if self.known is None else self.known.shift
        return np.zeros(count) if known is None else known[:count]

    @property
    def held_out(self) -> float:
        """The mean squared held-out error, in the output's unit squared."""
        return float(self.blocks.mean()) * self.meaning.scale**2

    def outputs(self, record: Record) -> Float[np.ndarray, " samples"] | None:
        """The model's output on a record, from its columns in blocks: compiled for no length.

        None for a condition, for a fit that is not `is_current`, and beyond the inputs of the fit, where a
        model is `extended`. Those of the last record are kept: training and test rows are often of one.
        """
        if not self._has_columns(record):
            return None
        if self.last is None or not same_inputs(self.last[0], record):
            outputs_together([self], record)
        assert self.last is not None
        return self.last[1].copy()

    def _has_columns(self, record: Record) -> bool:
        meaning, u = self.meaning, record.input
        if isinstance(meaning, ConditionedUnknowns):
            return False
        return self.is_current and bool(meaning.low <= u.min() and u.max() <= meaning.high)

    @property
    def is_current(self) -> bool:
        """Whether the unknowns are those that parts have now: an earlier version had other cells."""
        return len(self.unknowns) == self.meaning.count

    def draws(
        self,
        noise: Noise,
        count: int,
        random: np.random.Generator,
    ) -> Float[np.ndarray, "count unknowns"]:
        """Draws from the projected Gaussian posterior: independent, and each a model there can be.

        x = argmin over those models of (x - z)'Q(x - z), z Gaussian about the unconstrained minimum of
        x'Hx/2 - b'x with precision Q = H / variance. That moves b by a Gaussian with covariance
        H variance, and the solver of the fit projects.

        Source: Everink, Dong, Andersen, Bayesian inference with projected densities, SIAM/ASA J.
        Uncertainty Quantification 11 (2023).
        """
        # H is a mean over `rows` rows, in squares of `scale`.
        variance = noise.sigma**2 * noise.correlation_time / self.meaning.scale**2 / self.rows
        factor = scipy.linalg.cholesky(self.H, lower=True)
        steps = np.sqrt(variance) * random.normal(size=(count, len(self.b)))
        if isinstance(self.meaning, CompositionUnknowns) and self.meaning.free.all():
            return (
                self.unknowns
                + scipy.linalg.solve_triangular(factor, steps.T, trans=1, lower=True).T
            )
        steps, inside = steps @ factor.T, self.unknowns != 0
        return self.meaning.minimum(self.H, self.b + steps, inside)

    def totals(
        self, noise: Noise, count: int, random: np.random.Generator
    ) -> tuple[Float[np.ndarray, " sums"], Float[np.ndarray, "sums sums"]]:
        """The sums that tell what each part of the model does, in the output's unit, and their covariance.

        Without `known` the covariance is that of projected draws about the fit, not about their mean: where
        the data leave much open the signs push the draws to one side, and the error has to reach there.
        """
        sums, scale = self.meaning.totals, self.meaning.scale
        values = sums @ in_units(self.meaning, self.unknowns) + scale * self.shift
        if self.known is not None:
            return values, scale**2 * self.known.covariance[: len(values), : len(values)]
        deviations = scale * (self.draws(noise, count, random) - self.unknowns) @ sums.T
        return values, deviations.T @ deviations / count

    def open_shares(self) -> tuple[OpenShare, ...]:
        """What the data do not separate, with the 90 % interval of each end of its range."""
        meaning, scale = self.meaning, self.meaning.scale
        if not isinstance(meaning, GridUnknowns) or self.known is None:
            return ()
        unknowns = in_units(meaning, self.unknowns)
        values = meaning.shares @ unknowns
        variances = np.diagonal(self.known.covariance)[len(meaning.total_names) :]
        errors = np.sqrt(variances).reshape(2, -1)
        low, high = (
            rows @ unknowns + scale * side * NORMAL_95 * error
            for side, rows, error in zip((-1, 1), meaning.share_ranges, errors, strict=True)
        )
        # An output that falls has a negative scale, which turns the ends over.
        turned = (low, high) if scale > 0 else (high, low)
        ends = ([None if np.isnan(e) else float(e) for e in end] for end in turned)
        return tuple(map(OpenShare, NOT_SEPARABLE, values.tolist(), *ends))


def outputs_together(fits: Sequence[LinearFit], record: Record) -> None:
    """Compute the outputs of several fits on a record, which `LinearFit.outputs` then gives.

    Compositions that read the same memory of the input have it computed once.
    """
    kinds: dict[MemoryLayout, list[tuple[LinearFit, CompositionUnknowns]]] = {}
    for fit in fits:
        if not fit._has_columns(record):
            continue
        if isinstance(fit.meaning, GridUnknowns):
            _keep(fit, record, fit.meaning.outputs(record, fit.unknowns))
        elif isinstance(fit.meaning, CompositionUnknowns):
            whole = fit.meaning._replace(parts=PARTS).memory()
            kinds.setdefault(whole, []).append((fit, fit.meaning))
    for alike in kinds.values():
        parts = tuple(dict.fromkeys(part for _, meaning in alike for part in meaning.parts))
        layout = alike[0][1]._replace(parts=parts).memory()
        found = np.empty((len(alike), len(record)))
        for rows, memory in memory_blocks(layout, record, np.arange(len(record))):
            for output, (fit, meaning) in zip(found, alike, strict=True):
                output[rows] = meaning.outputs(memory, fit.unknowns)
        for output, (fit, _) in zip(found, alike, strict=True):
            _keep(fit, record, output)


def _keep(fit: LinearFit, record: Record, outputs: Float[np.ndarray, " samples"]) -> None:
    object.__setattr__(fit, "last", (record, outputs))
