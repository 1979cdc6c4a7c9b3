"""The average of a composition and of parts of the same kinds whose weights may have either sign.

    w = a w_either + (1 - a) w_rising,   a = e_rising / (e_rising + e_either)

with e the mean squared errors of held-out rows: two ways that err differently err less together. The
weights of either sign are found all at once, with a prior whose strength for each part is chosen on
held-out rows, see `_group_strengths`. The average is taken where it takes away half of the squared held-out
error: weights of either sign explain anything a bit. Its output need not rise with the input.

Cost: some hundred factorisations of the unknowns of all parts, a third of a second.

Source: Bates and Granger, The combination of forecasts, Operational Research Quarterly 20 (1969).
"""

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..records._folds import earned
from ._composition import CompositionUnknowns
from ._composition_fit import DRIFT_GAIN, Problem, Tried
from ._composition_parts import CURVE, DRIFTS, STRENGTHS
from ._composition_prior import places_of
from ._cross_validation import Choice, normal_equations_of
from ._group_strengths import Group, GroupedColumns
from ._group_strengths import Strengths as Search
from ._linear_fit import LinearFit
from ._sliders import PLAYS

BESIDE = (STRENGTHS, PLAYS, *DRIFTS)
"""Parts that are of no other sign: plays are a line less stops, strengths are products of two memories, and
drifts tell of one run."""

LEAST = 1e-6
"""A share with which a part is nothing."""


class Average(NamedTuple):
    """The average as a fit, and the share of the weights of either sign in it."""

    fit: LinearFit[CompositionUnknowns]
    share: float


def averaged(rising: Tried, fit: LinearFit[CompositionUnknowns]) -> Average | None:
    """The average; None where it gains too little over `rising`, which `fit` is fitted to all rows."""
    before = rising.problem
    some = (p for p in before.whole.parts if p in rising.parts or p not in BESIDE)
    whole = before.whole.of(*some)
    whole = whole._replace(shares=_shares(before, whole))
    either = Problem(before.record, before.parts, whole, before.memory, before.weights)
    # The search takes sums over rows, a problem means.
    strength = 1 / int(either.taut.sum())
    solved = {
        fold.train: (
            before.solution(fold.train, rising.parts, rising.strength),
            either.solution(fold.train, whole.parts, strength),
        )
        for fold in before.parts.folds
    }
    own = either.held_out(lambda train: solved[train][1], whole.parts)
    share = float(rising.blocks.mean() / (rising.blocks.mean() + own.mean()))

    def mixed(ours: np.ndarray, theirs: np.ndarray) -> Float[np.ndarray, " unknowns"]:
        w = share * theirs
        w[whole.where(rising.parts)] += (1 - share) * ours
        return w

    blocks = either.held_out(lambda train: mixed(*solved[train]), whole.parts)
    if not earned(rising.blocks, blocks, DRIFT_GAIN):
        return None
    choice = Choice(either, strength, blocks, whole.parts)
    found = either.fitted(choice, either.final(whole.parts), whole.parts)
    w = mixed(fit.unknowns, found.unknowns)
    # What is known of it are the weights of either sign, about the average.
    return Average(replace(found, unknowns=w, b=found.H @ w), share)


def _shares(problem: Problem, whole: CompositionUnknowns) -> tuple[float, ...]:
    """Of a line and of each part, those that predict held-out rows best."""
    signed = [part for part in whole.parts if part not in BESIDE]
    each = [problem.A[:, problem.whole.where((part,))[1:]] for part in signed]
    line = each[signed.index(CURVE)].sum(1)
    ends = np.cumsum([1, *(X.shape[1] for X in each)])
    groups = [Group(np.zeros(1, int), np.zeros((1, 1)), is_expected=True)]
    groups += [
        Group(np.arange(begin, end), places_of(part, end - begin))
        for part, (begin, end) in zip(signed, itertools.pairwise(ends.tolist()), strict=True)
    ]
    columns = GroupedColumns(np.column_stack([line, *each]), groups, even=False)
    of_part = {p: (problem.label == p) & problem.taut for p in problem.parts.all}
    size = float(problem.y[problem.taut].std()) or 1.0
    normal = normal_equations_of(
        *problem.weighed(columns.whitened, problem.y / size, problem.rows), of_part
    )
    found = np.exp(Search(columns, normal, problem.parts.folds).logs) / columns.brought
    shares = dict(zip(("", *signed), found.tolist(), strict=True))
    return tuple(max(shares.get(part, 0.0), LEAST) for part in ("", *whole.parts))
