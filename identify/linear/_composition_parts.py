"""The parts that a composition may have, and how many unknowns stand in a row of each."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int

from hysteresis import ModulatedStops, Preisach, Record
from hysteresis.numerics._functions import hats_of
from hysteresis.numerics._recurrence import clamped, relaxed, running
from hysteresis.preisach import GridDensity, Initial

from .._levels import COARSE, HELD_AT_ONCE
from ..records._new_record import starts_of
from ._preisach_design_matrix import design_block
from ._unknown_vectors import Values, split

# What the parts of a composition read of an input: places, relaxed springs, stops, relays, speeds.
#
# All but the present input depends on the past, so it is computed over all rows in blocks, with the state
# of every memory carried from one to the next; what is wanted may be a few of the rows. Orientation,
# floor and choice of parts make columns of it, and do not change it.

Samples = Float[np.ndarray, " rows"]


class MemoryLayout(NamedTuple):
    """Which memories there are; lengths in parts of the input's range [low, high].

    - `first`: increments of a curve that the input passes first, () for none.
    - `cells` of springs that relax with the `times`, and are relaxed at `relaxed` before the first
      sample; no times for none.
    - `thresholds` of the stops, which begin at `rest`; none for no stops.
    - `relays`: cells of their grid, 0 for none; `initial`: their first state.
    - `smoothing` of the velocity, a time; 0 for none.
    """

    low: float
    high: float
    first: tuple[float, ...]
    times: tuple[float, ...]
    cells: int
    relaxed: float
    thresholds: tuple[float, ...]
    rest: float
    relays: int
    initial: Initial
    smoothing: float


class Memory(NamedTuple):
    """At some rows; empty where the layout has no such memory.

    - `v`: the input. `before`: the one before, `rest` at a start. `felt`: the same, but `v` at a start.
    - `largest`, `covered`: the largest input so far, and the range covered before. `path`: the path
      travelled before. `elapsed`: the time since the sequence's first sample.
    - `left`: (rows, times, cells) what is left of the springs' rises. `strained`: stops over thresholds.
    - `relays`: rows of the design in node space, sparse. `velocity`: of v, smoothed.
    """

    v: Samples
    before: Samples
    felt: Samples
    largest: Samples
    covered: Samples
    path: Samples
    elapsed: Samples
    left: Float[np.ndarray, "rows times cells"]
    strained: Float[np.ndarray, "rows stops"]
    relays: Any
    velocity: Samples

    def at(self, rows: slice | Int[np.ndarray, " some"]) -> "Memory":
        """At some of these rows."""
        return Memory(*(part[rows] for part in self))

    def cut(self, most: int) -> "Iterator[tuple[slice, Memory]]":
        """The same, so many rows at a time, and which they are."""
        for begin in range(0, len(self.v), most):
            rows = slice(begin, begin + most)
            yield rows, self.at(rows)


def memory_of(layout: MemoryLayout, record: Record, rows: Int[np.ndarray, " rows"]) -> Memory:
    """At some rows of a record."""
    return together([memory for _, memory in memory_blocks(layout, record, rows)])


def together(parts: Sequence[Memory]) -> Memory:
    """Of rows one after the other."""
    joined: dict[str, Any] = {
        name: sparse.vstack(each).tocsr() if name == "relays" else np.concatenate(each)
        for name, each in zip(Memory._fields, zip(*parts, strict=True), strict=True)
    }
    return Memory(**joined)


def memory_blocks(
    layout: MemoryLayout, record: Record, rows: Int[np.ndarray, " rows"]
) -> Iterator[tuple[Int[np.ndarray, " some"], Memory]]:
    """At some rows of a record, block by block, and which rows they are."""
    grid = _grid(layout)
    prepared = None
    most = HELD_AT_ONCE // (1 + len(layout.times) * layout.cells + len(layout.thresholds))
    if layout.relays:
        u = record.input
        v = np.concatenate([_mapped(layout, u[k : k + most]) for k in range(0, len(u), most)])
        prepared = grid.located(np.clip(v, 0.0, 1.0), starts=starts_of(record))
    state = _State.nothing(layout)
    last = int(rows[-1]) + 1 if len(rows) else 0
    for begin in range(0, last, most):
        here = slice(begin, min(begin + most, last))
        inside = (record.starts >= begin) & (record.starts < here.stop)
        t = None if record.time is None else record.time[here]
        v = _mapped(layout, record.input[here])
        taken = rows[slice(*np.searchsorted(rows, (begin, here.stop)))]
        state, dense = _advanced(layout, state, t, v, record.starts[inside] - begin)
        if not len(taken):
            continue
        found = [part[taken - begin] for part in dense]
        relays = sparse.csr_matrix((len(taken), 0))
        if prepared is not None:
            relays = design_block(grid, prepared, taken).matrix.tocsr()
        yield taken, Memory(*[*found[:-1], relays, found[-1]])


class _State(NamedTuple):
    """Behind a row: time, input, largest input, and largest and least before it, path, time since the
    first row, springs, stops, speed."""

    t: float
    v: float
    largest: float
    most: float
    least: float
    path: float
    elapsed: float
    left: np.ndarray
    z: np.ndarray
    lead: np.ndarray

    @classmethod
    def nothing(cls, layout: MemoryLayout) -> "_State":
        left = np.zeros((len(layout.times), layout.cells))
        z = np.full(len(layout.thresholds), layout.rest)
        return cls(0.0, 0.0, -np.inf, -np.inf, np.inf, 0.0, 0.0, left, z, np.zeros((1, 1)))


def _advanced(
    layout: MemoryLayout, state: _State, t: Samples | None, v: Samples, first: np.ndarray
) -> tuple[_State, tuple[np.ndarray, ...]]:
    """The state behind a block of rows, and all of `Memory` but the relays in them."""
    felt = np.append(state.v, v[:-1])
    felt[first] = v[first]
    before = felt.copy()
    before[first] = layout.rest
    largest = running(np.maximum, v, first, state.largest)
    most = running(np.maximum, before, first, state.most)
    least = running(np.minimum, before, first, state.least)
    gone = np.abs(v - felt)
    path = state.path + np.cumsum(gone) - gone
    dt = np.zeros(len(v)) if t is None else np.diff(t, prepend=state.t)
    dt[first] = 0.0
    elapsed = state.elapsed + np.cumsum(dt)
    begun = np.zeros(len(v), int)
    begun[first] = first
    if len(first):
        for sums in (path, elapsed):
            sums[first[0] :] -= sums[np.maximum.accumulate(begun)][first[0] :]
    springs = rises(v, layout.cells)
    moved = np.diff(springs, axis=0, prepend=rises(np.array([state.v]), layout.cells))
    moved[first] = springs[first] - rises(np.array([layout.relaxed]), layout.cells)
    left = _relaxed(np.array(layout.times), dt, moved, first, state.left)
    r = np.array(layout.thresholds)
    low, high = v[:, None] - r, v[:, None] + r
    # A stop that starts at rest forgets where it was: both ends of its clamp are where it goes.
    begun = np.minimum(np.maximum(layout.rest, low[first]), high[first])
    low[first], high[first] = begun, begun
    z = clamped(low, high, state.z)
    lead = np.zeros((len(v), 1, 1))
    if layout.smoothing:
        smoothing = np.array([layout.smoothing])
        lead = _relaxed(smoothing, dt, (v - felt)[:, None], first, state.lead)
    velocity = lead[:, 0, 0] / (layout.smoothing or 1.0)
    behind = _State(
        0.0 if t is None else float(t[-1]), float(v[-1]), float(largest[-1]),
        float(most[-1]), float(least[-1]), float(path[-1] + gone[-1]), float(elapsed[-1]),
        left[-1], z[-1], lead[-1],
    )  # fmt: skip
    strained = (v[:, None] - z) / r
    return behind, (v, before, felt, largest, most - least, path, elapsed, left, strained, velocity)


def _relaxed(
    times: Float[np.ndarray, " times"],
    dt: Samples,
    moved: Float[np.ndarray, "rows columns"],
    first: np.ndarray,
    state: Float[np.ndarray, "times columns"],
) -> Float[np.ndarray, "rows times columns"]:
    """Q_k of every relaxation time and column, see `NonlinearMaxwell`; at each row it rises by `moved`."""
    x = dt[:, None] / times
    decay = np.exp(-x)
    decay[first] = 0.0
    gain = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0)
    return relaxed(decay, gain[:, :, None] * moved[:, None], state)


def rises(v: Samples, n: int) -> Float[np.ndarray, "rows cells"]:
    """How much of each of n even cells of [0, 1] lies below v; the outer ones go on beyond it."""
    found = n * v[:, None] - np.arange(n)
    return np.clip(found, [-np.inf, *[0.0] * (n - 1)], [*[1.0] * (n - 1), np.inf])


def _mapped(layout: MemoryLayout, u: Samples) -> Samples:
    """The input, behind the curve it passes first, in parts of its range."""
    v = (u - layout.low) / (layout.high - layout.low)
    if not layout.first:
        return v
    return rises(v, len(layout.first)) @ np.array(layout.first) / (layout.high - layout.low)


def _grid(layout: MemoryLayout) -> Preisach:
    n = max(layout.relays, 1)
    return Preisach(GridDensity(0.0, 1.0, np.ones((n, n))), np.ones(n), initial=layout.initial)


# Stops and plays of a composition: their columns, and the model of their weights.

PLAYS, STOPS, PLACE_STOPS, SPAN_STOPS = "plays", "stops", "stops by position", "stops by span"

THRESHOLDS = np.geomspace(0.006, 0.45, 14)
"""Of the stops and plays, in parts of the input's range."""

