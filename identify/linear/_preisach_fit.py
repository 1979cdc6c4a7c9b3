"""Fitting a Preisach model on a grid: shape, resolution and prior strength, then the weights."""

import itertools
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from hysteresis import Record
from hysteresis.preisach import Initial

from ..records._folds import Parts, best_of, simplest
from ..records._orientation import output_falls
from ._cross_validation import STRENGTHS, Choice
from ._linear_fit import LinearFit
from ._preisach_problem import COARSE, PreisachProblem
from ._preisach_sums import known_sums
from ._preisach_unknowns import GridUnknowns, refined

Tried: TypeAlias = Choice[PreisachProblem]

GRIDS = (COARSE, 2 * COARSE, 4 * COARSE)
"""Cells of the grids tried, each of the later ones refined where the one before has its mass."""

BETTER = 0.8
"""Of the mean square, that of an rms error a tenth less: what another grid has to reach."""


def steep_nodes(
    u: Float[np.ndarray, " rows"], y: Float[np.ndarray, " rows"], cells: int
) -> tuple[float, ...]:
    """Nodes of a grid whose cells are small where the output is steep.

    Half of them are even over the inputs, half over the way of the output from row to row, so no cell is
    wider than two of one width. Those of a grid with twice the cells lie between them.
    """
    order = np.argsort([u[:-1], u[1:]], axis=0)
    low, high = np.take_along_axis(np.stack([u[:-1], u[1:]]), order, 0)
    way = np.abs(np.diff(y))
    inputs = np.unique(u)
    # Of each step of the input between neighbouring readings, the share of the way of every pair across it.
    begin, end = np.searchsorted(inputs, low), np.searchsorted(inputs, high)
    moved = end > begin
    rate = np.zeros(len(inputs))
    slope = way[moved] / (high - low)[moved]
    np.add.at(rate, begin[moved], slope)
    np.add.at(rate, end[moved], -slope)
    passed = np.append(0.0, np.cumsum(np.cumsum(rate)[:-1] * np.diff(inputs)))
    even = (inputs - inputs[0]) / (inputs[-1] - inputs[0])
    steep = passed / passed[-1] if passed[-1] > 0 else even
    return tuple(np.interp(np.linspace(0, 1, cells + 1), (even + steep) / 2, inputs).tolist())


def fit_preisach(
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    initials: tuple[Initial | str, ...],
    cells: tuple[int, ...] = GRIDS,
    dead_band: float = 0.0,
) -> LinearFit[GridUnknowns]:
    """Fit every shape, choose shape, grid and prior strength, refit on all the training parts.

    Orientation and initial state show on the first, coarse grid, and so does whether cells of one width
    serve, or `steep_nodes` lower the held-out error by a tenth. Each finer one has twice the cells and
    splits only those that hold a share of the mass; it is tried as long as the one before lowered the held-out
    error by a tenth and the rows outnumber its unknowns two to one.

    Among the choices whose held-out error is above the best one's by less than the standard error
    of that difference, paired by blocks of rows, the simplest is taken: fewer cells, then a stronger prior.
    A conditioning cycle is left out of the fit where that predicts the held-out one better.
    """
    parts = parts.merged
    counted = parts.label >= 0
    u, y = record.input[counted], record.output[counted]
    low, high = float(u.min()), float(u.max())
    scale, centre = float(np.ptp(y)) * (-1 if output_falls(record) else 1), float(y.mean())
    drops = (False,) if parts.conditioning is None else (False, True)

    def tried(meaning: GridUnknowns, strengths: Iterable[float]) -> list[Tried]:
        problem = PreisachProblem(record, parts, meaning)
        pairs = list(itertools.product(strengths, drops))
        return [
            Choice(problem, strength, blocks, dropped=dropped)
            for (strength, dropped), blocks in zip(
                pairs, problem.held_out_errors(pairs), strict=True
            )
        ]

    coarse, *finer = cells
    shapes = [
        GridUnknowns(coarse, low, high, leading, initial, scale, dead_band, centre=centre)
        for leading in leadings
        for initial in initials
    ]
    choices = [choice for shape in shapes for choice in tried(shape, STRENGTHS)]
    best = _best(choices)
    choices = [c for c in choices if c.problem is best.problem]
    warped = False
    if finer:
        shape = best.problem.meaning
        steep = tried(
            GridUnknowns(
                coarse, low, high, shape.leading, shape.initial, scale, dead_band, centre=centre,
                nodes=steep_nodes(u, y, coarse),
            ),
            STRENGTHS,
        )  # fmt: skip
        if warped := _best(steep).blocks.mean() < BETTER * best.blocks.mean():
            choices, best = choices + steep, _best(steep)
    for n in finer:
        shape = best.problem.meaning
        block = refined(shape.block, shape.masses(_fitted(best).unknowns))
        nodes = steep_nodes(u, y, n) if warped else None
        meaning = GridUnknowns(
            n, low, high, shape.leading, shape.initial, scale, dead_band, block, centre, nodes
        )
        if n > 2 * coarse and 2 * meaning.count > len(u):
            break
        choices += tried(meaning, (best.strength * k for k in (10.0, 1.0, 0.1, 0.01)))
        before, best = best, _best(choices)
        if best.blocks.mean() > BETTER * before.blocks.mean():
            break

    same = [c for c in choices if c.dropped == best.dropped]
    return _fitted(simplest(same, best), final=True)


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
