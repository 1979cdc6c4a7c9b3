"""Fitting a composition: which parts, how strong a prior, then all unknowns at once, exactly."""

from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float

from hysteresis import Record
from hysteresis.preisach import Initial

from ..records._clocks import least_at, shifted
from ..records._folds import Fold, Parts, as_good, best_of, held_out_errors, simplest
from ..records._folds import parts as parts_of
from ..records._orientation import output_falls
from ._composition import CELLS, CURVE, FRICTION, MAXWELL, PARTS, STRENGTHS, CompositionUnknowns
from ._cross_validation import ROWS, Choice, jittered, normal_equations_of, thinned, total
from ._cross_validation import STRENGTHS as PRIOR_STRENGTHS
from ._linear_fit import LinearFit

STRENGTHS_OF_PRIOR = PRIOR_STRENGTHS[1:4]
"""Prior strengths tried, the strongest first."""

LEAST_GAIN = 0.05
"""Share of the mean squared held-out error that a further part must take away."""

LAG_ROWS = 10_000
"""Rows that are enough to find a lag with."""

LAG_PRIOR = 1e-5
"""Prior strength with which a lag is looked for."""

WORTH = 0.2
"""Share of the mean squared error that a lag must remove before the fit takes it into account."""

SLACK = 0.02
"""Part of the output's range within which it lies on its floor."""


def fit_compositions(
    record: Record, parts: Parts, leadings: tuple[bool, ...], initial: Initial = "negative"
) -> tuple[LinearFit[CompositionUnknowns], ...]:
    """Compositions from a curve alone to the best one, each with one part more.

    Parts join one by one: each time the one that lowers the held-out error most, as long as it does so
    by more than the standard error of the difference, paired by blocks of rows. In the end the input is
    mapped by half of the static curve if that gains as much.
    """
    parts, paths = parts.merged, []
    for leading in leadings:
        for floor in (None, *slack(record)):
            paths.append(_path(Problem(record, parts, leading, initial, floor)))
    path = min(paths, key=lambda path: path[-1].blocks.mean())
    if len(path) > 1:  # a curve behind a curve is a curve
        mapped = _best(path[0].problem.mapped(path[0]), path[-1].parts)
        if not as_good(path[-1].blocks, mapped.blocks):
            path.append(mapped)
    return tuple(choice.problem.fitted(choice) for choice in path)


class Lagging(NamedTuple):
    """Compositions fitted to an input that a lag between the clocks has moved.

    - `record`: with the moved input. `lag`, `error`: the lag and its standard error.
    """

    path: tuple[LinearFit[CompositionUnknowns], ...]
    record: Record
    lag: float
    error: float


