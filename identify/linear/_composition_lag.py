"""A constant lag between two clocks, told from relaxation: compositions predict better without it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from hysteresis import Record
from hysteresis.preisach import Initial

from ..records._clocks import least_at, shifted
from ..records._folds import Parts
from ..records._folds import parts as parts_of
from ._composition import CURVE, MAXWELL, STRENGTHS, CompositionUnknowns
from ._composition_fit import Problem, Tried, best_prior, fitted_rows, path_of, unknowns_for
from ._composition_memory import Memory, memory_of
from ._cross_validation import ROWS

LAG_ROWS = 10_000
"""Rows that are enough to find a lag with."""

LAG_PARTS = (CURVE, MAXWELL, STRENGTHS)
"""What a lag is found with: a curve and relaxing branches."""

LAG_PRIOR = 1e-5
"""Prior strength with which a lag is looked for."""

WORTH = 0.2
"""Share of the mean squared error that a lag must remove before the fit takes it into account."""


class Lagging(NamedTuple):
    """Compositions fitted to an input that a lag between the clocks has moved.

    - `record`: with the moved input. `lag`, `error`: the lag and its standard error.
    """

    path: list[Tried]
    record: Record
    lag: float
    error: float


def fit_lagging(
    path: list[Tried], record: Record, parts: Parts, initial: Initial
) -> Lagging | None:
    """Compositions with the lag between the clocks taken out; None where `path`, without it, is as good.

    The lag has to take away a fifth of the squared error, of held-out rows too, and the logarithms of the
    blocks' errors have to fall by more than twice the standard error of that: relaxation looks much like a
    lag. Parts are chosen anew only where those found without it, and those it was found with, are better
    with it.
    """
    best = next(choice for choice in reversed(path) if not choice.problem.whole.first)
    found = find_lag(record, best.problem.whole.floor)
    if found.gain <= WORTH:
        return None
    moved, merged = shifted(record, found.lag), parts.merged
    whole = unknowns_for(moved, merged, initial)._replace(relaxed=best.problem.whole.relaxed)
    some = tuple(p for p in whole.parts if p in {*best.parts, *LAG_PARTS})
    whole = whole.of(*some)._replace(leading=found.leading, floor=best.problem.floor)
    tried = best_prior(Problem(moved, merged, whole), some)
    if tried.blocks.mean() >= best.blocks.mean():
        return None
    again = path_of(moved, parts, (found.leading,), initial)
    without, within = path[-1].blocks, again[-1].blocks
    fall = np.log(without / within)
    worth = within.mean() < (1 - WORTH) * without.mean()
    sure = fall.mean() > 2 * np.std(fall) / np.sqrt(len(fall))
    return Lagging(again, moved, found.lag, found.error) if worth and sure else None


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
    there. A part of the sequences, and of a long one its end, serves where there are many rows.
    """
    few, thin = _stretch(record)
    assert few.time is not None
    step = float(np.median(np.diff(few.time)))
    cut = parts_of(_every(few, thin)).merged
    rows = fitted_rows(cut)
    seen: dict[float, tuple[Record, CompositionUnknowns, Memory]] = {}
    found = []
    for leading in (False, True):
        inside: Bool[np.ndarray, " unknowns"] | None = None

        def objective(lag: float, leading: bool = leading) -> float:
            nonlocal inside
            if lag not in seen:
                moved = _every(shifted(few, lag), thin)
                whole = unknowns_for(moved, cut, "negative", LAG_PARTS)._replace(floor=floor)
                seen[lag] = moved, whole, memory_of(whole.memory(), moved, rows)
            moved, whole, memory = seen[lag]
            problem = Problem(moved, cut, whole._replace(leading=leading), memory)
            problem.inside = problem.inside if inside is None else inside
            residuals = problem.A @ problem.solution(cut.all, LAG_PARTS, LAG_PRIOR) - problem.y
            inside = problem.inside
            return float(np.mean(residuals[problem.taut] ** 2))

        lag, curvature = least_at(objective, step, 16 * step)
        found.append((objective(lag), lag, curvature, leading, objective(0.0)))
    least, lag, curvature, leading, _ = min(found)
    facts = min(ROWS, int(few.mask.sum()))
    error = float(np.sqrt(2 * least / max(curvature, 1e-300) / facts))
    return Lag(lag, error, leading, 1 - least / min(without for *_, without in found))


def _stretch(record: Record) -> tuple[Record, int]:
    """Some sequences, of a long one its end, and every how many rows of it hold four cycles or more.

    What a cut sequence remembers from before is not known, so the first quarter of it does not count.
    """
    labels = record.labels
    few = record.take_sequences(labels[:: max(1, min(len(labels), len(record) // LAG_ROWS))])
    cycles = max(1, int((np.diff(few.cycle, prepend=0) != 0).sum()))
    thin = max(1, 4 * len(few) // (cycles * LAG_ROWS))
    rows, mask = [], few.mask.copy()
    for _, here in few.sequences():
        used = np.flatnonzero(mask[here])
        end = here.start + int(used[-1]) + 1 if len(used) else here.stop
        begin = max(here.start, end - thin * LAG_ROWS)
        if begin > here.start:
            mask[begin : begin + (end - begin) // 4] = False
            rows.append(np.arange(begin, end))
        else:
            rows.append(np.arange(here.start, here.stop))
    return _only(replace(few, mask=mask), rows), thin


def _every(record: Record, thin: int) -> Record:
    """Every so many rows of each sequence."""
    if thin == 1:
        return record
    return _only(record, [np.arange(s.start, s.stop, thin) for _, s in record.sequences()])


def _only(record: Record, each: list[np.ndarray]) -> Record:
    """Only these rows of each sequence."""
    rows = np.concatenate(each)
    if len(rows) == len(record):
        return record
    fields = ("input", "output", "mask", "line", "time")
    taken = {name: getattr(record, name)[rows] for name in fields}
    columns = {name: column[rows] for name, column in record.columns.items()}
    starts = np.cumsum([0, *map(len, each[:-1])])
    return replace(record, **taken, columns=columns, starts=starts)
