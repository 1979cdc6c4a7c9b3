"""Fitting a composition: which parts, how strong a prior, then all unknowns at once, exactly."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record, Series, Sum
from hysteresis.preisach import Initial

from ..noise._residual_statistics import Noise
from ..records._clocks import least_at, shifted
from ..records._folds import Fold, Parts, as_good, block_errors
from ..records._folds import parts as parts_of
from ._composition import CELLS, CURVE, MAXWELL, PARTS, STRENGTHS, Composition
from ._nnls import nonnegative_least_squares
from ._projected_draws import Tell, projected_draws, variance_of_unknowns

STRENGTHS_OF_PRIOR = (1e-2, 1e-3, 1e-4)
"""Prior strengths tried, the strongest first."""

LAG_ROWS = 10_000
"""Rows that are enough to find a lag with."""

LAG_PRIOR = 1e-5
"""Prior strength with which a lag is looked for."""

SLACK = 0.02
"""Part of the output's range within which it lies on its floor."""

ROWS = 8000
"""Rows that are fitted: of a longer record every k-th, since neighbours say the same."""


class CompositionFit(NamedTuple):
    """A composition fitted, and what its posterior needs.

    - `at`: the unknowns at the minimum, `meaning` what they stand for.
    - `H`, `b`: the minimised x'Hx/2 - b'x over `rows` rows, prior included.
    - `strength`: of the prior.
    - `blocks`: held-out mean squared errors, over scale^2.
    """

    at: Float[np.ndarray, " unknowns"]
    meaning: Composition
    H: Float[np.ndarray, "unknowns unknowns"]
    b: Float[np.ndarray, " unknowns"]
    rows: int
    strength: float
    blocks: Float[np.ndarray, " blocks"]

    @property
    def model(self) -> Sum | Series:
        return self.meaning.model(self.at)

    @property
    def name(self) -> str:
        mapped = " of a mapped input" if self.meaning.first else ""
        return " + ".join(self.meaning.parts) + mapped

    def draws(
        self,
        noise: Noise,
        count: int,
        random: np.random.Generator,
        tell: Tell = lambda done: None,
    ) -> Float[np.ndarray, "count unknowns"]:
        """Draws from the projected Gaussian posterior, see `projected_draws`."""

        def project(moved: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
            return _minimum(self.H, moved, self.at != 0)

        variance = variance_of_unknowns(noise, self.meaning.scale, self.rows)
        return projected_draws(self.H, self.b, project, variance, count, random, tell)


def fit_compositions(
    record: Record, parts: Parts, leadings: tuple[bool, ...], initial: Initial = "negative"
) -> tuple[CompositionFit, ...]:
    """Compositions from a curve alone to the best one, each with one part more.

    Parts join one by one: each time the one that lowers the held-out error most, as long as it does so
    by more than the standard error of the difference, paired by blocks of rows. In the end the input is
    mapped by half of the static curve if that gains as much.
    """
    paths = []
    for leading in leadings:
        for floor in (None, *slack(record)):
            paths.append(_path(Problem(record, parts, leading, initial, floor)))
    path = min(paths, key=lambda path: path[-1].blocks.mean())
    if len(path) > 1:  # a curve behind a curve is a curve
        mapped = _best(path[0].problem.mapped(path[0]), path[-1].parts)
        if not as_good(path[-1].blocks, mapped.blocks):
            path.append(mapped)
    return tuple(choice.problem.fitted(choice) for choice in path)


class Lag(NamedTuple):
    """How long the output lags the input, its standard error, and how the loops go without it.

    `gain`: the part of the mean squared error that it takes away.
    """

    lag: float
    error: float
    leading: bool
    gain: float


def find_lag(record: Record, floor: float | None = None) -> Lag:
    """The lag with which a curve and relaxing branches fit best, of either orientation.

    u(t - lag) drives them; what is minimised over the lag, up to 16 sampling steps, is the mean squared
    error at its minimum in all unknowns. With n rows its logarithm has the curvature 2 / (n error^2)
    there. A part of the sequences serves where there are many rows.
    """
    assert record.time is not None
    labels = record.labels
    few = record.take_sequences(labels[:: max(1, min(len(labels), len(record) // LAG_ROWS))])
    assert few.time is not None
    step = float(np.median(np.diff(few.time)))
    cut, some = parts_of(few), (CURVE, MAXWELL, STRENGTHS)
    found = []
    for leading in (False, True):

        def objective(lag: float, leading: bool = leading) -> float:
            problem = Problem(shifted(few, lag), cut, leading, "negative", floor, some)
            H, b, _ = problem.objective(cut.all, some, LAG_PRIOR)
            left = problem.A @ _minimum(H, b) - problem.y
            return float(np.mean(left[problem.taut] ** 2))

        lag, curvature = least_at(objective, step, 16 * step)
        found.append((objective(lag), lag, curvature, leading, objective(0.0)))
    least, lag, curvature, leading, _ = min(found)
    facts = min(ROWS, int(few.mask.sum()))
    error = float(np.sqrt(2 * least / max(curvature, 1e-300) / facts))
    return Lag(lag, error, leading, 1 - least / min(without for *_, without in found))


class _Choice(NamedTuple):
    problem: "Problem"
    parts: tuple[str, ...]
    strength: float
    blocks: Float[np.ndarray, " blocks"]


class Problem:
    """The columns of every part at the fitted rows, and their products over each part of the record."""

    def __init__(
        self,
        record: Record,
        parts: Parts,
        leading: bool,
        initial: Initial,
        floor: float | None,
        some: tuple[str, ...] = PARTS,
        first: tuple[float, ...] = (),
    ) -> None:
        counted = np.flatnonzero(parts.label >= 0)
        rows = counted[:: -(-len(counted) // ROWS)]
        u, y = record.input[counted], record.output[counted]
        scale = float(np.ptp(y))
        times = relaxation_times(record)
        some = tuple(p for p in some if times or p not in (MAXWELL, STRENGTHS))
        low, high = float(u.min()), float(u.max())
        self.record, self.parts = record, parts
        self.whole = Composition(some, low, high, scale, times, leading, initial, floor, first)
        self.floor = -np.inf if floor is None else floor / scale
        self.label, self.y = parts.label[rows], record.output[rows] / scale
        self.A = self.whole.columns(record, rows)
        self.taut = self.y > self.floor + (
            0 if floor is None else SLACK
        )  # below, y tells only a limit
        self.products = {
            p: (self.A[at].T @ self.A[at], self.A[at].T @ self.y[at], int(at.sum()))
            for p in parts.all
            for at in [(self.label == p) & self.taut]
        }

    def mapped(self, choice: "_Choice") -> "Problem":
        """The same, its input half mapped by the static curve of a choice, which keeps its range.

        One curve, of all training rows, serves for every fold: 40 smooth increments tell little of them.
        """
        meaning, increments = self.whole, self.fitted(choice).at[1 : 1 + CELLS[CURVE]]
        even = np.full(CELLS[CURVE], 1 / CELLS[CURVE])
        half = (even + increments / max(increments.sum(), 1e-12)) / 2
        first = tuple((meaning.high - meaning.low) * half / half.sum())
        return Problem(
            self.record, self.parts, meaning.leading, meaning.initial, meaning.floor,
            meaning.parts, first,
        )  # fmt: skip

    def objective(
        self, which: tuple[int, ...], some: tuple[str, ...], strength: float
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """H, b and the number of rows of the mean squared error over `which`, prior included."""
        meaning = self.whole.of(*some)
        at, products = self.whole.where(some), [self.products[p] for p in which]
        rows = sum(n for *_, n in products)
        H = np.sum([G[np.ix_(at, at)] for G, *_ in products], 0) / rows + meaning.prior(strength)
        b = np.sum([v[at] for _, v, _ in products], 0) / rows
        H[np.diag_indices(len(H))] += 1e-12 * np.trace(H) / len(H)
        return H, b, rows

    def tried(
        self, some: tuple[str, ...], strength: float, folds: tuple[Fold, ...] = ()
    ) -> _Choice:
        """Held-out errors of some parts with a prior of some strength, over `parts`' folds or others."""
        blocks, at = [], self.whole.where(some)
        for fold in folds or self.parts.folds:
            H, b, _ = self.objective(fold.train, some, strength)
            x, test = _minimum(H, b), np.isin(self.label, fold.test)
            predicted = np.maximum(self.A[np.ix_(test, at)] @ x, self.floor)
            blocks += block_errors(predicted - self.y[test])
        return _Choice(self, some, strength, np.array(blocks))

    def fitted(self, choice: _Choice) -> CompositionFit:
        """A choice, fitted to all the training parts."""
        _, some, strength, blocks = choice
        H, b, rows = self.objective(self.parts.all, some, strength)
        meaning = self.whole.of(*some)
        return CompositionFit(_minimum(H, b), meaning, H, b, rows, strength, blocks)


def _path(problem: Problem) -> list[_Choice]:
    """From the curve alone, part by part, each with the best of a few prior strengths."""
    path = [_best(problem, (CURVE,))]
    while left := [p for p in problem.whole.parts if p not in path[-1].parts]:
        now = path[-1]
        grown = [_best(problem, (*now.parts, part)) for part in left]
        better = min(grown, key=lambda c: c.blocks.mean())
        if as_good(now.blocks, better.blocks):
            break
        path.append(better)
    return path


def _best(problem: Problem, some: tuple[str, ...]) -> _Choice:
    """The strongest prior that is as good as the best one."""
    choices = [problem.tried(some, strength) for strength in STRENGTHS_OF_PRIOR]
    least = min(choices, key=lambda c: c.blocks.mean())
    return next(c for c in choices if as_good(c.blocks, least.blocks))


def relaxation_times(record: Record) -> tuple[float, ...]:
    """Two a decade from the sampling step to twice the longest sequence; none without time.

    Where a sequence's first cycles do not count, only to a quarter of a cycle: what lasts longer cannot be
    told from what those cycles left behind.
    """
    if record.time is None:
        return ()
    sequences = [record.time[rows] for _, rows in record.sequences()]
    span = max(float(np.ptp(t)) for t in sequences)
    steps = np.concatenate([np.diff(t) for t in sequences])
    step = float(np.median(steps[steps > 0]))
    longest = 2 * span
    numbers = np.unique(record.cycle[record.mask & (record.cycle > 0)])
    if len(sequences) == 1 and len(numbers) and numbers[0] > 1:
        cycles = [np.ptp(record.time[record.cycle == n]) for n in numbers]
        longest = float(np.median(cycles)) / 4
    count = int(np.clip(1 + 2 * np.log10(longest / step), 5, 9))
    return tuple(float(tau) for tau in np.geomspace(step, longest, count))


def slack(record: Record) -> tuple[float, ...]:
    """The output at which a record lies on its floor for a twentieth of its rows or more, if it does."""
    y = record.output[record.mask]
    least = np.quantile(y, 0.01)
    down = y[y < least + SLACK * np.ptp(y)]
    return (float(np.median(down)),) if len(down) > 0.05 * len(y) else ()


def _minimum(
    H: np.ndarray, b: np.ndarray, start: Bool[np.ndarray, " n"] | None = None
) -> np.ndarray:
    """The minimum with all unknowns but the offset, the first, not negative."""
    free = np.zeros(len(b), bool)
    free[0] = True
    return nonnegative_least_squares(H, b, free, start)
