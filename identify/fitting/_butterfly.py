"""Butterfly loops: an output that is nearly even in a hysteretic state, unfolded into that state.

Strain over magnetic or electric field has a valley on each branch, where magnetisation or polarisation goes
through zero. Behind the valley the state has the other sign, which the branch tells: so the root of the
height over the valley, with that sign, is an output that rises with the input, and a composition fits it.
The composition in turn tells the sign where a branch has no valley, or several by noise: with its signs one
is fitted again, as long as it predicts held-out outputs better.
"""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import InputError, Record, Series
from hysteresis._format import quantity
from hysteresis.curves import PolynomialCurve
from hysteresis.preisach import Initial
from hysteresis.records._cycles import default_dead_band, turning_points

from .._levels import PART
from ..linear._composition import CompositionUnknowns
from ..linear._composition_fit import Tried, fitted, path_of
from ..linear._linear_fit import LinearFit
from ..records._folds import Parts, held_out_errors
from ..records._new_record import predict
from ..records._orientation import orientations
from ..results._detail import FoldedState, folded
from ..results._fit_result import FitResult, Parameter
from ..results._goodness_of_fit import evidence
from ._linear import state_of
from ._training_data import Candidate, Options, TrainingData, Trial

SHARE = 0.5
"""Of the ways of the input that have a valley on them."""

LONG = 0.5
"""Ways shorter than this part of the longest one may lie on one side of the valley."""

FOLD = 0.5
"""State up to which rows next to the fold count as little as there."""

DEGREE = 2
"""Of the polynomial that folds the state again: nearly even, with sides that may differ."""


class Unfolded(NamedTuple):
    """An output that was unfolded.

    - `state`: of every row, -1 to 1 where it counts. `level`: the output at the fold.
    - `peak`: whether the fold is a peak instead of a valley.
    """

    state: Float[np.ndarray, " samples"]
    level: float
    peak: bool


class _Way(NamedTuple):
    """Counted rows between two reversals of the input, the lowest of them, and whether it is a valley."""

    rows: np.ndarray
    lowest: int
    length: float
    rises: bool
    valley: bool


class _Folded(NamedTuple):
    """A composition of the state, what it gives for each row, its fold, and its held-out errors."""

    linear: LinearFit[CompositionUnknowns]
    inner: Float[np.ndarray, " samples"]
    curve: PolynomialCurve
    blocks: Float[np.ndarray, " blocks"]


class ButterflyCandidate(Candidate):
    """A composition behind a fold; `"auto"` tries it where most branches have a valley or a peak."""

    def suits(self, data: TrainingData, purpose: str) -> bool:
        return data.condition is None and unfolded(data.record) is not None

    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        """Raises `InputError` `nothing-fits` where the output has no valley or peak on most ways of the
        input, see `unfolded`."""
        record, parts = data.record, data.parts
        state = unfolded(record)
        if state is None or data.condition is not None:
            raise InputError(
                "nothing-fits",
                "the output has no valley or peak on most ways of the input from one reversal to the next."
                if state is None
                else "a butterfly that depends on a condition is not fitted.",
                fix="fit --model auto.",
            )
        composed = partial(_composed, record, parts, state_of(options.initial))
        signed = state.state
        found = composed(signed)
        while np.any((own := np.copysign(signed, found.inner)) != signed):
            again = composed(own)
            if again.blocks.mean() >= found.blocks.mean():
                break
            found, signed = again, own
        linear, inner, curve, blocks = found
        judged = evidence(record, parts, folded(curve, inner), float(blocks.mean()))
        kind = "peak" if state.peak else "valley"
        note = (
            f"Each branch has a {kind} near {quantity(state.level, record.output_unit, 3)}: the output is"
            f" a curve of a state that changes its sign there, of {linear.meaning.name}. An output belongs"
            " to two states, so there is no inverse unless the side is known."
        )
        fit = FitResult(
            name=self.name,
            model=Series([linear.model, curve]),
            parameters=tuple(
                Parameter(f"output.c{k}", float(value), record.output_unit, None, "inseparable")
                for k, value in enumerate(np.asarray(curve.coefficients))
            ),
            covariance=np.zeros((0, 0)),
            **judged._asdict(),
            success=True,
            blocks=blocks,
            notes=(note,),
            detail=FoldedState(linear, curve),
            **data.shown,
        )
        return [Trial(fit)]


