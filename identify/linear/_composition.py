"""What the unknowns of a composed model stand for, and the columns they multiply.

The model is a sum of parts that are linear in non-negative unknowns (but for the offset's sign):

    y = offset + curve(u) + Maxwell branches + their strengths + softening + relays
        + stops by position + stops by span + friction

Each part rises with its input by construction, but for the strengths; so does a sum of them.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Bool, Float, Int

from hysteresis import (
    AbstractModel,
    ModulatedStops,
    MonotoneCurve,
    NonlinearMaxwell,
    Preisach,
    Record,
    Scaled,
    Series,
    Softening,
    Sum,
    VelocityFriction,
)
from hysteresis.curves import Clip
from hysteresis.models._modulated_stops import stops_of
from hysteresis.numerics._hats import hats_of
from hysteresis.preisach import GridDensity, Initial

from ._nnls import nonnegative_least_squares
from ._preisach_design_matrix import NodeSpace, design_rows

CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS = (
    "curve",
    "Maxwell",
    "strengths",
    "softening",
    "relays",
)
PLACE_STOPS, SPAN_STOPS, FRICTION = "stops by position", "stops by span", "friction"
PARTS = (CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS, PLACE_STOPS, SPAN_STOPS, FRICTION)
CELLS = {CURVE: 40, MAXWELL: 12, STRENGTHS: 18, SOFTENING: 12, RELAYS: 24}
"""Cells of each part's even grid on the input's range."""

THRESHOLDS = np.geomspace(0.006, 0.4, 9)
"""Of the stops, in parts of the input's range."""

PLACES, SPANS = np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.125, 0.25, 0.5, 1.0])
"""Levels of the position and of the range covered, in parts of the input's range."""

SPEEDS = np.array([0.02, 0.1, 0.5, 2.0])
"""Of Coulomb friction, in parts of the speed that a quarter of the samples exceed."""

SMOOTHING = 2.0
"""Time constant of the velocity's filter, in sampling steps."""

FIRMNESS = {
    CURVE: 1.0, MAXWELL: 10.0, STRENGTHS: 0.1, SOFTENING: 10.0, RELAYS: 10.0,
    PLACE_STOPS: 1.0, SPAN_STOPS: 1.0, FRICTION: 1.0,
}  # fmt: skip
"""How much stronger the prior holds a part than the curve."""

RIDGE = 1e-7
"""Pulls what the data leave open to 0; in squares of the output's range. Strengths are pulled ten times as
hard: at rates that were not tried they say what the curve does not."""

Columns = Float[np.ndarray, "samples unknowns"]
Samples = Float[np.ndarray, " samples"]
Stops = Float[np.ndarray, "samples stops"]
Starts = Int[np.ndarray, " sequences"]


