"""A specimen like earlier ones: a mixture of their models, with a prior from how those make up each other.

    y = offset + sum_k w_k f_k[u],   w_k ~ normal(1 / J, s),   s^2 = mean of (w_jk - 1 / (J - 1))^2

f_k is the model of the earlier fit k, of J. w_jk are the weights of least squares, none below 0, with which
the others make up the record of fit j. So a cycle of a new specimen tells J + 1 numbers, not a whole model.
J (J - 1) records are simulated once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
import scipy
from jaxtyping import Float

from hysteresis import InputError, Mixture, Record

from .._levels import NOTHING, REPEATS
from ..baselines._contract import AbstractBaseline
from ..baselines._curves import MonotoneBaseline, replay
from ..baselines._input_memory import branches_of
from ..baselines._linear import cubic_per_branch
from ..records._folds import KIND, NEARLY
from ..records._new_record import predict
from ..results._fit_result import FitResult, check_units
from ._parametric import ParametricCandidate
from ._training_data import Options, TrainingData, Trial


@dataclass(frozen=True)
class LikeCandidate(ParametricCandidate):
    """A mixture of the models of earlier fits."""

    earlier: tuple[FitResult, ...] = ()

    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        """Raises `InputError` `not-comparable` where one cycle of an earlier specimen tells its later ones
        worse by the others than by a curve through it, and the new record cannot try that."""
        for one in self.earlier:
            _check_quantities(one, data.record)
        others = [_Others(one.train, self.earlier[:k] + self.earlier[k + 1 :])
                  for k, one in enumerate(self.earlier) if len(self.earlier) > 1]  # fmt: skip
        if others and tells_little(data, self.earlier):
            _check_alike(others)
        weights = _Others(data.record, self.earlier).weights(data.record.mask)
        used = np.flatnonzero(weights[:-1] > 0)
        models = [self.earlier[k].model for k in used]
        said, note = (
            {},
            "One earlier fit does not tell how specimens differ: its weight has a wide prior.",
        )
        if others:
            # About the weight that all would have if specimens did not differ.
            weights_of = np.array([one.weights(one.record.mask)[:-1] for one in others])
            off = weights_of - 1 / weights_of.shape[1]
            spread = max(float(np.sqrt(np.mean(off**2))), NOTHING)
            prior = f"normal({1 / len(self.earlier):.6g}, {spread:.6g})"
            said = {f"weights.{k}": {"prior": prior} for k in range(len(used))}
            note = f"Prior of the weights: {prior}, from how the earlier fits make up each other's records"
            note += ", which two tell badly." if len(others) < REPEATS else "."
        mixed = replace(self, template=Mixture(models, weights[used], weights[-1]), earlier=())
        known = options._replace(parameters=said, starts=1)
        return [_noted(one, note) for one in ParametricCandidate.fitted(mixed, data, known)]


def _noted(trial: Trial, note: str) -> Trial:
    """The trial with a note on its fit."""
    explained = trial.explained
    assert explained is not None
    return Trial(
        replace(trial.fit, notes=(note,)), lambda noise: replace(explained(noise), notes=(note,))
    )


def like(earlier: Sequence[FitResult], record: Record, test: Record | None) -> LikeCandidate:
    """The candidate that mixes the models of earlier fits.

    Raises `InputError` `given-twice` where two of the fits, or one and the new record, are of the same rows
    of a file: a model that has seen the rows that are held out judges itself.
    """
    known = [(one.train,) for one in earlier]
    new = (record,) if test is None else (record, test)
    for some, others in combinations((*known, new), 2):
        for one, other in product(some, others):
            same = one.sha256 and one.sha256 == other.sha256
            if same and np.isin(one.line[one.mask], other.line[other.mask]).any():
                raise InputError(
                    "given-twice", "Two of the earlier fits and the new record are of the same rows.",
                    place=one.source, fix="leave the fit of these rows out.",
                )  # fmt: skip
    count = len(earlier)
    name = f"mixture of {count} earlier fit{'s'[: count > 1]}"
    return LikeCandidate(name, Mixture, earlier=tuple(earlier))


def tells_little(data: TrainingData, earlier: Sequence[FitResult]) -> bool:
    """Whether rows held out from a record do not ask what earlier specimens tell: of a single cycle they
    are pieces, and where its inputs are of a smaller range they say nothing of larger ones."""
    if not earlier:
        return False
    wide = float(np.median([np.ptp(one.trained) for one in earlier]))
    span = float(np.ptp(data.record.input[data.record.mask]))
    return not data.parts.by_cycles or span < (1 - KIND) * wide


class _Others:
    """The outputs of other specimens' models over a record, and a column of ones for the offset."""

    def __init__(self, record: Record, fits: Sequence[FitResult]) -> None:
        self.record = record
        outputs = [predict(one.model, record) for one in fits]
        self.columns = np.column_stack([*outputs, np.ones(len(record))])

    def weights(self, rows: np.ndarray) -> Float[np.ndarray, " weights_and_offset"]:
        """Of least squares in these rows, none but the offset below 0."""
        low = np.append(np.zeros(self.columns.shape[1] - 1), -np.inf)
        w = self.record.weights[rows]
        x, y = w[:, None] * self.columns[rows], w * self.record.output[rows]
        # Bounded-variable least squares is exact: a weight at its bound is 0.
        return scipy.optimize.lsq_linear(x, y, (low, np.inf), method="bvls").x