def _composed(
    record: Record, parts: Parts, initial: Initial, state: Float[np.ndarray, " samples"]
) -> _Folded:
    """A composition of these states, and the curve that folds what it gives."""
    open_loops = replace(record, output=state, output_unit="1", output_name="state")
    # An error of the output is so many times that of the state: the output says little at the fold.
    weights = np.maximum(np.abs(state), FOLD) * record.weights
    weights /= np.sqrt(np.mean(weights[record.mask] ** 2))
    choice = path_of(open_loops, parts, orientations(open_loops), initial, weights)[-1]
    linear = fitted([choice])[0]
    inner = linear.outputs(record)
    inner = predict(linear.model, record) if inner is None else inner
    used = np.isin(parts.label, parts.all)
    curve = folding(inner[used], record.output[used], record.weights[used])
    return _Folded(linear, inner, curve, held_out(choice, record))


def unfolded(record: Record) -> Unfolded | None:
    """The state behind butterfly loops; None where most ways of the input have no valley, nor a peak."""
    found = [
        (peak, _ways(record, -record.output if peak else record.output)) for peak in (False, True)
    ]
    peak, ways = max(found, key=lambda one: _share(one[1]))
    if _share(ways) < SHARE:
        return None
    y = -record.output if peak else record.output
    level = float(np.median([y[way.lowest] for way in ways if way.valley]))
    height = np.maximum(y - level, 0.0)
    signs = np.zeros(len(record))
    for before, way in pairwise([None, *ways]):
        assert way is not None
        side = 1.0 if way.rises else -1.0
        if way.valley:
            signs[way.rows] = np.where(way.rows < way.lowest, -side, side)
        elif before is not None and way.rows[0] > before.rows[-1] and signs[before.rows[-1]]:
            signs[way.rows] = signs[before.rows[-1]]
    # Before the first valley a state is on the side that the first valley is left for.
    for way, after in reversed(list(pairwise(ways))):
        if not signs[way.rows[0]]:
            signs[way.rows] = signs[after.rows[0]]
    state = signs * np.sqrt(height / height[record.mask].max())
    return Unfolded(state, -level if peak else level, peak)


def _ways(record: Record, y: Float[np.ndarray, " samples"]) -> list[_Way]:
    found: list[_Way] = []
    range_of_y = float(np.ptp(y[record.mask]))
    for _, here in record.sequences():
        u = record.input[here]
        ends = here.start + turning_points(u, default_dead_band(u))
        for begin, end in pairwise(ends.tolist()):
            last = end + (end == here.stop - 1)
            rows = begin + np.flatnonzero(record.mask[begin:last])
            if not len(rows):
                continue
            lowest = int(rows[np.argmin(y[rows])])
            sides = rows[rows <= lowest], rows[rows >= lowest]
            length = float(np.ptp(record.input[rows]))
            valley = all(
                np.max(y[side]) - y[lowest] > PART * range_of_y
                and np.ptp(record.input[side]) > PART * length
                for side in sides
            )
            rises = bool(record.input[end] > record.input[begin])
            found.append(_Way(rows, lowest, length, rises, valley))
    return found


def _share(ways: list[_Way]) -> float:
    longest = max((way.length for way in ways), default=0.0)
    long = [way for way in ways if way.length > LONG * longest]
    return sum(way.valley for way in long) / max(len(long), 1)


def folding(
    state: Float[np.ndarray, " rows"],
    output: Float[np.ndarray, " rows"],
    weights: Float[np.ndarray, " rows"],
) -> PolynomialCurve:
    """The polynomial from a predicted state to the output, straight on beyond the states of these rows."""
    low, high = float(state.min()), float(state.max())
    found = np.polynomial.Polynomial.fit(state, output, DEGREE, domain=[low, high], w=weights)
    return PolynomialCurve(found.coef, low, high)


def held_out(choice: Tried, record: Record) -> Float[np.ndarray, " blocks"]:
    """Mean squared errors of held-out outputs, of a composition chosen for their unfolded state."""
    problem = choice.problem
    y, w = (x[problem.rows] for x in (record.output, record.weights))
    every = np.ones(len(problem.rows), bool)

    def solve(train: tuple[int, ...]) -> Float[np.ndarray, " rows"]:
        solved = train, problem.solution(train, choice.parts, choice.strength)
        state = problem.predicted(solved, choice.parts, every)
        state = problem.whole.centre + problem.whole.scale * state
        seen = np.isin(problem.label, train)
        return folded(folding(state[seen], y[seen], w[seen]), state)

    def error(predicted: np.ndarray, test: tuple[int, ...]) -> np.ndarray:
        rows = np.isin(problem.label, test)
        return w[rows] * (predicted[rows] - y[rows])

    return held_out_errors(problem.parts.folds, solve, error)
