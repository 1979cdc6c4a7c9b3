"""A constant lag between two clocks, told from hysteresis: compositions predict better without it."""

import functools
import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from hysteresis import Note, Record
from hysteresis.preisach import Initial

from .._levels import ENOUGH_ROWS, PRIOR_STRENGTHS, WORTH
from ..records._clocks import least_at, shifted
from ..records._folds import Parts
from ..records._folds import parts as parts_of
from ._composition_fit import Problem, Tried, best_prior, fitted_rows, path_of, unknowns_for
from ._composition_parts import CURVE, MAXWELL, RELAYS, STRENGTHS, Memory, memory_of

MEMORIES = ((CURVE, MAXWELL, STRENGTHS), (CURVE, RELAYS))
"""What a lag is found with: a curve with relaxing branches, and one with relays."""


STRETCH = Note("rows", "Rows with which a lag is looked for.")


def fit_lagging(
    path: list[Tried], record: Record, parts: Parts, initial: Initial
) -> "tuple[list[Tried], Record, Lag] | None":
    """Compositions fitted to the record with the lag between the clocks taken out, and both; None where
    `path`, without it, is as good.

    The lag has to take away a fifth of the squared error, of held-out rows too, and the logarithms of the
    blocks' errors have to fall by more than twice the standard error of that. Parts are chosen anew only
    where those found without it, and those it was found with, are better with it.
    """
    best = next(choice for choice in reversed(path) if not choice.problem.whole.first)
    found = find_lag(record, best.problem.whole.floor)
    if found is None:
        return None
    moved, merged = shifted(record, found.lag), parts.merged
    whole = unknowns_for(moved, merged, initial)._replace(relaxed=best.problem.whole.relaxed)
    some = tuple(p for p in whole.parts if p in {*best.parts, *found.parts})
    whole = whole.of(*some)._replace(leading=found.leading, floor=best.problem.floor)
    tried = best_prior(Problem(moved, merged, whole), some)
    if tried.blocks.mean() >= best.blocks.mean():
        return None
    keeps = best.problem.whole.keeps_drift
    again = path_of(moved, parts, (found.leading,), initial, keeps_drift=keeps)
    without, within = path[-1].blocks, again[-1].blocks
    fall = np.log(without / within)
    worth = within.mean() < (1 - WORTH) * without.mean()
    sure = fall.mean() > 2 * np.std(fall) / np.sqrt(len(fall))
    return (again, moved, found) if worth and sure else None


class Lag(NamedTuple):
    """How long the output lags the input, its standard error; `parts`: the memory that it was found with,
    and how its loops go without it."""

    lag: float
    error: float
    parts: tuple[str, ...]
    leading: bool


def find_lag(record: Record, floor: float | None = None) -> Lag | None:
    """The lag with which a curve and a memory fit best: relaxing branches or relays of either orientation.

    u(t - lag) drives them; what is minimised over the lag, up to 16 sampling steps, is the mean squared
    error at its minimum in all unknowns. With n rows its logarithm has the curvature 2 / (n error^2)
    there. A part of the sequences, and of a long one its end, serves where there are many rows.

    Hysteresis looks like a lag to a model of another one: sliders to branches, and relaxation to relays. So
    a lag has to be more than twice its error and less than the largest one, and has to take away a fifth of
    the error with one memory and not add a fifth with the other, at whole steps, because an input between
    two samples has less noise than either. Of several, the one that takes away most with both is taken.
    """
    few, thin = _stretch(record)
    assert few.time is not None
    step = float(np.median(np.diff(few.time)))
    still = _every(few, thin)
    cut = parts_of(still).merged
    rows = fitted_rows(cut)
    every = tuple(dict.fromkeys(itertools.chain(*MEMORIES)))
    whole = unknowns_for(still, cut, "negative", every)._replace(floor=floor)

    @functools.cache
    def moved(lag: float) -> tuple[Record, Memory]:
        there = _every(shifted(few, lag), thin)
        return there, memory_of(whole.memory(), there, rows)

    inside: dict[tuple[tuple[str, ...], bool], Bool[np.ndarray, " unknowns"]] = {}

    @functools.cache
    def error(some: tuple[str, ...], leading: bool, lag: float) -> float:
        there, memory = moved(lag)
        problem = Problem(there, cut, whole.of(*some)._replace(leading=leading), memory)
        problem.inside = inside.get((some, leading), problem.inside)
        residuals = problem.A @ problem.solution(cut.all, some, PRIOR_STRENGTHS[-1]) - problem.y
        residuals *= problem.weights[rows]
        inside[some, leading] = problem.inside
        return float(np.mean(residuals[problem.taut] ** 2))

    def least(lag: float, some: tuple[str, ...]) -> float:
        return min(error(some, way, lag) for way in (False, True))

    found = {}
    for some, leading in itertools.product(MEMORIES, (False, True)):
        at = functools.partial(error, some, leading)
        count, before = 0, None
        while count != before and abs(count) <= 16:
            before = count
            count = min((before, before - 1, before + 1), key=lambda k: at(k * step))
        lefts = [least(count * step, one) / max(least(0.0, one), 1e-300) for one in MEMORIES]
        if count != before or min(lefts) >= 1 - WORTH or max(lefts) >= 1 + WORTH:
            continue
        lag, curvature = least_at(at, count * step, step)
        if not curvature:
            continue
        facts = min(ENOUGH_ROWS, int(few.mask.sum()))
        deviation = float(np.sqrt(2 * at(lag) / curvature / facts))
        if abs(lag) > 2 * deviation:
            found[Lag(lag, deviation, some, leading)] = np.prod(lefts)
    return min(found, key=lambda one: found[one], default=None)


def _stretch(record: Record) -> tuple[Record, int]:
    """Some sequences, of a long one its end, and every how many rows of it hold four cycles or more.

    What a cut sequence remembers from before is not known, so the first quarter of it does not count.
    """
    labels = record.labels
    few = record.take_sequences(labels[:: max(1, min(len(labels), len(record) // ENOUGH_ROWS))])
    cycles = max(1, int((np.diff(few.cycle, prepend=0) != 0).sum()))
    thin = max(1, 4 * len(few) // (cycles * ENOUGH_ROWS))
    rows, mask = [], few.mask.copy()
    for _, here in few.sequences():
        used = np.flatnonzero(mask[here])
        end = here.start + int(used[-1]) + 1 if len(used) else here.stop
        begin = max(here.start, end - thin * ENOUGH_ROWS)
        if begin > here.start:
            mask[begin : begin + (end - begin) // 4] = False
            rows.append(np.arange(begin, end))
        else:
            rows.append(np.arange(here.start, here.stop))
    return replace(few, mask=mask)._in_order(np.concatenate(rows), STRETCH), thin


def _every(record: Record, thin: int) -> Record:
    """Every so many rows of each sequence."""
    if thin == 1:
        return record
    rows = [np.arange(s.start, s.stop, thin) for _, s in record.sequences()]
    return record._in_order(np.concatenate(rows), STRETCH)
