"""Fitting a Preisach model on a grid: shape, resolution and prior strength, then the weights."""

from collections.abc import Iterable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from hysteresis import Record
from hysteresis.preisach import Initial

from ..records._folds import Parts, best_of, earned, simplest
from ..records._orientation import output_falls
from ._cross_validation import STRENGTHS, Choice
from ._linear_fit import LinearFit
from ._preisach_problem import COARSE, PreisachProblem
from ._preisach_sums import known_sums
from ._preisach_unknowns import GridUnknowns, refined

Tried: TypeAlias = Choice[PreisachProblem]

GRIDS = (COARSE, 2 * COARSE, 4 * COARSE)
"""Cells of the grids tried, each of the later ones refined where the one before has its mass."""


def fit_preisach(
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    initials: tuple[Initial | str, ...],
    cells: tuple[int, ...] = GRIDS,
    dead_band: float = 0.0,
) -> LinearFit[GridUnknowns]:
    """Fit every shape, choose shape, grid and prior strength, refit on all the training parts.

    Orientation and initial state show on the first, coarse grid. Each finer one has twice the cells
    and splits only those that hold a share of the mass; it is tried as long as the one before lowered the
    held-out error by a tenth and the rows outnumber its unknowns two to one.

    Among the choices whose held-out error is above the best one's by less than the standard error
    of that difference, paired by blocks of rows, the simplest is taken: fewer cells, then a stronger prior.
    A conditioning cycle is left out of the fit where that takes away a part of the held-out error, see
    `earned`.
    """
    parts = parts.merged
    counted = parts.label >= 0
    u, y = record.input[counted], record.output[counted]
    low, high = float(u.min()), float(u.max())
    scale, centre = float(np.ptp(y)) * (-1 if output_falls(record) else 1), float(y.mean())

    def tried(
        problem: PreisachProblem, strengths: Iterable[float], dropped: bool = False
    ) -> list[Tried]:
        strengths = list(strengths)
        blocks = problem.held_out_errors([(strength, dropped) for strength in strengths])
        return [
            Choice(problem, strength, own, dropped=dropped)
            for strength, own in zip(strengths, blocks, strict=True)
        ]

    coarse, *finer = cells
    shapes = [
        GridUnknowns(coarse, low, high, leading, initial, scale, dead_band, centre=centre)
        for leading in leadings
        for initial in initials
    ]
    choices = [
        choice
        for shape in shapes
        for choice in tried(PreisachProblem(record, parts, shape), STRENGTHS)
    ]
    best = _best(choices)
    choices = [c for c in choices if c.problem is best.problem]
    for n in finer:
        shape = best.problem.meaning
        block = refined(shape.block, shape.masses(_fitted(best).unknowns))
        meaning = GridUnknowns(
            n, low, high, shape.leading, shape.initial, scale, dead_band, block, centre
        )
        if n > 2 * coarse and 2 * meaning.count > len(u):
            break
        problem = PreisachProblem(record, parts, meaning)
        choices += tried(problem, (best.strength * k for k in (10.0, 1.0, 0.1, 0.01)))
        before, best = best, _best(choices)
        if best.blocks.mean() > 0.8 * before.blocks.mean():
            break

    chosen = simplest(choices, best)
    if parts.conditioning is not None:
        (fewer,) = tried(chosen.problem, [chosen.strength], dropped=True)
        chosen = fewer if earned(chosen.blocks, fewer.blocks) else chosen
    return _fitted(chosen, final=True)


def _best(choices: list[Tried]) -> Tried:
    """The least held-out error; within a thousandth of it the first one named."""
    least = best_of(choices).blocks.mean()
    return next(c for c in choices if c.blocks.mean() <= 1.001 * least)


def _fitted(choice: Tried, final: bool = False) -> LinearFit[GridUnknowns]:
    """A choice, fitted to all the training parts; the `final` one with what it knows of sums."""
    problem, meaning = choice.problem, choice.problem.meaning
    which = problem.parts.without_conditioning(problem.parts.all, choice.dropped)
    H, b = problem.objective(which, choice.strength)
    unknowns = meaning.minimum(H, b)
    fit = LinearFit(
        unknowns, meaning, H, b, problem.total(which).rows,
        choice.strength, choice.blocks, choice.dropped,
    )  # fmt: skip
    if not final:
        return fit
    known = known_sums(problem, which, choice.strength, unknowns)
    totals = len(meaning.totals)
    return replace(fit, sums=known.covariance, determined=known.determined[:totals])
