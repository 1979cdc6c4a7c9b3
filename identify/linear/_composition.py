"""What the unknowns of a composed model stand for, and the columns they multiply.

The model is a sum of parts that are linear in non-negative unknowns (but for the offset's sign):

    y = offset + curve(u) + Maxwell branches + their strengths + softening + relays + plays + stops
        + stops by position + stops by span + friction + drift + drift in time

Each part rises with its input by construction, but for the strengths, or does not depend on the present
one (drifts); so does a sum of them.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Bool, Float, Int

from hysteresis import (
    AbstractModel,
    CyclicDrift,
    MonotoneCurve,
    NonlinearMaxwell,
    Preisach,
    Scaled,
    Series,
    Softening,
    Sum,
    TimeDrift,
    VelocityFriction,
)
from hysteresis.curves import Clip
from hysteresis.numerics._functions import hats_of
from hysteresis.preisach import GridDensity, Initial

from .._levels import AT_ONCE
from ._composition_parts import (
    CELLS,
    COLUMNS,
    CURVE,
    DRIFT,
    DRIFTS,
    FRICTION,
    LEVELS,
    MAXWELL,
    PLACES,
    RELAYS,
    SOFTENING,
    STRENGTHS,
    THRESHOLDS,
    TIME_DRIFT,
    Memory,
    MemoryLayout,
    columns_of,
    model_of,
    modulated,
    rises,
)
from ._group_strengths import prior
from ._nnls import nonnegative_least_squares
from ._preisach_design_matrix import NodeSpace
from ._unknown_vectors import in_units, split, upper_triangular

SPEEDS = 10.0 ** np.arange(-2, 1)
"""Of Coulomb friction, in parts of the speed that a quarter of the samples exceed."""

DECAYS = 4.0 ** np.arange(-2, 2)
"""Time constants of a drift in time, in parts of the longest sequence."""

SMOOTHING, SHARP = 2.0, 0.3
"""Time constant of the velocity's filter, in sampling steps, and where the input's steps hardly differ."""

Columns = Float[np.ndarray, "samples unknowns"]
Samples = Float[np.ndarray, " samples"]


class Member(NamedTuple):
    """What an average is made of: its name, its weight, and its rms error on held-out rows."""

    name: str
    weight: float
    error: float


class CompositionUnknowns(NamedTuple):
    """Which parts there are and what they are made of; unknowns in the order offset, then `parts`.

    - `low`, `high`: range of the input. `scale`: the unknowns are in this unit of the output, which is
      negative where the output falls as the input rises: the model is the negative of one that rises.
    - `times`: relaxation times, shared by the branches and their strengths.
    - `leading`, `initial`: orientation of all parts, and the relays before the first sample.
    - `floor`: the output, or its negative where it falls, is never below it (slack); None for no limit.
    - `centre`: a mean of the output, from which the offset is counted.
    - `first`: increments of a curve that the input passes first, from `low` to `high` as well; () for none.
    - `rest`: where the input is before the first sample, for the stops. `relaxed`: for the branches, too,
      which otherwise have rested at `low`, and are stretched at once.
    - `unseen`: the shortest path before a fitted row, in ranges of the input: before it nothing drifts.
    - `reached`: path, in the same unit, and time at which what drifts has stopped: it explains the fitted
      rows, and the model that is made has none of it, as it was then. With `keeps_drift` the model drifts
      from its first row until there.
    - `duration`: of the longest sequence, 0 without time.
    - `shares`: where unknowns may have either sign, how large those of a line and of each part are
      expected; () where none is negative.
    - `members`: of an average; () where it is none.
    - `speed`, `step`: a usual speed of the input and the sampling step; 0 without time. `smoothing`: of the
      velocity, in steps.
    """

    parts: tuple[str, ...]
    low: float
    high: float
    scale: float
    times: tuple[float, ...]
    leading: bool
    initial: Initial
    floor: float | None = None
    first: tuple[float, ...] = ()
    rest: float = 0.0
    relaxed: bool = False
    speed: float = 0.0
    step: float = 0.0
    unseen: float = 0.0
    reached: tuple[float, float] = (0.0, 0.0)
    keeps_drift: bool = False
    duration: float = 0.0
    smoothing: float = SMOOTHING
    centre: float = 0.0
    shares: tuple[float, ...] = ()
    members: tuple[Member, ...] = ()

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of unknowns of the offset and of each part."""
        n, branches = CELLS, len(self.times)
        of = {
            CURVE: n[CURVE],
            MAXWELL: branches * n[MAXWELL],
            STRENGTHS: 2 * branches * (n[STRENGTHS] + 1),
            SOFTENING: n[SOFTENING] * (n[SOFTENING] + 1) // 2,
            RELAYS: n[RELAYS] * (n[RELAYS] + 1) // 2,
            **{part: COLUMNS[part] * len(levels) for part, levels in LEVELS.items()},
            FRICTION: (len(SPEEDS) + 1) * len(PLACES),
            DRIFT: len(PLACES),
            TIME_DRIFT: len(DECAYS),
        }
        return (1, *(of[part] for part in self.parts))

    @property
    def name(self) -> str:
        """What a composition of these parts is called."""
        if self.shares:
            average = "average with " if self.members else ""
            return f"{average}{len(self.parts)} parts of either sign"
        kind = "average: " if self.members else ""
        return kind + " + ".join(self.lasting) + (" of a mapped input" if self.first else "")

    @property
    def lasting(self) -> tuple[str, ...]:
        """The parts of the model that is made: what drifts only where it is kept."""
        return tuple(part for part in self.parts if self.keeps_drift or part not in DRIFTS)

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return sum(self.sizes)

    @property
    def offsets(self) -> slice:
        """Which unknown is the offset."""
        return slice(1)

    @property
    def least(self) -> float:
        """The floor as unknowns give it: from `centre`, over `scale`."""
        if self.floor is None:
            return -np.inf
        return (self.floor - np.sign(self.scale) * self.centre) / abs(self.scale)

    @property
    def free(self) -> Bool[np.ndarray, " unknowns"]:
        """The unknowns of either sign."""
        signed = bool(self.shares)
        return np.repeat([True, *(signed or part in DRIFTS for part in self.parts)], self.sizes)

    def where(self, parts: tuple[str, ...]) -> Int[np.ndarray, " some"]:
        """Places of the unknowns that a composition of these parts has too."""
        labels = np.repeat(["", *self.parts], self.sizes)
        return np.flatnonzero(np.isin(labels, ["", *parts]))

    def of(self, *parts: str) -> "CompositionUnknowns":
        """The same with some of the parts, in the same order."""
        some = tuple(p for p in self.parts if p in parts)
        own = [s for p, s in zip(self.parts, self.shares[1:], strict=False) if p in some]
        return self._replace(parts=some, shares=(*self.shares[:1], *own))

    def prior(self, strength: float) -> Float[np.ndarray, "unknowns unknowns"]:
        """The matrix of the prior's squares."""
        return prior(self.parts, self.sizes[1:], self.shares, strength)

    def memory(self) -> MemoryLayout:
        """What the columns of the parts read of an input."""
        relaxing = MAXWELL in self.parts or STRENGTHS in self.parts
        stopped = any(part in LEVELS for part in self.parts)
        span = self.high - self.low
        return MemoryLayout(
            self.low, self.high, self.first, self.times if relaxing else (),
            CELLS[MAXWELL] if MAXWELL in self.parts else 1, (self._relaxed - self.low) / span,
            tuple(THRESHOLDS.tolist()) if stopped else (), self._rest,
            CELLS[RELAYS] if RELAYS in self.parts else 0, self.initial,
            self.smoothing * self.step if FRICTION in self.parts else 0.0,
        )  # fmt: skip

    def columns(self, memory: Memory) -> Columns:
        """The output of each unknown alone, in its unit, at rows with this memory."""
        found = np.empty((len(memory.v), self.count))
        for rows, some in memory.cut(AT_ONCE):
            for place, column in self._made(some):
                found[rows, place] = column
        return found

    def _made(self, memory: Memory) -> Iterator[tuple[slice, Columns]]:
        """The columns of the offset and of each part, and their places."""
        made = {
            CURVE: self._curve, MAXWELL: self._branches, STRENGTHS: self._strengths,
            SOFTENING: self._softening, RELAYS: self._relays,
            FRICTION: self._friction, DRIFT: self._drift, TIME_DRIFT: self._time_drift,
        } | {
            part: partial(columns_of, part, rest=self._rest) for part in LEVELS
        }  # fmt: skip
        yield slice(0, 1), np.ones((len(memory.v), 1))
        ends = np.cumsum(self.sizes).tolist()
        for part, *ends_of_part in zip(self.parts, ends, ends[1:], strict=False):
            yield slice(*ends_of_part), made[part](memory)

    def outputs(
        self, memory: Memory, unknowns: Float[np.ndarray, " unknowns"]
    ) -> Float[np.ndarray, " rows"]:
        """The output of the model of the unknowns, which no column of relays is made for."""
        dense = self.of(*(part for part in self.lasting if part != RELAYS))
        x, y = unknowns[self.where(dense.parts)], np.empty(len(memory.v))
        memory = self.stopped(memory, self.reached)
        for rows, some in memory.cut(AT_ONCE):
            y[rows] = sum(columns @ x[place] for place, columns in dense._made(some))
        if RELAYS in self.parts:
            n = CELLS[RELAYS]
            weights = unknowns[np.repeat([False, *(p == RELAYS for p in self.parts)], self.sizes)]
            ramps = np.zeros(n)
            if self.leading:
                i, j = np.tril_indices(n)
                ramps = 2 * (np.bincount(i, weights) + np.bincount(j, weights))
                weights = -weights
            y += memory.relays @ NodeSpace(n).from_unknowns(np.r_[0.0, ramps, weights])
        if self.floor is not None:
            y = np.maximum(y, self.least)
        return self.centre + self.scale * y

    def stopped(self, memory: Memory, reached: tuple[float, float]) -> Memory:
        """The memory of rows to which what drifts has stopped at this path and time."""
        path, elapsed = reached
        if not self.keeps_drift:
            still = np.ones(len(memory.v))
            return memory._replace(path=path * still, elapsed=elapsed * still)
        return memory._replace(
            path=np.minimum(memory.path, path), elapsed=np.minimum(memory.elapsed, elapsed)
        )

    def minimum(
        self,
        H: Float[np.ndarray, "n n"],
        b: Float[np.ndarray, "*draws n"],
        start: Bool[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, "*draws n"]:
        """The minimum of x'Hx/2 - b'x with no unknown negative that is not `free`."""
        return nonnegative_least_squares(H, b, self.free, start)

    def model(self, unknowns: Float[Array, "*draws unknowns"] | np.ndarray) -> AbstractModel:
        """The model of the unknowns; of many vectors, one whose arrays have a leading axis of draws."""
        if unknowns.ndim > 1:
            return jax.vmap(self.model)(jnp.asarray(unknowns))
        # In NumPy where it can be: each operation of JAX compiles a program of its own.
        x: Any = np.sign(self.scale) * in_units(self, unknowns)
        below = (abs(x) - x) / 2 * np.minimum(np.arange(self.count), 1.0) if self.shares else 0.0
        parts = self._parts(x + below)
        if self.shares:  # what rises less what falls, neither of a negative weight
            parts.append(Scaled(Sum(self._parts(below)), -1.0))
        whole: AbstractModel = Sum(parts)
        before = [self._first] if self.first else []
        after = [] if self.floor is None else [Clip(low=self.floor)]
        whole = Series([*before, whole, *after]) if before or after else whole
        return Scaled(whole, -1.0) if self.scale < 0 else whole

    def _parts(self, x: Any) -> list[AbstractModel]:
        """The models of the parts, of unknowns in the output's unit, none of which is negative."""
        ends = np.cumsum(self.sizes)
        offset, *found = (x[end - size : end] for end, size in zip(ends, self.sizes, strict=True))
        values = dict(zip(self.parts, found, strict=True))
        curve = MonotoneCurve.even(self.low, self.high, values.pop(CURVE), offset[0])
        parts: list[AbstractModel] = [curve]
        for part, field in ((MAXWELL, "increments"), (STRENGTHS, "strengths")):
            if part in values:
                senses = (2,) if part == STRENGTHS else ()
                own: Any = {field: values[part].reshape(*senses, len(self.times), -1)}
                own |= {"leading": self.leading, "rest": self._relaxed}
                parts.append(NonlinearMaxwell(self.low, self.high, np.asarray(self.times), **own))
        if SOFTENING in values:
            weights = upper_triangular(CELLS[SOFTENING], values[SOFTENING])
            parts.append(Softening(self.low, self.high, weights, leading=self.leading))
        if RELAYS in values:
            weights = upper_triangular(CELLS[RELAYS], values[RELAYS]).T
            density = GridDensity(self.low, self.high, weights)
            support = 2 * (weights.sum(0) + weights.sum(1)) if self.leading else None
            parts.append(Preisach(density, support, leading=self.leading, initial=self.initial))
        for part in LEVELS:
            if part in values:
                parts.append(model_of(part, values[part], self.low, self.high, self.rest))
        if FRICTION in values:
            coulomb, viscous = split(values[FRICTION], len(SPEEDS), len(PLACES))
            parts.append(
                VelocityFriction(
                    self.low, self.high, self.speed * SPEEDS, self._inputs(PLACES), coulomb,
                    viscous / self.speed, smoothing=self.smoothing * self.step,
                )
            )  # fmt: skip
        path, elapsed = self.reached
        if DRIFT in self.lasting:
            span, places = self.high - self.low, self._inputs(PLACES)
            lengths = {"length": span, "least": self.unseen * span, "most": path * span}
            parts.append(CyclicDrift(self.low, self.high, places, values[DRIFT], **lengths))
        if TIME_DRIFT in self.lasting:
            parts.append(TimeDrift(self.duration * DECAYS, values[TIME_DRIFT], most=elapsed))
        return parts

    def _inputs(self, parts: Samples) -> Samples:
        """Inputs at parts of the range."""
        return self.low + (self.high - self.low) * parts

    @property
    def _first(self) -> MonotoneCurve:
        return MonotoneCurve.even(self.low, self.high, np.asarray(self.first), self.low)

    @property
    def _rest(self) -> float:
        """Where the input rests before the first sample, in parts of its range."""
        return (self.rest - self.low) / (self.high - self.low)

    @property
    def _relaxed(self) -> float:
        """Where the branches are relaxed before the first sample, behind the curve the input passes."""
        rest = self.rest if self.relaxed else self.low
        return float(self._first.simulate(None, [rest])[0]) if self.first else rest

    @property
    def total_names(self) -> tuple[str, ...]:
        """Names of the sums that tell a person what the parts do."""
        return ("offset", *(name for p in self.lasting for name in self.branches(p) or (p,)))

    def branches(self, part: str) -> tuple[str, ...]:
        """Names of a part's branches; strengths differ after a rise and after a fall."""
        times = tuple(f"{tau:.3g}" for tau in self.times)
        if part == STRENGTHS:
            senses = ("after a rise", "after a fall")
            return tuple(f"{part} {tau} {sense}" for sense in senses for tau in times)
        return tuple(f"{part} {tau}" for tau in times) if part == MAXWELL else ()

    @property
    def totals(self) -> Float[np.ndarray, "sums unknowns"]:
        """The sums as rows: a rise over the range, a mean strength, a mass of relays, a mean drift,
        what drifts in the longest sequence."""
        rows = [np.ones((1, 1))]
        for part, size in zip(self.parts, self.sizes[1:], strict=True):
            branches = len(self.branches(part)) or 1
            each = np.ones((1, size // branches))
            if part == TIME_DRIFT:
                each = _gone(np.ones(1))
            rows += [each / each.size if part in (STRENGTHS, DRIFT) else each] * branches
        counts = [1, *(len(self.branches(part)) or 1 for part in self.parts)]
        there = np.repeat([True, *(part in self.lasting for part in self.parts)], counts)
        return np.asarray(scipy.linalg.block_diag(*rows))[there]

    def _curve(self, memory: Memory) -> Columns:
        return rises(memory.v, CELLS[CURVE])

    def _branches(self, memory: Memory) -> Columns:
        left = memory.left
        each = left if self.leading else rises(memory.v, CELLS[MAXWELL])[:, None] - left
        return each.reshape(len(each), -1)

    def _strengths(self, memory: Memory) -> Columns:
        # The rises of all cells add up to that of the input.
        left = memory.left.mean(2)[:, :, None]
        senses = np.stack([np.maximum(left, 0), np.minimum(left, 0)], 1)
        inside = np.clip(rises(memory.v, CELLS[STRENGTHS]), 0, 1)
        tents = -np.diff(inside, axis=1, prepend=1, append=0)
        felt = senses * tents[:, None, None]
        return (felt if self.leading else -felt).reshape(len(felt), -1)

    def _softening(self, memory: Memory) -> Columns:
        n = CELLS[SOFTENING]
        filled, reached = (np.clip(rises(x, n), 0.0, 1.0) for x in (memory.v, memory.largest))
        j, i = np.tril_indices(n)
        if self.leading:
            return filled[:, i] * (1 - reached[:, j]) + filled[:, j]
        return filled[:, i] * reached[:, j]

    def _relays(self, memory: Memory) -> Columns:
        n, rows = CELLS[RELAYS], memory.relays
        i, j = np.tril_indices(n)
        columns = NodeSpace(n).to_unknowns(rows.T.toarray())
        ramps, relays = columns[1 : 1 + n], columns[1 + n :]
        return (2 * (ramps[i] + ramps[j]) - relays if self.leading else relays).T

    def _friction(self, memory: Memory) -> Columns:
        speed = memory.velocity[:, None] / (self.speed / (self.high - self.low))
        return modulated(np.hstack([np.tanh(speed / SPEEDS), speed]), hats_of(memory.felt, PLACES))

    def _drift(self, memory: Memory) -> Columns:
        path = np.maximum(memory.path, self.unseen)
        none_at = self.unseen if self.keeps_drift else max(self.reached[0], self.unseen)
        return np.log((1 + path) / (1 + none_at))[:, None] * hats_of(memory.felt, PLACES)

    def _time_drift(self, memory: Memory) -> Columns:
        none_at = np.array([0.0 if self.keeps_drift else self.reached[1]])
        return _gone(memory.elapsed / self.duration) - _gone(none_at / self.duration)


def _gone(elapsed: Samples) -> Columns:
    """What each drift has done, at times in parts of the longest sequence."""
    return -np.expm1(-elapsed[:, None] / DECAYS)