def _check_alike(others: Sequence[_Others]) -> None:
    """Does the first cycle of every earlier specimen tell its later cycles as well by the other specimens
    as by the best curve through that cycle?"""
    ratios = [0.0]
    for one in others:
        record = one.record
        _, rows = next(record.sequences())
        ends = np.flatnonzero(record.cycle[rows] == 1)
        begin = np.arange(len(record)) <= (ends[-1] if len(ends) else rows.stop - 1)
        seen, later = record.mask & begin, record.mask & ~begin
        if seen.any() and later.any():
            mixed = (one.columns @ one.weights(seen) - record.output)[later]
            curve = _best_curve(replace(record, mask=seen), later)
            ratios.append(float(np.sqrt(np.mean(mixed**2))) / curve)
    if bad := sum(ratio > NEARLY for ratio in ratios):
        raise InputError(
            "not-comparable",
            f"the later cycles of {bad} of {len(others)} earlier specimens are"
            " told worse from their first one by the other specimens than by a curve through it, up to"
            f" {max(ratios):.2g} times.",
            cause="other loads, or specimens that change with use.",
            fix="measure more cycles of the new specimen, or leave --like out.",
        )


def _best_curve(first: Record, later: np.ndarray) -> float:
    """The least rms error, over later rows, of curves through the rows that count."""
    branches, rows = branches_of(first), np.flatnonzero(first.mask)
    curves: list[AbstractBaseline] = [MonotoneBaseline(), cubic_per_branch(first, branches)]
    errors = []
    for one in [*curves, replay(first, branches)]:
        seen = one.prepared(first)
        found = one.predicted(seen, one.fitted(seen, first.output, rows, first.weights))
        errors.append(float(np.sqrt(np.mean((found - first.output)[later] ** 2))))
    return min(errors)


def _check_quantities(fit: FitResult, record: Record) -> None:
    """Raises `InputError` `wrong-unit` where an earlier fit has other units, or not one input."""
    check_units(fit, record)
    had, has = ((one.input_unit, one.output_unit) for one in (fit.train, record))
    if had == has and fit.channels is None and fit.condition is None:
        return
    raise InputError(
        "wrong-unit",
        f"the earlier fit is of {had[1]} over {had[0]}, the record of {has[1]} over {has[0]}"
        f"{'' if had != has else ', and it has several channels or a condition'}.",
        place=fit.train.source,
        fix="give fits of one input, in the units of the record.",
    )
