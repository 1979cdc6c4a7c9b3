"""Hold-outs inside the training part: whole sequences or whole cycles, never random samples."""

import itertools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from hysteresis import Record
from hysteresis.records._change import FEWEST
from hysteresis.records._cycles import counted_cycles, default_dead_band, turning_points

from .._levels import PART


class Fold(NamedTuple):
    """Which parts a trial fit sees and which it is judged on."""

    train: tuple[int, ...]
    test: tuple[int, ...]


MANY_CYCLES = 2 * FEWEST
"""Cycles of a single sequence from which on more than the last one is predicted from those before."""


KIND = 0.2
"""Relative difference of neighbouring ranges from which on they are of two kinds."""


QUARTERS = 4
"""Groups that are held out in turn: a quarter each."""

PIECES = 2 * QUARTERS
"""Pieces of each branch of a single loop, dealt to the groups."""


class Parts(NamedTuple):
    """The rows that count, cut into parts, and the folds made of them.

    - `label` (samples,): part of each row; -1 where it does not count.
    - `folds`: the hold-outs, none where the record is too short for one.
    - `conditioning`: the part that a fit may leave out as conditioning, if any: the first cycle.
    - `how`: in words.
    - `kept`: the parts that the fit at last learns from; None for all, see `latest`.
    - `by_cycles`: whole cycles or sequences are held out, not pieces of one.
    """

    label: Int[np.ndarray, " samples"]
    folds: tuple[Fold, ...]
    conditioning: int | None
    how: str
    kept: tuple[int, ...] | None = None
    by_cycles: bool = True

    @property
    def all(self) -> tuple[int, ...]:
        """Every part."""
        return tuple(np.flatnonzero(np.bincount(self.label[self.label >= 0])).tolist())

    @property
    def fitted(self) -> tuple[int, ...]:
        """Those that the fit learns from at last."""
        return self.all if self.kept is None else self.kept

    @property
    def conditioned(self) -> "Parts":
        """The same, of which the conditioning part is never learnt from."""

        def rest(which: tuple[int, ...]) -> tuple[int, ...]:
            return tuple(p for p in which if p != self.conditioning)

        folds = tuple(Fold(rest(fold.train), fold.test) for fold in self.folds)
        return self._replace(folds=folds, kept=rest(self.fitted))

    @property
    def merged(self) -> "Parts":
        """The same folds with as few parts as tell them apart, so that sums over parts are few.

        Cycles that every fold trains on, or holds out, together become one part. The conditioning cycle
        stays alone. Of 400 cycles that are four parts.
        """

        sides = [set(side) for fold in self.folds for side in fold]
        sides += [] if self.kept is None else [set(self.kept)]
        role = {p: (p == self.conditioning, *(p in side for side in sides)) for p in self.all}
        kinds = list(dict.fromkeys(role.values()))
        new = {p: kinds.index(role[p]) for p in role}
        table = np.zeros(max(new, default=0) + 1, int)
        table[list(new)] = list(new.values())
        label = np.where(self.label >= 0, table[self.label], -1)
        folds = tuple(
            Fold(*(tuple(sorted({new[p] for p in side if p in new})) for side in fold))
            for fold in self.folds
        )
        conditioning = None if self.conditioning is None else new.get(self.conditioning)
        kept = None if self.kept is None else tuple(sorted({new[p] for p in self.kept}))
        return Parts(label, folds, conditioning, self.how, kept, self.by_cycles)