def fit_lagging(
    path: tuple[LinearFit[CompositionUnknowns], ...],
    record: Record,
    parts: Parts,
    initial: Initial,
) -> Lagging | None:
    """Compositions with the lag between the clocks taken out; None where `path`, without it, is as good.

    The lag has to take away a fifth of the squared error, of held-out rows too, and by more than twice the
    standard error of that gain: relaxation looks much like a lag.
    """
    found = find_lag(record, path[-1].meaning.floor)
    if found.gain <= WORTH:
        return None
    moved = shifted(record, found.lag)
    again = fit_compositions(moved, parts, (found.leading,), initial)
    gain = path[-1].blocks - again[-1].blocks
    least = max(2 * np.std(gain) / np.sqrt(len(gain)), WORTH * path[-1].blocks.mean())
    return Lagging(again, moved, found.lag, found.error) if gain.mean() > least else None


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
    cut, some = parts_of(few).merged, (CURVE, MAXWELL, STRENGTHS)
    found = []
    for leading in (False, True):

        def objective(lag: float, leading: bool = leading) -> float:
            problem = Problem(shifted(few, lag), cut, leading, "negative", floor, some)
            residuals = problem.A @ problem.solution(cut.all, some, LAG_PRIOR) - problem.y
            return float(np.mean(residuals[problem.taut] ** 2))

        lag, curvature = least_at(objective, step, 16 * step)
        found.append((objective(lag), lag, curvature, leading, objective(0.0)))
    least, lag, curvature, leading, _ = min(found)
    facts = min(ROWS, int(few.mask.sum()))
    error = float(np.sqrt(2 * least / max(curvature, 1e-300) / facts))
    return Lag(lag, error, leading, 1 - least / min(without for *_, without in found))


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
        rows = thinned(counted)
        u, y = record.input[counted], record.output[counted]
        scale = float(np.ptp(y)) * (-1 if output_falls(record) else 1)
        times = relaxation_times(record)
        speed, step = usual_speed(record)
        some = tuple(p for p in some if times or p not in (MAXWELL, STRENGTHS))
        some = tuple(p for p in some if speed > 0 or p != FRICTION)
        low, high = float(u.min()), float(u.max())
        self.record, self.parts, self.rows = record, parts, rows
        self.whole = CompositionUnknowns(
            some,
            low,
            high,
            scale,
            times,
            leading,
            initial,
            floor,
            first,
            float(np.median(record.input[record.starts])),
            speed,
            step,
        )
        self.floor = -np.inf if floor is None else floor / abs(scale)
        self.label, self.y = parts.label[rows], record.output[rows] / scale
        self.A = self.whole.columns(record, rows)
        self.taut = self.y > self.floor + (
            0 if floor is None else SLACK
        )  # below, y tells only a limit
        of_part = {p: (self.label == p) & self.taut for p in parts.all}
        self.normal = normal_equations_of(self.A, self.y, of_part)

    def mapped(self, choice: "Tried") -> "Problem":
        """The same, its input half mapped by the static curve of a choice, which keeps its range.

        One curve, of all training rows, serves for every fold: 40 smooth increments tell little of them.
        """
        meaning, increments = self.whole, self.fitted(choice).unknowns[1 : 1 + CELLS[CURVE]]
        even = np.full(CELLS[CURVE], 1 / CELLS[CURVE])
        half = (even + increments / max(increments.sum(), 1e-12)) / 2
        first = tuple((meaning.high - meaning.low) * half / half.sum())
        return Problem(
            self.record, self.parts, meaning.leading, meaning.initial, meaning.floor,
            meaning.parts, first,
        )  # fmt: skip

    def objective(
        self, which: tuple[int, ...], some: tuple[str, ...], strength: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """H and b of the mean squared error over `which`, prior included."""
        columns = self.whole.where(some)
        H, b = total(self.normal[p] for p in which).means
        prior = self.whole.of(*some).prior(strength)
        return jittered(H[np.ix_(columns, columns)] + prior), b[columns]

    def solution(
        self, which: tuple[int, ...], some: tuple[str, ...], strength: float
    ) -> Float[np.ndarray, " unknowns"]:
        """The unknowns at the minimum over `which`."""
        return self.whole.minimum(*self.objective(which, some, strength))

    def tried(
        self, some: tuple[str, ...], strength: float, folds: tuple[Fold, ...] = ()
    ) -> "Tried":
        """Held-out errors of some parts with a prior of some strength, over `parts`' folds or others."""
        columns = self.whole.where(some)

        def error(x: np.ndarray, which: tuple[int, ...]) -> np.ndarray:
            test = np.isin(self.label, which)
            return np.maximum(self.A[np.ix_(test, columns)] @ x, self.floor) - self.y[test]

        blocks = held_out_errors(
            folds or self.parts.folds, lambda train: self.solution(train, some, strength), error
        )
        return Choice(self, strength, blocks, some)

    def fitted(self, choice: "Tried") -> LinearFit[CompositionUnknowns]:
        """A choice, fitted to all the training parts."""
        H, b = self.objective(self.parts.all, choice.parts, choice.strength)
        meaning, rows = self.whole.of(*choice.parts), total(self.normal.values()).rows
        return LinearFit(meaning.minimum(H, b), meaning, H, b, rows, choice.strength, choice.blocks)


Tried: TypeAlias = Choice[Problem]


def _path(problem: Problem) -> list[Tried]:
    """From the curve alone, part by part, each with the best of a few prior strengths.

    The parts that gained most before are tried first. A part's gain hardly grows as others join, so one
    that gained less than half of the best so far is not tried again in this step.
    """
    path = [_best(problem, (CURVE,))]
    gains = dict.fromkeys((p for p in problem.whole.parts if p != CURVE), np.inf)
    while gains:
        before = path[-1]
        found: list[Tried] = []
        for part in sorted(gains, key=lambda part: -gains[part]):
            if found and 2 * gains[part] < _gain(before, best_of(found)):
                break
            found.append(_best(problem, (*before.parts, part)))
            gains[part] = _gain(before, found[-1])
        better = best_of(found)
        if _gain(before, better) < LEAST_GAIN or as_good(before.blocks, better.blocks):
            break
        path.append(better)
        del gains[better.parts[-1]]
    return path


def _gain(before: Tried, after: Tried) -> float:
    """By which part of the mean squared held-out error a choice is better than the one before."""
    return float(1 - after.blocks.mean() / before.blocks.mean())


def _best(problem: Problem, some: tuple[str, ...]) -> Tried:
    """The strongest prior that is as good as the best one."""
    choices = [problem.tried(some, strength) for strength in STRENGTHS_OF_PRIOR]
    return simplest(choices)


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


def usual_speed(record: Record) -> tuple[float, float]:
    """The speed of the input that a quarter of the samples exceed, and the sampling step; else 0."""
    if record.time is None:
        return 0.0, 0.0
    dt, du = (
        np.concatenate([np.diff(x[rows]) for _, rows in record.sequences()])
        for x in (record.time, record.input)
    )
    moved = dt > 0
    if not moved.any():
        return 0.0, 0.0
    speed = float(np.quantile(np.abs(du[moved] / dt[moved]), 0.75))
    return speed, float(np.median(dt[moved]))


def slack(record: Record) -> tuple[float, ...]:
    """The output at which a record lies on its floor for a twentieth of its rows or more, if it does.

    That of a falling output's negative is its ceiling.
    """
    y = record.output[record.mask] * (-1 if output_falls(record) else 1)
    least = np.quantile(y, 0.01)
    down = y[y < least + SLACK * np.ptp(y)]
    return (float(np.median(down)),) if len(down) > 0.05 * len(y) else ()
