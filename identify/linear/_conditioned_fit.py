"""Fitting a composition that depends on a condition: which parts, how many knots, on which axis."""

from collections.abc import Callable
from copy import copy
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record
from hysteresis.models._conditioned import AXES
from hysteresis.preisach import Initial

from .._levels import MUCH
from ..records._conditions import condition_parts, inner_folds, trained_values
from ..records._folds import BLOCKS_OF_FOLD, Parts, as_good, best_of, earned, simplest
from ..records._new_record import as_condition
from ..records._orientation import orientations
from ._average import shares
from ._composition_fit import (
    DRIFT_GAIN,
    STRENGTHS_OF_PRIOR,
    Problem,
    Solved,
    Tried,
    _path,
    unknowns_for,
)
from ._composition_parts import CURVE, DRIFTS, FRICTION, MAXWELL, PARTS, STOPS
from ._conditioned_unknowns import ConditionedUnknowns, on_axis, shares_of
from ._cross_validation import jittered
from ._linear_fit import LinearFit

COUNTS = (2, 5)
"""Numbers of knots tried, beside one, with which the condition does not matter. With more values trained,
those next to even steps on the axis are knots."""

NO_ZERO = ("degC", "degF")
"""Units whose zero is a convention: the logarithm and the reciprocal of such a value mean nothing."""

CONDITIONED = tuple(part for part in PARTS if part not in DRIFTS)
"""A condition may change slowly in a run, so a drift is not told from its effect."""


SIGNED = (CURVE, MAXWELL, STOPS, FRICTION)
"""Parts of few unknowns, which are as many at every knot."""


def fit_conditioned(
    record: Record,
    parts: Parts,
    name: str,
    leadings: tuple[bool, ...],
    initial: Initial = "negative",
    either_sign: bool = False,
) -> tuple[LinearFit, ...]:
    """Compositions from a curve alone to the best one, each of whose unknowns depend on a condition; and
    one of few parts with weights of `either_sign`, if they may be.

    `parts` hold one value of the condition each, see `condition_parts`. A curve with every number of
    knots on every axis is tried first; with the best of them parts join one by one as in
    `path_of`; with those the number of knots is chosen again: the fewest that are as good as the
    best. Where two choices are the same on all held-out parts, more knots are taken: each trained value is
    then met by a knot of its own.
    """
    found = []
    for leading in leadings:
        base = ConditionedProblem(record, parts, name, leading, initial, CONDITIONED)
        problem = _several(base, _rising((CURVE,), STRENGTHS_OF_PRIOR), base.axes).problem
        assert isinstance(problem, ConditionedProblem)
        path = _path(problem.of(problem.axis, min(problem.knot_count, COUNTS[0])))
        last = path[-1]
        chosen = _several(problem, _rising(last.parts, (last.strength,)), (problem.axis,))
        # Whether the condition matters at all is judged on all held-out parts: at the middle of the trained
        # values a model of their mean does well too.
        one = problem.of("linear", 1).tried(last.parts, last.strength)
        found.append((path[:-1], one if as_good(one.blocks, chosen.blocks) else chosen))
    before, best = min(found, key=lambda one: one[1].blocks.mean())
    problem = best.problem
    assert isinstance(problem, ConditionedProblem)
    without = problem.of("linear", 1).tried(best.parts, best.strength)
    path = [*before, *([without] if problem.knot_count > 1 else []), best]
    if either_sign:
        path.append(_of_either_sign(record, parts, name, problem.whole.leading, initial))
    return tuple(choice.problem.fitted(choice) for choice in path)


def by_condition(record: Record, missed: Float[np.ndarray, " blocks"]) -> Record | None:
    """A record of two channels with one of them as the input and the other as a condition, where parts of
    either sign then take away as much of the held-out errors `missed` as those parts have to."""
    found = []
    for alone, name in permutations(record.channels):
        one = as_condition(record, alone, (name,))
        choice = _of_either_sign(one, condition_parts(one, name), name, orientations(one)[0])
        found.append((choice.blocks * choice.problem.whole.scale**2, one))
    blocks, best = min(found, key=lambda one: one[0].mean())
    if len(blocks) != len(missed) or not earned(missed, blocks, DRIFT_GAIN):
        return None
    off, sum_off = (
        100 * float(np.sqrt(x.mean())) / float(np.ptp(record.output[record.mask]))
        for x in (blocks, missed)
    )
    said = (
        f"{', '.join(best.conditions)} sets the effect of {best.input_name}: parts held out are {off:.2g} %"
        f" of the range off, and {sum_off:.2g} % with a sum of both."
    )
    return best.noted("condition", said)