def parts(record: Record, keep_conditioning: bool = False, most: int = 5) -> Parts:
    """Cut a record into parts: groups of sequences where it has several, else cycles, else a tail.

    Several sequences make up to `most` folds, each held out in turn, those of a smaller amplitude all at
    once, see `_by_amplitude`; but none whose inputs lie beyond those of all others, because a memory knows
    nothing there. In a single one the last cycle is held out; of eight cycles or more the third quarter,
    from a fit to those before, and then the last, because what creeps or settles shows over many cycles
    only. The first may be a conditioning cycle where two more follow. Of a record without two cycles the
    last quarter is held out, or pieces of every branch where that quarter is the first to show its branch:
    what a memory does there no other row tells.
    """
    label = np.full(len(record), -1)
    counted = [rows for _, rows in record.sequences() if record.mask[rows].any()]
    if len(counted) > 1:
        groups = _by_amplitude(
            [np.ptp(record.input[rows][record.mask[rows]]) for rows in counted], most
        )
        for k, rows in zip(groups, counted, strict=True):
            label[rows] = k
        label[~record.mask] = -1
        every = range(max(groups) + 1)
        folds = tuple(Fold(tuple(p for p in every if p != k), (k,)) for k in every)
        inside = tuple(fold for fold in folds if _inside(record.input, label, fold)) or folds
        how = f"{len(folds)} groups of sequences, each held out in turn"
        if len(inside) < len(folds):
            how += " but those beyond the inputs of the others"
        return Parts(label, inside, None, how)
    # Of a cycle that was held out a few rows may be left: it counts whole, or not at all.
    cycles = counted_cycles(record, record.mask, 0.0)[0]
    fullest = max((one.share for one in cycles), default=0.0)
    whole = [one.number for one in cycles if one.share > 0.5 * fullest]
    cycle = np.where(record.mask & np.isin(record.cycle, whole), record.cycle, 0)
    numbers = np.unique(cycle[cycle > 0])
    if len(numbers) > 1:
        label = np.searchsorted(numbers, cycle)
        last = len(numbers) - 1
        # Rows in no cycle, a hold after the last one say, are fitted and never held out.
        label[cycle == 0] = last + 1
        label[~record.mask] = -1
        beside = (last + 1,) if (label > last).any() else ()
        cuts, how = (last, last + 1), "the last training cycle held out"
        if last + 1 >= MANY_CYCLES:
            cuts = (last + 1) // 2, 3 * (last + 1) // 4, last + 1
            how = (
                "the third and the last quarter of the training cycles, predicted from those before"
            )
        folds = tuple(
            Fold((*range(first), *beside), tuple(range(first, end)))
            for first, end in itertools.pairwise(cuts)
        )
        conditioning = 0 if last > 1 and not keep_conditioning else None
        return Parts(label, folds, conditioning, how)
    rows = np.flatnonzero(record.mask)
    late = np.arange(len(rows)) >= 0.75 * len(rows)
    branch = _branches(record.input)[rows]
    if _is_new(record.input[rows], branch % 2, late):
        for leg in np.unique(branch):
            piece = np.arange(np.sum(branch == leg)) * PIECES // np.sum(branch == leg)
            # Pieces of neighbouring branches at the same inputs are not held out together.
            label[rows[branch == leg]] = (piece + leg * QUARTERS // 2) % QUARTERS
        folds = tuple(
            Fold(tuple(p for p in range(QUARTERS) if p != k), (k,)) for k in range(QUARTERS)
        )
        how = "pieces of every branch, held out in turn, as each branch is passed once"
        return Parts(label, folds, None, how, by_cycles=False)
    label[rows] = late
    how = "the last quarter of the training rows held out"
    return Parts(label, (Fold((0,), (1,)),), None, how, by_cycles=False)


def _branches(u: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " samples"]:
    """The number of the way from one reversal to the next on which each row lies: odd where u falls."""
    turns = turning_points(u, default_dead_band(u))
    falls = int(len(turns) > 1 and u[turns[1]] < u[turns[0]])
    return falls + np.searchsorted(turns[1:-1], np.arange(len(u)))


def _is_new(
    u: Float[np.ndarray, " rows"], falls: Int[np.ndarray, " rows"], late: Bool[np.ndarray, " rows"]
) -> bool:
    """Whether most late rows are the first in their direction there, where the input goes both ways."""
    new = np.zeros(len(u), bool)
    for way in (0, 1):
        here, before = late & (falls == way), u[~late & (falls == way)]
        new |= here & ~((u >= before.min(initial=np.inf)) & (u <= before.max(initial=-np.inf)))
    rows = np.bincount(falls, minlength=2)
    return bool(new.sum() > 0.5 * late.sum() and rows.min() >= QUARTERS * PIECES)


def _inside(
    u: Float[np.ndarray, " samples"], label: Int[np.ndarray, " samples"], fold: Fold
) -> bool:
    """Whether the held-out inputs lie among the others, or less than a fifth of their range beyond."""
    held, seen = (u[np.isin(label, side)] for side in (fold.test, fold.train))
    beyond = max(seen.min() - held.min(), held.max() - seen.max())
    return bool(beyond <= KIND * np.ptp(held))


def _by_amplitude(spans: list[float], most: int) -> list[int]:
    """Up to `most` groups of sequences, by the range that the input of each covers.

    Where the ranges are of a few kinds, all sequences of one smaller kind make a group, so that a fit is
    tried on an amplitude that it has not seen. Those of the largest kind are dealt out to the rest of the
    groups, lest none is left to show that range. Ranges of one kind are all dealt out.
    """
    order = np.argsort(spans, kind="stable")
    ordered = np.asarray(spans)[order]
    kind = np.zeros(len(spans), int)
    kind[order] = np.cumsum(np.append(0, np.diff(ordered) > KIND * ordered[1:]))
    largest = kind.max()
    alone = np.flatnonzero(kind == largest)
    if largest > most - 2 or len(alone) < 2:  # too many kinds, or nothing left to show the largest
        kind, largest, alone = np.zeros(len(spans), int), 0, np.arange(len(spans))
    for k, sequence in enumerate(alone):
        kind[sequence] = largest + k % min(most - largest, len(alone))
    return [int(k) for k in kind]


def thinned(rows: Int[np.ndarray, " rows"], most: int) -> Int[np.ndarray, " fewer"]:
    """At most so many of the rows: one of every k neighbours, at places that differ from k to k.

    Every k-th row of a record whose cycles have a multiple of k rows shows the same few phases of each. The
    places are multiples of the golden section, which no period meets.
    """
    k = max(1, -(-len(rows) // most))
    first = np.arange(0, len(rows), k)
    place = (np.arange(len(first)) * scipy.constants.golden % 1 * k).astype(int)
    return rows[np.minimum(first + place, len(rows) - 1)]


BLOCKS_OF_FOLD = 10
"""Blocks of consecutive rows into which the errors of a fold are cut."""


def block_errors(error: Float[np.ndarray, " rows"]) -> list[float]:
    """Mean squares of ten blocks of consecutive rows, so that choices can be compared in pairs."""
    blocks = np.array_split(error, BLOCKS_OF_FOLD)
    return [float(np.mean(block**2)) for block in blocks if len(block)]


class RootDifference(NamedTuple):
    """How much one rms error is above another, both over the same rows, and the standard error of that."""

    value: float
    error: float


def root_difference(
    one: Float[np.ndarray, " blocks"], other: Float[np.ndarray, " blocks"]
) -> RootDifference | None:
    """root(mean other) - root(mean one) of paired blocks of squared errors, its error to first order.

    None where the blocks are not of the same rows, or fewer than two.
    """
    if len(one) != len(other) or len(one) < 2:
        return None
    roots = [max(float(np.sqrt(blocks.mean())), 1e-300) for blocks in (one, other)]
    each = other / (2 * roots[1]) - one / (2 * roots[0])
    return RootDifference(roots[1] - roots[0], float(each.std(ddof=1) / np.sqrt(len(each))))


def held_out_errors(
    folds: Iterable[Fold],
    solve: Callable[[tuple[int, ...]], Any],
    error: Callable[[Any, tuple[int, ...]], Float[np.ndarray, " rows"]],
) -> Float[np.ndarray, " blocks"]:
    """Cross-validation: the mean squared errors, in blocks of rows, of every fold's held-out parts.

    `solve(train)` fits the parts of a fold; `error(solution, test)` gives the errors on the others.
    """
    blocks: list[float] = []
    for fold in folds:
        blocks += block_errors(error(solve(fold.train), fold.test))
    return np.array(blocks)


@runtime_checkable
class Trial(Protocol):
    """Anything that was tried on held-out parts."""

    @property
    def blocks(self) -> Float[np.ndarray, " blocks"]: ...


Tried = TypeVar("Tried", bound=Trial)


def best_of(trials: Iterable[Tried]) -> Tried:
    """The trial with the least held-out error, the first of several."""
    return min(trials, key=lambda trial: trial.blocks.mean())


def simplest(trials: Iterable[Tried], best: Tried | None = None) -> Tried:
    """The one-standard-error rule: the first of `trials`, simplest first, that is as good as the best.

    Source: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning (2009), section 7.10.
    """
    trials = list(trials)
    best = best_of(trials) if best is None else best
    return next(trial for trial in trials if as_good(trial.blocks, best.blocks))


LEAST_GAIN = 0.05
"""Share of the squared held-out error that a further part of a model, or fewer rows, must take away."""


NEARLY = 1 + PART
"""A simpler model may have so many times the held-out error of the best one."""


def earned(
    before: Float[np.ndarray, " blocks"],
    after: Float[np.ndarray, " blocks"],
    least: float = LEAST_GAIN,
) -> bool:
    """Whether a choice takes away enough of the held-out error, beyond the standard error of that."""
    gains = after.mean() <= (1 - least) * before.mean()
    return bool(gains) and not as_good(before, after)


def as_good(blocks: Float[np.ndarray, " blocks"], least: Float[np.ndarray, " blocks"]) -> bool:
    """Whether held-out errors exceed the least ones by no more than that difference's standard error.

    Both are errors of the same blocks of rows, so the difference is taken in pairs.
    """
    worse = blocks - least
    return bool(worse.mean() <= np.std(worse) / np.sqrt(len(worse)))
