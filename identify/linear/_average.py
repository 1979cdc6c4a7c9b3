"""Averages of a composition with a simpler one, and with parts whose weights may have either sign.

    w = sum_m a_m w_m,   a_m = (1 / e_m) / (sum_k 1 / e_k)

with e the mean squared errors of held-out rows: ways that err differently err less together.

The simpler one is a curve with plays and stops. Rows of one amplitude cannot ask for another, where it errs
less than what more parts have learnt from them. So it joins with a fifth or more of the weight, even where
that costs a tenth of the held-out error. Each of both rises with the input, and so does their average.

The weights of either sign are found all at once, with a prior whose strength for each part is chosen on
held-out rows, see `_group_strengths`. They do not join at one amplitude: nothing but their sign holds
weights where no row has been. The output need not rise with the input then, so they are an average beside.

Cost: a tenth of a second; with weights of either sign some hundred factorisations of the unknowns of all
parts, a third of a second.

Source: Bates and Granger, The combination of forecasts, Operational Research Quarterly 20 (1969).
"""

import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._levels import NOTHING
from ..records._clocks import amplitudes_differ
from ..records._folds import NEARLY
from ._composition import CompositionUnknowns, Member
from ._composition_fit import Problem, Tried, best_prior
from ._composition_parts import CURVE, DRIFTS, PLAYS, STOPS, STRENGTHS
from ._cross_validation import Choice, normal_equations_of
from ._group_strengths import APART, Group, GroupedColumns, places_of
from ._group_strengths import Strengths as Search
from ._linear_fit import LinearFit

SIMPLE = (CURVE, PLAYS, STOPS)

BESIDE = (STRENGTHS, PLAYS, *DRIFTS)
"""Parts that are of no other sign: plays are a line less stops, strengths are products of two memories, and
drifts tell of one run."""

LEAST_WEIGHT = 0.2
"""Of the simpler composition, to join."""


class _Mean(NamedTuple):
    """Choices and their weights; the unknowns of their average for each fold, and its held-out errors."""

    weights: dict[Tried, float]
    solved: dict[tuple[int, ...], Float[np.ndarray, " unknowns"]]
    blocks: Float[np.ndarray, " blocks"]

    def with_other(self, problem: Problem, other: "_Mean") -> "_Mean":
        """The average of both, by the inverse of their squared errors."""
        share = float(self.blocks.mean() / (self.blocks.mean() + other.blocks.mean()))
        weights = {one: (1 - share) * weight for one, weight in self.weights.items()}
        weights |= {one: share * weight for one, weight in other.weights.items()}
        solved = {k: (1 - share) * w + share * other.solved[k] for k, w in self.solved.items()}
        return _Mean(weights, solved, problem.held_out(solved.__getitem__, problem.whole.parts))


def averaged(best: Tried, either_sign: bool) -> tuple[LinearFit[CompositionUnknowns], ...]:
    """The average of a composition with a simpler one if that joins, and the same with parts of
    `either_sign` if they may be."""
    problem, found = best.problem, []
    mean = _alone(problem, best.parts, best.strength)._replace(
        weights={best: 1.0}, blocks=best.blocks
    )
    if set(SIMPLE) <= {*problem.whole.parts} and not set(SIMPLE) >= {*best.parts}:
        simple = best_prior(problem, SIMPLE)
        both = mean.with_other(problem, _alone(problem, SIMPLE, simple.strength))
        is_near = both.blocks.mean() <= NEARLY**2 * best.blocks.mean()
        if is_near and min(both.weights.values()) >= LEAST_WEIGHT:
            mean = both
            found.append(_fitted(problem, mean, best))
    if either_sign and amplitudes_differ(problem.record):
        other = _of_either_sign(best)
        (base,) = other.weights
        found.append(_fitted(problem, mean.with_other(problem, other), base))
    return tuple(found)


def _alone(problem: Problem, parts: tuple[str, ...], strength: float) -> _Mean:
    solved, places = {}, problem.whole.where(parts)
    for fold in problem.parts.folds:
        solved[fold.train] = np.zeros(problem.whole.count)
        solved[fold.train][places] = problem.solution(fold.train, parts, strength)
    blocks = problem.held_out(solved.__getitem__, problem.whole.parts)
    return _Mean({Choice(problem, strength, blocks, parts): 1.0}, solved, blocks)


def _of_either_sign(best: Tried) -> _Mean:
    """All parts with weights of either sign, whose strengths predict held-out rows best."""
    either = copy.copy(best.problem)
    parts = tuple(p for p in either.whole.parts if p in best.parts or p not in BESIDE)
    either.whole = either.whole._replace(shares=shares(either))
    either.inside = np.ones(either.whole.count, bool)
    # The search takes sums over rows, a problem means.
    return _alone(either, parts, 1 / int(either.taut.sum()))


def _fitted(problem: Problem, mean: _Mean, base: Tried) -> LinearFit[CompositionUnknowns]:
    """The average of fits to all rows; what is known of it are the weights of `base`, about it."""
    every = {part for one in mean.weights for part in one.parts}
    union = problem.whole.of(*every)
    normal, unknowns, members = problem.final(union.parts), np.zeros(union.count), []
    for one, weight in mean.weights.items():
        fit = one.problem.fitted(one, normal, union.parts)
        unknowns[union.where(one.parts)] += weight * fit.unknowns
        error = float(np.sqrt(one.blocks.mean())) * abs(union.scale)
        members.append(Member(fit.meaning.name, weight, error))
    choice = Choice(base.problem, base.strength, mean.blocks, union.parts)
    found = base.problem.fitted(choice, normal, union.parts)
    meaning = found.meaning._replace(members=tuple(members))
    return replace(found, meaning=meaning, unknowns=unknowns, b=found.H @ unknowns)


def shares(problem: Problem) -> tuple[float, ...]:
    """How large weights are expected of a line and of each part: as predicts held-out rows best."""
    signed = [part for part in problem.whole.parts if part not in BESIDE]
    each = [problem.A[:, problem.whole.where((part,))[1:]] for part in signed]
    line = each[signed.index(CURVE)].sum(1, keepdims=True)
    hats = problem.hats
    knots = np.arange(hats.shape[1])
    ones = [np.ones_like(line)] if len(knots) > 1 else []  # an offset at each knot
    columns, groups, end = [], [], 0
    for part, X in [*((None, X) for X in (*ones, line)), *zip(signed, each, strict=True)]:
        columns.append((hats[:, :, None] * X[:, None]).reshape(len(X), -1))
        places = np.zeros((1, 1)) if part is None else places_of(part, X.shape[1])
        apart = APART * np.repeat(knots, len(places))
        places = np.column_stack([np.tile(places, (len(knots), 1)), apart])
        begin, end = end, end + len(places)
        groups.append(Group(np.arange(begin, end), places, is_expected=part is None))
    grouped = GroupedColumns(np.hstack(columns), groups, even=False)
    of_part = {p: (problem.label == p) & problem.taut for p in problem.parts.all}
    size = float(problem.y[problem.taut].std()) or 1.0
    normal = normal_equations_of(
        *problem.weighed(grouped.whitened, problem.y / size, problem.rows), of_part
    )
    found = np.exp(Search(grouped, normal, problem.parts.folds).logs) / grouped.brought
    of = dict(zip(("", *signed), found[len(ones) :].tolist(), strict=True))
    return tuple(max(of.get(part, 0.0), NOTHING) for part in ("", *problem.whole.parts))
