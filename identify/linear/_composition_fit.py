"""Fitting a composition: which parts, how strong a prior, then all unknowns at once, exactly."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from hysteresis import Record
from hysteresis.preisach import Initial
from hysteresis.records._change import change

from .._levels import AT_ONCE, ENOUGH_ROWS, HELD, MANY_ROWS, PRIOR_STRENGTHS
from ..records._clocks import (
    amplitudes_differ,
    longest_sequence,
    moves_evenly,
    rates_differ,
    relaxation_times,
    usual_speed,
)
from ..records._folds import (
    LEAST_GAIN,
    Fold,
    Parts,
    best_of,
    earned,
    held_out_errors,
    simplest,
    thinned,
)
from ..records._orientation import output_falls, slack
from ._composition import SHARP, SMOOTHING, CompositionUnknowns
from ._composition_parts import (
    CELLS,
    CURVE,
    DRIFTS,
    FRICTION,
    MAXWELL,
    PARTS,
    PLACE_STOPS,
    SPAN_STOPS,
    STOPS,
    STRENGTHS,
    TIME_DRIFT,
    Memory,
    memory_blocks,
    memory_of,
)
from ._cross_validation import (
    Choice,
    Equations,
    NormalEquations,
    averaged,
    jittered,
    joined,
    normal_equations_of,
    total,
)
from ._group_strengths import RIDGE
from ._linear_fit import LinearFit
from ._unknown_vectors import relative

Samples = Float[np.ndarray, " samples"]

STRENGTHS_OF_PRIOR = PRIOR_STRENGTHS[1:-1]
"""Prior strengths tried, the strongest first; of a weakest one that is chosen, weaker ones too."""

WEAKEST = 10 * RIDGE
"""The weakest of all: another one were the ridge."""

DRIFT_GAIN = 0.5
"""What must go for a drift that no cycles show, or weights of either sign: they explain anything a bit."""


def path_of(
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    initial: Initial,
    weights: Samples | None = None,
    keeps_drift: bool = False,
) -> "list[Tried]":
    """Compositions from a curve alone to the best one, each with one part more.

    Parts join one by one: each time the one that lowers the held-out error most, as long as it does so by
    more than the standard error of the difference, paired by blocks of rows. In the end a drift may explain
    how the fitted rows change in the course of a run: it gains where the model without it, as it was at
    their end, predicts held-out ones better. Then the input is mapped by half of the static curve if that
    gains as much as a part. All that is chosen on some thousand rows; `fitted` takes all of them.

    `weights` (samples,): of each row's error, by default the record's.
    `keeps_drift`: see `CompositionUnknowns`.
    """
    parts = parts.merged
    whole = unknowns_for(record, parts, initial)._replace(keeps_drift=keeps_drift)
    whole, memory = _begun(whole, record, parts, leadings, weights)
    paths, floors = [], (None, *slack(record))
    for leading in leadings:
        each = (whole._replace(leading=leading, floor=floor) for floor in floors)
        problems = (Problem(record, parts, one, memory, weights) for one in each)
        # Below a floor above which no row is fitted, the prior alone would speak.
        free, *floored = (_path(one) for one in problems if one.total(parts.fitted).rows)
        # Friction, too, keeps an output on a level for long.
        paths += [free, *(path for path in floored if earned(free[-1].blocks, path[-1].blocks))]
    path = min(paths, key=lambda path: path[-1].blocks.mean())
    if len(path) > 1:  # a curve behind a curve is a curve
        mapped = best_prior(path[0].problem.mapped(path[0], path[-1].parts), path[-1].parts)
        plain = path[-1].blocks
        if earned(plain, mapped.blocks):
            honest = _unseen(path[0], mapped)
            path += [honest] if earned(plain, honest.blocks) else []
    return path


def _unseen(static: "Tried", mapped: "Tried") -> "Tried":
    """A choice behind a mapped input with the errors of maps that have not seen the rows held out."""
    blocks = [
        static.problem.mapped(static, mapped.parts, fold.train)
        .tried(mapped.parts, mapped.strength, (fold,))
        .blocks
        for fold in static.problem.parts.folds
    ]
    return replace(mapped, blocks=np.concatenate(blocks))


def _begun(
    whole: CompositionUnknowns,
    record: Record,
    parts: Parts,
    leadings: tuple[bool, ...],
    weights: Samples | None,
) -> tuple[CompositionUnknowns, Memory]:
    """With the branches relaxed where the record starts, or at its lowest input and stretched at once from
    there: whichever all parts together predict held-out rows better with. Also the memory at their rows."""
    rows = fitted_rows(parts)
    apart = whole.times and whole.rest - whole.low > HELD * (whole.high - whole.low)
    ways = [whole._replace(relaxed=relaxed) for relaxed in ((True, False) if apart else (False,))]
    begun = [(way, memory_of(way.memory(), record, rows)) for way in ways]
    some = tuple(part for part in whole.parts if part not in DRIFTS)

    def error(way: CompositionUnknowns, memory: Memory) -> float:
        each = (way.of(*some)._replace(leading=leading) for leading in leadings)
        problems = (Problem(record, parts, one, memory, weights) for one in each)
        return min(one.tried(some, STRENGTHS_OF_PRIOR[0]).blocks.mean() for one in problems)

    return min(begun, key=lambda one: error(*one)) if apart else begun[0]


def fitted(path: "list[Tried]") -> tuple[LinearFit[CompositionUnknowns], ...]:
    """The choices of a path, each with one part more, fitted to all rows of all the training parts."""
    last = {id(choice.problem): choice for choice in path}
    finals = {key: choice.problem.final(choice.parts) for key, choice in last.items()}
    return tuple(
        choice.problem.fitted(choice, finals[id(choice.problem)], last[id(choice.problem)].parts)
        for choice in path
    )


def unknowns_for(
    record: Record, parts: Parts, initial: Initial, some: tuple[str, ...] = PARTS
) -> CompositionUnknowns:
    """All unknowns that a record may have of these parts, of a composition that lags."""
    counted = parts.label >= 0
    u, y = record.input[counted], record.output[counted]
    times = relaxation_times(record, np.isin(parts.label, parts.fitted))
    speed, step = usual_speed(record)
    duration = longest_sequence(record)
    # At one amplitude the place and the history go together: what either does, another one would tell. At
    # one rate, too, the speed follows from the place and the direction.
    several = amplitudes_differ(record)
    told = {
        MAXWELL: bool(times), STRENGTHS: bool(times), TIME_DRIFT: duration > 0,
        PLACE_STOPS: several, SPAN_STOPS: several,
        FRICTION: speed > 0 and (several or rates_differ(record)),
    }  # fmt: skip
    some = tuple(p for p in some if told.get(p, True))
    return CompositionUnknowns(
        some, float(u.min()), float(u.max()), float(np.ptp(y)) * (-1 if output_falls(record) else 1),
        times, False, initial, rest=float(np.median(record.input[record.starts])), speed=speed, step=step,
        duration=duration, smoothing=SHARP if moves_evenly(record, speed * step) else SMOOTHING,
        centre=float(y.mean()),
    )  # fmt: skip


def fitted_rows(parts: Parts) -> Int[np.ndarray, " rows"]:
    """The rows on which a composition is chosen."""
    return thinned(np.flatnonzero(parts.label >= 0), ENOUGH_ROWS)


class Problem:
    """The columns of every part at the rows it is chosen on, and their products over parts of the record.

    - `whole`: all unknowns there are. `memory`: at `rows`; other orientations and floors have the same.
    - `inside`: unknowns that were not zero when last solved for, where the next solution begins.
    - `weights`: of every row's error, by default the record's.
    """

    def __init__(
        self,
        record: Record,
        parts: Parts,
        whole: CompositionUnknowns,
        memory: Memory | None = None,
        weights: Samples | None = None,
    ) -> None:
        self.weights = record.weights if weights is None else weights
        self.record, self.parts, self.rows = record, parts, fitted_rows(parts)
        if memory is None:
            memory = memory_of(whole.memory(), record, self.rows)
        self.memory, self.several = memory, len(record.labels) > 1
        self.label = parts.label[self.rows]
        whole = whole._replace(unseen=float(memory.path.min()))
        whole = whole._replace(reached=self._reached(parts.fitted, whole))
        self.whole, self.floor = whole, whole.least
        self.y = relative(whole, record.output[self.rows])
        self.A = whole.columns(memory)
        self.taut = self._taut(self.y)
        of_part = {p: (self.label == p) & self.taut for p in parts.all}
        self.normal = normal_equations_of(*self.weighed(self.A, self.y, self.rows), of_part)
        self.inside = np.ones(whole.count, bool)
        self.sums: dict[tuple[int, ...], NormalEquations] = {}

    @property
    def hats(self) -> Float[np.ndarray, "rows knots"]:
        """Of the knots of a condition, at each row; 1 without one."""
        return np.ones((len(self.rows), 1))

    def _reached(self, which: tuple[int, ...], whole: CompositionUnknowns) -> tuple[float, float]:
        """Path and time at which what drifts in these parts stopped: the end, of several runs a middle."""
        rows = np.isin(self.label, which)
        end = np.median if self.several and not whole.keeps_drift else np.max
        return float(end(self.memory.path[rows])), float(end(self.memory.elapsed[rows]))

    def weighed(self, A: np.ndarray, y: np.ndarray, rows: np.ndarray) -> Equations:
        """The equations of these rows of the record, each times its weight."""
        w = self.weights[rows]
        return A * w[:, None], y * w

    def _taut(self, y: Float[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
        """Rows above the floor: below, an output tells only a limit."""
        return y > self.floor + HELD

    def mapped(
        self, choice: "Tried", some: tuple[str, ...], which: tuple[int, ...] | None = None
    ) -> "Problem":
        """The same, its input half mapped by the static curve of a choice, which keeps its range; the curve
        is fitted to the parts `which`, all by default."""
        unknowns = self.solution(which or self.parts.fitted, choice.parts, choice.strength)
        meaning, increments = self.whole, unknowns[1 : 1 + CELLS[CURVE]]
        even = np.full(CELLS[CURVE], 1 / CELLS[CURVE])
        half = (even + increments / max(increments.sum(), 1e-12)) / 2
        first = tuple(((meaning.high - meaning.low) * half / half.sum()).tolist())
        mapped = meaning.of(*some)._replace(first=first)
        return Problem(self.record, self.parts, mapped, weights=self.weights)

    def total(self, which: tuple[int, ...]) -> NormalEquations:
        """The normal equations over `which`, of all unknowns."""
        if which not in self.sums:
            self.sums[which] = total(self.normal[p] for p in which)
        return self.sums[which]

    def objective(
        self, which: tuple[int, ...], some: tuple[str, ...], strength: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """H and b of the mean squared error over `which`, prior included."""
        return self._regular(self.total(which), self.whole.where(some), some, strength)

    def _regular(
        self,
        normal: NormalEquations,
        columns: Int[np.ndarray, " some"],
        some: tuple[str, ...],
        strength: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        # A floor may leave no row of a fold above it: then the prior alone speaks.
        rows = max(normal.rows, 1)
        H = normal.H[np.ix_(columns, columns)] / rows + self.whole.of(*some).prior(strength)
        return jittered(H), normal.b[columns] / rows

    def solution(
        self, which: tuple[int, ...], some: tuple[str, ...], strength: float
    ) -> Float[np.ndarray, " unknowns"]:
        """The unknowns at the minimum over `which`."""
        columns = self.whole.where(some)
        meaning = self.whole.of(*some)
        x = meaning.minimum(*self.objective(which, some, strength), self.inside[columns])
        self.inside[columns] = x != 0
        return x

    def tried(
        self, some: tuple[str, ...], strength: float, folds: tuple[Fold, ...] = ()
    ) -> "Tried":
        """Held-out errors of some parts with a prior of some strength, over `parts`' folds or others."""
        blocks = self.held_out(lambda train: self.solution(train, some, strength), some, folds)
        return Choice(self, strength, blocks, some)

    def held_out(
        self,
        solution: Callable[[tuple[int, ...]], np.ndarray],
        some: tuple[str, ...],
        folds: tuple[Fold, ...] = (),
    ) -> Float[np.ndarray, " blocks"]:
        """Held-out errors of the unknowns that `solution` gives for the other parts of a fold."""

        def error(solved: Solved, which: tuple[int, ...]) -> np.ndarray:
            test = np.isin(self.label, which)
            error = self.predicted(solved, some, test) - self.y[test]
            return error * self.weights[self.rows][test]

        folds = folds or self.parts.folds
        return held_out_errors(folds, lambda train: (train, solution(train)), error)

    def predicted(
        self, solved: "Solved", some: tuple[str, ...], rows: Bool[np.ndarray, " rows"]
    ) -> Float[np.ndarray, " some"]:
        """The output of a solution at some rows as the model predicts them that is made of it."""
        train, x = solved
        columns, used = self.whole.where(some), x != 0
        outputs = self.A[np.ix_(rows, columns[used])] @ x[used]
        if any(part in DRIFTS for part in some):
            drifts = self.whole.of(*(part for part in some if part in DRIFTS))
            own = np.isin(columns, self.whole.where(drifts.parts)[1:])
            memory = self.memory.at(np.flatnonzero(rows))
            stopped = drifts.stopped(memory, self._reached(train, drifts))
            moved = drifts.columns(stopped) - drifts.columns(memory)
            outputs += moved[:, 1:] @ x[own]
        return np.maximum(outputs, self.floor)

    def final(self, some: tuple[str, ...]) -> NormalEquations:
        """The normal equations of all rows of the training parts, of the unknowns of some parts.

        They are summed in blocks. Of very many rows, the equations of so many neighbours are averaged, with
        their number as the weight, that `MANY_ROWS` are left.
        """
        counted = np.flatnonzero(self.parts.label >= 0)
        meaning = self.whole.of(*some)
        if len(counted) == len(self.rows):
            columns, normal = self.whole.where(some), self.total(self.parts.fitted)
            return normal._replace(H=normal.H[np.ix_(columns, columns)], b=normal.b[columns])
        counted = np.flatnonzero(np.isin(self.parts.label, self.parts.fitted))
        together = -(-len(counted) // MANY_ROWS)
        at_once = together * max(1, AT_ONCE // together)
        H, b, rows = np.zeros((meaning.count,) * 2), np.zeros(meaning.count), 0
        for here, memory in memory_blocks(meaning.memory(), self.record, counted):
            y = relative(meaning, self.record.output[here])
            taut = np.flatnonzero(self._taut(y))
            if not len(taut):
                continue
            memory, y = (memory.at(taut), y[taut]) if len(taut) < len(here) else (memory, y)
            parts = [
                averaged(
                    *self.weighed(meaning.columns(some), y[place], here[taut][place]), together
                )
                for place, some in memory.cut(at_once)
            ]
            # Of averages all of a block make one product, because H is larger than they are.
            for A, right in [joined(parts)] if together > 1 else parts:
                H += A.T @ A
                b += A.T @ right
            rows += len(taut)
        return NormalEquations(H, b, float("nan"), rows)

    def fitted(
        self,
        choice: "Tried",
        normal: NormalEquations | None = None,
        of: tuple[str, ...] | None = None,
    ) -> LinearFit[CompositionUnknowns]:
        """A choice, fitted to all the training parts; `normal`: the `final` equations of the parts `of`."""
        meaning = self.whole.of(*choice.parts)
        if normal is None or of is None:
            normal, of = self.total(self.parts.fitted), self.whole.parts
        columns = self.whole.of(*of).where(choice.parts)
        H, b = self._regular(normal, columns, choice.parts, choice.strength)
        inside = self.inside[self.whole.where(choice.parts)]
        return LinearFit(
            meaning.minimum(H, b, inside),
            meaning,
            H,
            b,
            normal.rows,
            choice.strength,
            choice.blocks,
        )


Tried: TypeAlias = Choice[Problem]
Solved: TypeAlias = tuple[tuple[int, ...], Float[np.ndarray, " unknowns"]]
"""The parts that were fitted, and the unknowns."""


def _path(problem: Problem) -> list[Tried]:
    """From the curve alone, part by part, and in the end a drift, by which the rows are explained.

    Parts that joined before it may have stood for what drifts, so they are chosen anew beside it.
    """
    path = _grown([best_prior(problem, (CURVE,))])
    if not (drifts := [part for part in DRIFTS if part in problem.whole.parts]):
        return path
    drifting = simplest([best_prior(problem, (*path[-1].parts, part)) for part in drifts])
    shown = (found := change(problem.record)) is not None and found.is_sure
    if not earned(path[-1].blocks, drifting.blocks, LEAST_GAIN if shown else DRIFT_GAIN):
        return path
    again = _grown([path[0], best_prior(problem, (CURVE, drifting.parts[-1]))])
    return again if earned(drifting.blocks, again[-1].blocks) else [*path, drifting]


def _grown(path: list[Tried]) -> list[Tried]:
    """A path with further parts, one by one, each with the best of a few prior strengths.

    The parts that gained most before are tried first. A part's gain seldom grows as others join, so one
    that gained less than half of the best so far is not tried again in this step, unless none gains enough.
    Plain stops are taken where they are as good as those that change with place or span.
    """
    problem = path[-1].problem
    there = {*path[-1].parts, *DRIFTS}
    gains = dict.fromkeys((p for p in problem.whole.parts if p not in there), np.inf)
    while gains:
        before = path[-1]
        found: list[Tried] = []
        for part in sorted(gains, key=lambda part: -gains[part]):
            if found and 2 * gains[part] < _gain(before, best_of(found)):
                break
            one = best_prior(problem, (*before.parts, part))
            gains[part] = _gain(before, one)
            if earned(before.blocks, one.blocks):
                found.append(one)
        if not found:
            break
        joined = best_of(found)
        if joined.parts[-1] in (PLACE_STOPS, SPAN_STOPS):
            joined = simplest([*(one for one in found if one.parts[-1] == STOPS), joined])
        path = [*path, joined]
        del gains[joined.parts[-1]]
    return path


def _gain(before: Tried, after: Tried) -> float:
    """By which part of the mean squared held-out error a choice is better than the one before."""
    return float(1 - after.blocks.mean() / before.blocks.mean())


def best_prior(problem: Problem, some: tuple[str, ...]) -> Tried:
    """The strongest prior that is as good as the best; where it is the weakest tried, weaker ones too."""
    # Not behind a mapped input, whose curve has seen the held-out rows.
    choices = [problem.tried(some, strength) for strength in STRENGTHS_OF_PRIOR]
    last = STRENGTHS_OF_PRIOR[-1] if problem.whole.first else WEAKEST
    while (found := simplest(choices)) is choices[-1] and found.strength > 2 * last:
        choices.append(problem.tried(some, found.strength / 10))
    return found
