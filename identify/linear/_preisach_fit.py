"""Fitting a Preisach model on a grid: shape, resolution and prior strength, then the weights."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import Preisach, Record
from hysteresis.preisach import Initial

from ..noise._residual_statistics import Noise
from ..records._folds import Parts
from ._preisach_problem import COARSE, PreisachProblem, minimum
from ._preisach_unknowns import Unknowns, refined
from ._projected_draws import Tell, projected_draws, variance_of_unknowns

STRENGTHS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""Prior strengths tried on the first grid, the strongest first; a finer one tries its best's nearest."""

GRIDS = (COARSE, 2 * COARSE, 4 * COARSE)
"""Cells of the grids tried, each of the later ones refined where the one before has its mass."""


class LinearFit(NamedTuple):
    """A Preisach model fitted, and what its posterior needs.

    - `at`: the unknowns at the minimum, `meaning` what they stand for.
    - `H`, `b`: the minimised x'Hx/2 - b'x over `rows` rows, prior included.
    - `strength`: lambda; `dropped`: whether the conditioning cycle was left out of the fit.
    - `blocks`: held-out mean squared errors, over scale^2, at that choice.
    """

    at: Float[np.ndarray, " unknowns"]
    meaning: Unknowns
    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    rows: int
    strength: float
    dropped: bool
    blocks: Float[np.ndarray, " blocks"]

    @property
    def model(self) -> Preisach:
        return self.meaning.model(self.at)

    def draws(
        self,
        noise: Noise,
        count: int,
        random: np.random.Generator,
        tell: Tell = lambda done: None,
    ) -> Float[np.ndarray, "count unknowns"]:
        """Draws from the projected Gaussian posterior, see `projected_draws`."""

        def project(moved: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
            return minimum(self.meaning, self.H, moved, self.at != 0)

        variance = variance_of_unknowns(noise, self.meaning.scale, self.rows)
        return projected_draws(self.H, self.b, project, variance, count, random, tell)


def fit_preisach(
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    initials: tuple[Initial | str, ...],
    cells: tuple[int, ...] = GRIDS,
    dead_band: float = 0.0,
) -> LinearFit:
    """Fit every shape, choose shape, grid and prior strength, refit on all the training parts.

    Orientation and initial state show on the first, coarse grid. Each finer one has twice the cells
    and splits only those that hold a share of the mass; it is tried as long as the one before lowered the
    held-out error by a tenth and the rows outnumber its unknowns two to one.

    Among the choices whose held-out error is above the best one's by less than the standard error
    of that difference, paired by blocks of rows, the simplest is taken: fewer cells, then a stronger prior.
    A conditioning cycle is left out of the fit where that predicts the held-out one better.
    """
    counted = parts.label >= 0
    u, y = record.input[counted], record.output[counted]
    low, high, scale = float(u.min()), float(u.max()), float(np.ptp(y))
    drops = (False,) if parts.conditioning is None else (False, True)

    def tried(meaning: Unknowns, strengths: Iterable[float]) -> list[_Choice]:
        problem = PreisachProblem(record, parts, meaning)
        return [
            _Choice(problem, strength, dropped, problem.held_out_errors(strength, dropped))
            for strength in strengths
            for dropped in drops
        ]

    coarse, *finer = cells
    shapes = [
        Unknowns(coarse, low, high, leading, initial, scale, dead_band)
        for leading in leadings
        for initial in initials
    ]
    choices = [choice for shape in shapes for choice in tried(shape, STRENGTHS)]
    best = _best(choices)
    choices = [c for c in choices if c.problem is best.problem]
    for n in finer:
        shape = best.problem.meaning
        block = refined(shape.block, shape.masses(_fitted(best).at))
        meaning = Unknowns(n, low, high, shape.leading, shape.initial, scale, dead_band, block)
        if n > 2 * coarse and 2 * meaning.count > len(u):
            break
        choices += tried(meaning, (best.strength * k for k in (10.0, 1.0, 0.1, 0.01)))
        before, best = best, _best(choices)
        if best.blocks.mean() > 0.8 * before.blocks.mean():
            break

    def as_good(choice: _Choice) -> bool:
        worse = choice.blocks - best.blocks
        return bool(worse.mean() <= np.std(worse) / np.sqrt(len(worse)))

    return _fitted(next(c for c in choices if c.dropped == best.dropped and as_good(c)))


class _Choice(NamedTuple):
    problem: PreisachProblem
    strength: float
    dropped: bool
    blocks: Float[np.ndarray, " blocks"]


def _best(choices: list[_Choice]) -> _Choice:
    """The least held-out error; within a thousandth of it the first one named."""
    least = min(c.blocks.mean() for c in choices)
    return next(c for c in choices if c.blocks.mean() <= 1.001 * least)


def _fitted(choice: _Choice) -> LinearFit:
    """A choice, fitted to all the training parts."""
    problem, strength, dropped, blocks = choice
    which = problem.parts.without_conditioning(problem.parts.all, dropped)
    H, b = problem.objective(which, strength)
    rows = problem.total(which).rows
    at = minimum(problem.meaning, H, b)
    return LinearFit(at, problem.meaning, H, b, rows, strength, dropped, blocks)
