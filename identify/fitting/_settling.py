"""First cycles of a sample that settles: what they do is seen once, and nothing tells it from memory."""

import numpy as np

from hysteresis import Record

from ..linear._composition import CURVE, RELAYS
from ..linear._composition_fit import Problem, fitted_rows, unknowns_for
from ..linear._composition_memory import memory_of
from ..records._folds import Fold, best_of, simplest
from ..records._folds import parts as parts_of
from ..records._speeds import rates_differ

FEWEST = 6
"""Cycles that a record needs; the last three are always kept."""

ALIKE = 0.15
"""By how much of their median the ranges of cycles that repeat each other may differ."""

PRIOR = 1e-4
"""Strength of the prior of the model that judges."""


def settled(record: Record, leadings: tuple[bool, ...]) -> Record:
    """The record without its first cycles, where one cycle is repeated until the sample has settled.

    A curve with relays, of each orientation in `leadings`, is fitted to all cycles, to the last half and
    to the last three, and predicts the last one. The fit leaves out as many cycles as cost nothing, because
    how a sample settled does not inform about another run, before which it may have settled already. Only a
    single sequence of cycles of like ranges and rates is judged so.
    """
    numbers = np.unique(record.cycle[record.mask & (record.cycle > 0)])
    if len(record.labels) > 1 or len(numbers) < FEWEST:
        return record
    count = record.cycle.max() + 1
    largest, least = np.full(count, -np.inf), np.full(count, np.inf)
    np.maximum.at(largest, record.cycle, record.input)
    np.minimum.at(least, record.cycle, record.input)
    ranges = (largest - least)[numbers]
    cut = parts_of(record)
    alike = np.ptp(ranges) <= ALIKE * np.median(ranges) and not rates_differ(record)
    if not alike or len(cut.all) < FEWEST:
        return record
    last = cut.folds[-1].test[-1]
    counts = (len(cut.all) - 3, len(cut.all) // 2, 0)
    trained = [tuple(p for p in cut.all if count <= p != last) for count in counts]
    folds = tuple(Fold(train, (last,)) for train in trained)
    few = cut._replace(folds=folds, conditioning=None).merged
    whole = unknowns_for(record, few, "negative", (CURVE, RELAYS))
    memory = memory_of(whole.memory(), record, fitted_rows(few))
    choices = []
    for leading in leadings:
        problem = Problem(record, few, whole._replace(leading=leading), memory)
        choices.append([problem.tried((CURVE, RELAYS), PRIOR, (fold,)) for fold in few.folds])
    tried = min(choices, key=lambda trials: best_of(trials).blocks.mean())
    count = counts[tried.index(simplest(tried))]
    if not count:
        return record
    first = record.cycle[cut.label == count][0]
    said = f"Left out what comes before cycle {first}: the sample settles."
    mask = record.mask & (record.cycle >= first)
    return record.noted("settled", said, mask=mask)