BANDS = np.diff(THRESHOLDS, prepend=0.0)
"""Widths of the bands between them."""

PLACES, SPANS = np.array([0.0, 0.5, 1.0]), np.append(0.0, 2.0 ** np.arange(-3, 1))
"""Levels of the position and of the range covered, in parts of the input's range."""

LEVELS = {PLAYS: PLACES[:1], STOPS: PLACES[:1], PLACE_STOPS: PLACES, SPAN_STOPS: SPANS}
"""Of each part; one with a single level is the same everywhere."""

COLUMNS = {
    PLAYS: len(THRESHOLDS), STOPS: 2 * len(THRESHOLDS), PLACE_STOPS: 2 * len(THRESHOLDS),
    SPAN_STOPS: 2 * len(THRESHOLDS) + 1,
}  # fmt: skip
"""Of each part at one level."""

Columns = Float[np.ndarray, "samples columns"]


def columns_of(part: str, memory: Memory, rest: float) -> Float[np.ndarray, "samples unknowns"]:
    """Plays u - rest - s_j; or stops s_j / r_j, their bands (s_j - s_(j-1)) / (r_j - r_(j-1)), and by span
    a spring u - rest, all in parts of the input's range.

    A stop is the sum of all bands up to its threshold.
    """
    stops, spring = memory.strained * THRESHOLDS, memory.v[:, None] - rest
    if part == PLAYS:
        x = spring - stops
    else:
        x = np.hstack([memory.strained, np.diff(stops, prepend=0.0) / BANDS])
    if part == SPAN_STOPS:
        x = np.hstack([x, spring])
    modulator = memory.covered if part == SPAN_STOPS else memory.before
    return modulated(x, hats_of(modulator, LEVELS[part]))