def _rising(
    some: tuple[str, ...], strengths: tuple[float, ...]
) -> Callable[["ConditionedProblem"], list[Tried]]:
    return lambda problem: [problem.tried(some, strength) for strength in strengths]


def _of_either_sign(
    record: Record, parts: Parts, name: str, leading: bool, initial: Initial = "negative"
) -> Tried:
    """A few parts with weights of either sign: where a curve falls at some conditions, or falls while loops
    rise, no sum of parts that rise is like it."""

    def tried(problem: ConditionedProblem) -> list[Tried]:
        problem.whole = problem.whole._replace(shares=shares(problem))
        problem.summed, problem.inside_at = {}, {}
        # The search takes sums over rows, a problem means.
        return [problem.tried(problem.whole.parts, 1 / int(problem.taut.sum()))]

    whole = ConditionedProblem(record, parts, name, leading, initial, SIGNED)
    return _several(whole, tried, whole.axes)


class ConditionedProblem(Problem):
    """The problem of a composition, seen with some knots on an axis of the condition.

    Each part of the record has one value of the condition, so that its normal equations serve for any
    knots: those of the whole are the sum of (h h') x H over the parts, with h the hat functions there. The
    fit itself takes every row's own value.
    """

    def __init__(
        self, record: Record, parts: Parts, name: str, leading: bool, initial: Initial,
        some: tuple[str, ...],
    ) -> None:  # fmt: skip
        whole = unknowns_for(record, parts, initial, some)
        super().__init__(record, parts, whole._replace(leading=leading))
        c = record.columns[name]
        self.condition, self.c = name, c[self.rows]
        self.value = np.array([c[parts.label == p].mean() for p in parts.all])
        used = c[record.mask]
        self.ends = float(used.min()), float(used.max())
        trained = trained_values(record, name)
        if trained is not None:  # a measured one scatters from part to part
            self.value = trained[np.abs(self.value[:, None] - trained).argmin(1)]
        most = COUNTS[-1] if trained is None else min(COUNTS[-1], len(trained))
        self.counts = (*(count for count in COUNTS if count < most), most)
        # Else a logarithmic and a reciprocal axis hardly differ from a straight one.
        wide = self.ends[0] > 0 and self.ends[1] > MUCH * self.ends[0]
        wide = wide and record.conditions[name] not in NO_ZERO
        self.axes = AXES if wide else AXES[:1]
        self.axis, self.knot_count = "linear", 2
        self.summed: dict[tuple[Any, ...], tuple[np.ndarray, np.ndarray]] = {}
        self.inside_at: dict[float, Bool[np.ndarray, " unknowns"]] = {}
        self.inner_folds = inner_folds(trained)

    def of(self, axis: str, knots: int) -> "ConditionedProblem":
        """The same columns with other knots."""
        other = copy(self)
        other.axis, other.knot_count = axis, knots
        return other

    @property
    def hats(self) -> Float[np.ndarray, "rows knots"]:
        return shares_of(self.knots(self.parts.all), self.axis, self.c)

    def knots(self, which: tuple[int, ...]) -> Float[np.ndarray, " knots"]:
        """Knots from the values of some parts: the ends, and those next to even steps between."""
        values = np.unique(self.value[list(which)])
        if len(values) < 2 or self.knot_count < 2:
            return values[:1]
        at = on_axis(self.axis, values)
        even = np.linspace(at[0], at[-1], self.knot_count)
        knots = values[np.unique(np.abs(at[:, None] - even).argmin(0))]
        if len(which) == len(self.value):
            knots[[0, -1]] = self.ends
        return knots

    def objective(
        self, which: tuple[int, ...], some: tuple[str, ...], strength: float
    ) -> tuple[np.ndarray, np.ndarray]:
        H, b = self._sums(which, some)
        prior = np.kron(np.eye(len(self.knots(which))), self.whole.of(*some).prior(strength))
        return jittered(H + prior), b

    def _sums(self, which: tuple[int, ...], some: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        """H and b of the mean squared error over `which`, kept for the next prior tried with `some`."""
        if self.summed and next(iter(self.summed))[1] != some:
            self.summed.clear()
        key = which, some, self.axis, self.knot_count
        if key not in self.summed:
            values, columns = np.unique(self.value[list(which)]), self.whole.where(some)
            alike = [[p for p in which if self.value[p] == v] for v in values]
            cells = np.ix_(columns, columns)
            each = np.stack([sum(self.normal[p].H[cells] for p in own) for own in alike])
            right = np.stack([sum(self.normal[p].b[columns] for p in own) for own in alike])
            h = shares_of(self.knots(which), self.axis, values)
            knots = range(h.shape[1])
            H = np.block([[np.tensordot(h[:, i] * h[:, j], each, 1) for j in knots] for i in knots])
            b = (h.T @ right).ravel()
            rows = sum(self.normal[p].rows for p in which)
            self.summed[key] = np.asarray(H / rows), np.asarray(b / rows)
        return self.summed[key]

    def meaning(self, which: tuple[int, ...], some: tuple[str, ...]) -> ConditionedUnknowns:
        """What the unknowns of a solution stand for."""
        knots = tuple(self.knots(which).tolist())
        unit = self.record.conditions[self.condition]
        return ConditionedUnknowns(self.whole.of(*some), knots, self.condition, unit, self.axis)

    def solution(
        self, which: tuple[int, ...], some: tuple[str, ...], strength: float
    ) -> Float[np.ndarray, " unknowns"]:
        columns, meaning = self.whole.where(some), self.meaning(which, some)
        # What is not zero changes little from one fold, prior or set of parts to the next.
        inside = [self.inside_at.setdefault(knot, self.inside.copy()) for knot in meaning.knots]
        start = np.concatenate([at[columns] for at in inside])
        x = meaning.minimum(*self.objective(which, some, strength), start)
        for at, part in zip(inside, x.reshape(len(inside), -1), strict=True):
            at[columns] = part != 0
        return x

    def predicted(
        self, solved: Solved, some: tuple[str, ...], rows: Bool[np.ndarray, " rows"]
    ) -> Float[np.ndarray, " some"]:
        train, x = solved
        knots = self.knots(train)
        each = self.A[np.ix_(rows, self.whole.where(some))] @ x.reshape(len(knots), -1).T
        return (each * shares_of(knots, self.axis, self.c[rows], going_on=True)).sum(1)

    def fitted(self, choice: Tried) -> LinearFit:
        """A choice, fitted to all the training parts; a plain composition where it has one knot."""
        if self.knot_count < 2:
            return super().fitted(choice)
        meaning = self.meaning(self.parts.all, choice.parts)
        knots = np.array(meaning.knots)
        A = self.A[:, self.whole.where(choice.parts)]
        A = (shares_of(knots, self.axis, self.c)[:, :, None] * A[:, None]).reshape(len(A), -1)
        A, y = self.weighed(A, self.y, self.rows)
        prior = np.kron(np.eye(len(knots)), meaning.base.prior(choice.strength))
        H, b = jittered(A.T @ A / len(A) + prior), A.T @ y / len(A)
        return LinearFit(
            meaning.minimum(H, b), meaning, H, b, len(A), choice.strength, choice.blocks
        )


def _several(
    problem: ConditionedProblem,
    tried: Callable[[ConditionedProblem], list[Tried]],
    axes: tuple[str, ...],
) -> Tried:
    """The axis of the best choice of several knots, and on it the fewest knots that are as good.

    Where whole conditions are held out, only those judge, because knots are for what is between them.
    """
    judged = slice(BLOCKS_OF_FOLD * problem.inner_folds or None)
    by_axis: list[list[_Judged]] = []
    for axis in axes:
        each: list[_Judged] = []
        for count in problem.counts:
            tries = tried(problem.of(axis, count))
            new = simplest(_Judged(one, one.blocks[judged]) for one in tries)
            if each and np.array_equal(new.blocks, each[-1].blocks):
                each.pop()
            each.append(new)
        by_axis.append(each)
    return simplest(min(by_axis, key=lambda each: best_of(each).blocks.mean())).choice


class _Judged(NamedTuple):
    """A choice, and the errors by which it is compared here."""

    choice: Tried
    blocks: Float[np.ndarray, " blocks"]