class CompositionUnknowns(NamedTuple):
    """Which parts there are and what they are made of; unknowns in the order offset, then `parts`.

    - `low`, `high`: range of the input. `scale`: the unknowns are in this unit of the output, which is
      negative where the output falls as the input rises: the model is the negative of one that rises.
    - `times`: relaxation times, shared by the branches and their strengths.
    - `leading`, `initial`: orientation of all parts, and the relays before the first sample.
    - `floor`: the output, or its negative where it falls, is never below it (slack); None for no limit.
    - `first`: increments of a curve that the input passes first, from `low` to `high` as well; () for none.
    - `rest`: where the input of the stops is before the first sample.
    - `speed`, `step`: a usual speed of the input and the sampling step; 0 without time.
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
    speed: float = 0.0
    step: float = 0.0

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
            PLACE_STOPS: len(THRESHOLDS) * len(PLACES),
            SPAN_STOPS: (len(THRESHOLDS) + 1) * len(SPANS),
            FRICTION: (len(SPEEDS) + 1) * len(PLACES),
        }
        return (1, *(of[part] for part in self.parts))

    @property
    def name(self) -> str:
        """What a composition of these parts is called."""
        return " + ".join(self.parts) + (" of a mapped input" if self.first else "")

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return sum(self.sizes)

    def where(self, parts: tuple[str, ...]) -> Int[np.ndarray, " some"]:
        """Places of the unknowns that a composition of these parts has too."""
        labels = np.repeat(["", *self.parts], self.sizes)
        return np.flatnonzero(np.isin(labels, ["", *parts]))

    def of(self, *parts: str) -> "CompositionUnknowns":
        """The same with some of the parts, in the same order."""
        return self._replace(parts=tuple(p for p in self.parts if p in parts))

    def prior(self, strength: float) -> Float[np.ndarray, "unknowns unknowns"]:
        """The matrix of the prior's squares: neighbouring increments alike, strengths bend little."""
        blocks = [np.zeros((1, 1))]
        for part, size in zip(self.parts, self.sizes[1:], strict=True):
            n = CELLS.get(part, 0)
            if part in (CURVE, MAXWELL):
                D = np.diff(np.eye(n), axis=0)
                each = n * D.T @ D
            elif part == STRENGTHS:
                D = n * np.diff(np.eye(n + 1), 2, axis=0)
                each = D.T @ D / (n + 1)
            else:
                each = np.eye(size)
            branches = size // len(each)
            own = strength * FIRMNESS[part]
            ridge = 10 * RIDGE if part == STRENGTHS else RIDGE
            blocks += [own * each + ridge * np.eye(len(each))] * branches
        return np.asarray(scipy.linalg.block_diag(*blocks))

    def columns(self, record: Record, rows: Int[np.ndarray, " rows"]) -> Columns:
        """The output of each unknown alone, in its unit, at some rows of a record."""
        u = record.input
        if self.first:
            u = np.asarray(self._first.simulate(None, u))
        v = (u - self.low) / (self.high - self.low)
        starts, strained = record.starts, np.empty((len(v), 0))
        if PLACE_STOPS in self.parts or SPAN_STOPS in self.parts:  # both share the loop over time
            strained = stops_of(v, THRESHOLDS, self._rest, starts) / THRESHOLDS
        made = {
            CURVE: self._curve, MAXWELL: self._branches, STRENGTHS: self._strengths,
            SOFTENING: self._softening, RELAYS: self._relays,
            PLACE_STOPS: partial(self._place_stops, strained),
            SPAN_STOPS: partial(self._span_stops, strained), FRICTION: self._friction,
        }  # fmt: skip
        found = [made[part](v, record.time, starts)[rows] for part in self.parts]
        return np.hstack([np.ones((len(rows), 1)), *found])

    def minimum(
        self,
        H: Float[np.ndarray, "n n"],
        b: Float[np.ndarray, " n"],
        start: Bool[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """The minimum of x'Hx/2 - b'x with all unknowns but the offset, the first, not negative."""
        return nonnegative_least_squares(H, b, np.arange(len(b)) == 0, start)

    def model(self, unknowns: Float[Array, "*draws unknowns"] | np.ndarray) -> AbstractModel:
        """The model of the unknowns; of many vectors, one whose arrays have a leading axis of draws."""
        if unknowns.ndim > 1:
            return jax.vmap(self.model)(unknowns)
        x = abs(self.scale) * jnp.asarray(unknowns)
        splits = np.cumsum(self.sizes)[:-1]
        offset, *found = jnp.split(x, splits)
        values = dict(zip(self.parts, found, strict=True))
        curve = MonotoneCurve.even(self.low, self.high, values.pop(CURVE), offset[0])
        parts: list[AbstractModel] = [curve]
        for part, field in ((MAXWELL, "increments"), (STRENGTHS, "strengths")):
            if part in values:
                senses = (2,) if part == STRENGTHS else ()
                own = {field: values[part].reshape(*senses, len(self.times), -1)}
                times = np.asarray(self.times)
                parts.append(
                    NonlinearMaxwell(self.low, self.high, times, **own, leading=self.leading)
                )
        if SOFTENING in values:
            weights = _upper(CELLS[SOFTENING], values[SOFTENING])
            parts.append(Softening(self.low, self.high, weights, leading=self.leading))
        if RELAYS in values:
            weights = _upper(CELLS[RELAYS], values[RELAYS]).T
            density = GridDensity(self.low, self.high, weights)
            support = 2 * (weights.sum(0) + weights.sum(1)) if self.leading else None
            parts.append(Preisach(density, support, leading=self.leading, initial=self.initial))
        for part in (PLACE_STOPS, SPAN_STOPS):
            if part in values:
                parts.append(self._stops(part, values[part]))
        if FRICTION in values:
            coulomb, viscous = _split(values[FRICTION], len(SPEEDS), len(PLACES))
            parts.append(
                VelocityFriction(
                    self.low, self.high, self.speed * SPEEDS, self._inputs(PLACES), coulomb,
                    viscous / self.speed, smoothing=SMOOTHING * self.step,
                )
            )  # fmt: skip
        before = [self._first] if self.first else []
        after = [] if self.floor is None else [Clip(low=self.floor)]
        whole: AbstractModel = Sum(parts)
        whole = Series([*before, whole, *after]) if before or after else whole
        return Scaled(whole, -1.0) if self.scale < 0 else whole

    def _stops(self, part: str, values: Array) -> ModulatedStops:
        """Weights of the columns s / r as stiffnesses."""
        by_place, span = part == PLACE_STOPS, self.high - self.low
        levels = PLACES if by_place else SPANS
        weights, springs = _split(values, len(THRESHOLDS), len(levels))
        springs = jnp.zeros(len(levels)) if by_place else springs / span
        return ModulatedStops(
            self.low, self.high, span * THRESHOLDS,
            self._inputs(levels) if by_place else span * levels,
            weights / (span * THRESHOLDS)[:, None], springs, rest=self.rest,
            by="position" if by_place else "span",
        )  # fmt: skip

    def _inputs(self, parts: Samples) -> Samples:
        """Inputs at parts of the range."""
        return self.low + (self.high - self.low) * parts

    @property
    def _first(self) -> MonotoneCurve:
        return MonotoneCurve.even(self.low, self.high, np.asarray(self.first), self.low)

    @property
    def total_names(self) -> tuple[str, ...]:
        """Names of the sums that tell a person what the parts do."""
        names = ["offset"]
        for part in self.parts:
            names += self.branches(part) or (part,)
        return tuple(names)

    def branches(self, part: str) -> tuple[str, ...]:
        """Names of a part's branches; strengths differ after a rise and after a fall."""
        times = tuple(f"{tau:.3g}" for tau in self.times)
        if part == STRENGTHS:
            senses = ("after a rise", "after a fall")
            return tuple(f"{part} {tau} {sense}" for sense in senses for tau in times)
        return tuple(f"{part} {tau}" for tau in times) if part == MAXWELL else ()

    @property
    def totals(self) -> Float[np.ndarray, "sums unknowns"]:
        """The sums as rows: a rise over the range, a mean strength, a mass of relays."""
        rows = [np.ones((1, 1))]
        for part, size in zip(self.parts, self.sizes[1:], strict=True):
            branches = len(self.branches(part)) or 1
            each = np.ones((1, size // branches))
            rows += [each / each.size if part == STRENGTHS else each] * branches
        return np.asarray(scipy.linalg.block_diag(*rows))

    # Columns of each part, at all samples of an input v in parts of the range

    def _curve(self, v: Samples, t: Samples | None, starts: Starts) -> Columns:
        return _rises(v, CELLS[CURVE])

    def _branches(self, v: Samples, t: Samples | None, starts: Starts) -> Columns:
        springs = _rises(v, CELLS[MAXWELL])
        left = self._relaxing(springs, t, starts)
        each = left if self.leading else springs[:, None] - left
        return each.reshape(len(v), -1)

    def _strengths(self, v: Samples, t: Samples | None, starts: Starts) -> Columns:
        left = self._relaxing(v[:, None], t, starts)
        senses = np.stack([np.maximum(left, 0), np.minimum(left, 0)], 1)
        rises = np.clip(_rises(v, CELLS[STRENGTHS]), 0, 1)
        tents = -np.diff(rises, axis=1, prepend=1, append=0)
        felt = senses * tents[:, None, None]
        return (felt if self.leading else -felt).reshape(len(v), -1)

    def _softening(self, v: Samples, t: Samples | None, starts: Starts) -> Columns:
        n = CELLS[SOFTENING]
        units = jax.vmap(lambda unit: _upper(n, unit))(jnp.eye(n * (n + 1) // 2))
        like = Softening(0.0, 1.0, units[0], leading=self.leading)
        prepared = like.prepare(t, v, starts=tuple(starts.tolist()))
        return np.asarray(_softened(like, units, prepared)).T

    def _relays(self, v: Samples, t: Samples | None, starts: Starts) -> Columns:
        n = CELLS[RELAYS]
        model = Preisach(GridDensity(0.0, 1.0, np.ones((n, n))), np.ones(n), initial=self.initial)
        prepared = model.prepare(None, np.clip(v, 0.0, 1.0), starts=tuple(starts.tolist()))
        B = design_rows(model, prepared)
        ramps, relays = np.split(NodeSpace(n).to_unknowns(B.toarray().T)[1:].T, [n], axis=1)
        i, j = np.tril_indices(n)
        return 2 * (ramps[:, i] + ramps[:, j]) - relays if self.leading else relays

    def _place_stops(
        self, strained: Stops, v: Samples, t: Samples | None, starts: Starts
    ) -> Columns:
        return _modulated(strained, hats_of(_before(v, starts, self._rest), PLACES))

    def _span_stops(
        self, strained: Stops, v: Samples, t: Samples | None, starts: Starts
    ) -> Columns:
        covered = _before(v, starts, self._rest)
        for run in np.split(covered, starts[1:]):
            run[:] = np.maximum.accumulate(run) - np.minimum.accumulate(run)
        strained = np.hstack([strained, (v - self._rest)[:, None]])
        return _modulated(strained, hats_of(covered, SPANS))

    def _friction(self, v: Samples, t: Samples | None, starts: Starts) -> Columns:
        assert t is not None
        model = VelocityFriction(
            0.0, 1.0, SPEEDS, PLACES, np.zeros((len(SPEEDS), len(PLACES))), np.zeros(len(PLACES)),
            smoothing=SMOOTHING * self.step,
        )  # fmt: skip
        prepared = model.prepare(t, v, starts=tuple(starts.tolist()))
        speed = model.velocity(prepared) / (self.speed / (self.high - self.low))
        felt = np.column_stack([*np.tanh(np.asarray(speed) / SPEEDS[:, None]), speed])
        return _modulated(felt, hats_of(np.asarray(prepared.before), PLACES))

    @property
    def _rest(self) -> float:
        """`rest` in parts of the range."""
        return (self.rest - self.low) / (self.high - self.low)

    def _relaxing(
        self, x: Float[np.ndarray, "samples columns"], t: Samples | None, starts: Starts
    ) -> Float[np.ndarray, "samples times columns"]:
        """Q_k[x] of every relaxation time and column, see `NonlinearMaxwell`; x was 0 before each start.

        The model itself has it for one x at a time. All columns at once share the loop over time here.
        """
        assert t is not None
        dt = np.diff(t, prepend=t[:1])
        before = np.vstack([x[:1], x[:-1]])
        dt[starts], before[starts] = 0.0, 0.0
        z = dt[:, None] / np.array(self.times)
        decay = np.exp(-z)
        decay[starts] = 0.0
        gain = np.divide(-np.expm1(-z), z, out=np.ones_like(z), where=z > 0)
        left = gain[:, :, None] * (x - before)[:, None]
        for k in range(1, len(left)):
            left[k] += decay[k, :, None] * left[k - 1]
        return left


def _rises(v: Samples, n: int) -> Columns:
    """How much of each of n even cells of [0, 1] lies below v; the outer ones go on beyond it."""
    rises = n * v[:, None] - np.arange(n)
    return np.clip(rises, [-np.inf, *[0.0] * (n - 1)], [*[1.0] * (n - 1), np.inf])


def _modulated(
    x: Float[np.ndarray, "samples columns"], h: Float[np.ndarray, "samples levels"]
) -> Float[np.ndarray, "samples products"]:
    """Every column of x times every one of h, those of one x side by side."""
    return (x[:, :, None] * h[:, None, :]).reshape(len(x), -1)


def _split(values: Array, rows: int, columns: int) -> tuple[Array, Array]:
    """A matrix (rows, columns) and what follows it."""
    count = rows * columns
    return values[:count].reshape(rows, columns), values[count:]


def _before(v: Samples, starts: Starts, rest: float) -> Samples:
    """The sample before each one."""
    before = np.append(rest, v[:-1])
    before[starts] = rest
    return before


def _upper(n: int, values: Array) -> Array:
    """An upper triangular matrix of its n (n + 1) / 2 entries, column by column."""
    j, i = np.tril_indices(n)
    return jnp.zeros((n, n), values.dtype).at[i, j].set(values)


@eqx.filter_jit
def _softened(like: Softening, units: Array, prepared: Any) -> Array:
    """Outputs (units, samples) of softening with each of the weights."""

    def one(unit: Array) -> Array:
        return eqx.tree_at(lambda model: model.weights, like, unit).evaluate(prepared)

    return jax.vmap(one)(units)