def modulated(
    x: Columns, h: Float[np.ndarray, "samples levels"]
) -> Float[np.ndarray, "samples products"]:
    """Every column of x times every one of h, those of one x side by side."""
    return (x[:, :, None] * h[:, None, :]).reshape(len(x), -1)


def model_of(part: str, values: Values, low: float, high: float, rest: float) -> ModulatedStops:
    """The model that the unknowns of a part stand for, on an input's range."""
    n, levels, span = len(THRESHOLDS), LEVELS[part], high - low
    by_span = part == SPAN_STOPS
    springs, slopes, plays = np.zeros(len(levels)), np.zeros((n, len(levels))), None
    if part == PLAYS:
        plays = values[:, None] / span
    else:
        weights, beside = split(values, 2 * n, len(levels))
        stops, bands = weights[:n], weights[n:]
        slopes = (stops / THRESHOLDS[:, None])[::-1].cumsum(0)[::-1] + bands / BANDS[:, None]
        springs = beside / span if by_span else springs
    return ModulatedStops(
        low, high, span * THRESHOLDS, span * levels + (0.0 if by_span else low), slopes / span, springs,
        rest=rest, by="span" if by_span else "position", plays=plays,
    )  # fmt: skip


CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS = (
    "curve",
    "Maxwell",
    "strengths",
    "softening",
    "relays",
)
FRICTION = "friction"
DRIFT, TIME_DRIFT = "drift", "drift in time"
DRIFTS = (DRIFT, TIME_DRIFT)
PARTS = (
    CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS, PLAYS, STOPS, PLACE_STOPS, SPAN_STOPS, FRICTION, *DRIFTS
)  # fmt: skip
CELLS = {CURVE: 2 * COARSE, MAXWELL: 12, STRENGTHS: 18, SOFTENING: 12, RELAYS: 24}
"""Cells of each part's even grid on the input's range."""

IN_A_ROW = {
    MAXWELL: CELLS[MAXWELL], STRENGTHS: CELLS[STRENGTHS] + 1, FRICTION: len(PLACES), DRIFT: len(PLACES),
    **{part: len(levels) for part, levels in LEVELS.items()},
}  # fmt: skip
"""Unknowns of a part that differ in their level alone."""
