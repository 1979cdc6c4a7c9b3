"""What the unknowns of a composed model stand for, and the columns they multiply.

The model is a sum of parts that are linear in non-negative unknowns (but for the offset's sign):

    y = offset + curve(u) + Maxwell branches + their strengths + softening + relays

Each part rises with its input by construction, but for the strengths; so does a sum of them.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float, Int

from hysteresis import (
    AbstractModel,
    MonotoneCurve,
    NonlinearMaxwell,
    Preisach,
    Record,
    Series,
    Softening,
    Sum,
)
from hysteresis.curves import Clip
from hysteresis.preisach import GridDensity, Initial

from ._preisach_design import NodeSpace, design_rows

CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS = (
    "curve",
    "Maxwell",
    "strengths",
    "softening",
    "relays",
)
PARTS = (CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS)
CELLS = {CURVE: 40, MAXWELL: 12, STRENGTHS: 18, SOFTENING: 12, RELAYS: 24}
"""Cells of each part's even grid on the input's range."""

FIRMNESS = {CURVE: 1.0, MAXWELL: 10.0, STRENGTHS: 0.1, SOFTENING: 10.0, RELAYS: 10.0}
"""How much stronger the prior holds a part than the curve."""

RIDGE = 1e-7
"""Pulls what the data leave open to 0; in squares of the output's range."""

Columns = Float[np.ndarray, "rows unknowns"]


class Composition(NamedTuple):
    """Which parts there are and what they are made of; unknowns in the order offset, then `parts`.

    - `low`, `high`: range of the input. `scale`: the unknowns are in this unit of the output.
    - `times`: relaxation times, shared by the branches and their strengths.
    - `leading`, `initial`: orientation of all parts, and the relays before the first sample.
    - `floor`: the output never falls below it (slack); None for no such limit.
    """

    parts: tuple[str, ...]
    low: float
    high: float
    scale: float
    times: tuple[float, ...]
    leading: bool
    initial: Initial
    floor: float | None = None

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of unknowns of the offset and of each part."""
        n, branches = CELLS, len(self.times)
        of = {
            CURVE: n[CURVE],
            MAXWELL: branches * n[MAXWELL],
            STRENGTHS: branches * (n[STRENGTHS] + 1),
            SOFTENING: n[SOFTENING] * (n[SOFTENING] + 1) // 2,
            RELAYS: n[RELAYS] * (n[RELAYS] + 1) // 2,
        }
        return (1, *(of[part] for part in self.parts))

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return sum(self.sizes)

    def where(self, parts: tuple[str, ...]) -> Int[np.ndarray, " some"]:
        """Places of the unknowns that a composition of these parts has too."""
        labels = np.repeat(["", *self.parts], self.sizes)
        return np.flatnonzero(np.isin(labels, ["", *parts]))

    def of(self, *parts: str) -> "Composition":
        """The same with some of the parts, in the same order."""
        return self._replace(parts=tuple(p for p in self.parts if p in parts))

    def prior(self, strength: float) -> Float[np.ndarray, "unknowns unknowns"]:
        """The matrix of the prior's squares: neighbouring increments alike, strengths bend little."""
        blocks = [np.zeros((1, 1))]
        for part, size in zip(self.parts, self.sizes[1:], strict=True):
            n = CELLS[part]
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
            blocks += [own * each + RIDGE * np.eye(len(each))] * branches
        return np.asarray(scipy.linalg.block_diag(*blocks))

    def columns(self, record: Record, rows: Int[np.ndarray, " rows"]) -> Columns:
        """The output of each unknown alone, in its unit, at some rows of a record."""
        starts = tuple(int(k) for k in record.starts)
        made = {
            CURVE: self._curve, MAXWELL: self._branches, STRENGTHS: self._strengths,
            SOFTENING: self._softening, RELAYS: self._relays,
        }  # fmt: skip
        found = [made[part](record, rows, starts) for part in self.parts]
        return np.hstack([np.ones((len(rows), 1)), *found])

    def model(self, x: Float[Array, " unknowns"] | np.ndarray) -> Sum | Series:
        """The model of the unknowns."""
        x = self.scale * jnp.asarray(x)
        splits = np.cumsum(self.sizes)[:-1]
        offset, *found = jnp.split(x, splits)
        values = dict(zip(self.parts, found, strict=True))
        curve = MonotoneCurve.even(self.low, self.high, values.pop(CURVE), offset[0])
        parts: list[AbstractModel] = [curve]
        for part, field in ((MAXWELL, "increments"), (STRENGTHS, "strengths")):
            if part in values:
                own = {field: values[part].reshape(len(self.times), -1)}
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
        whole = Sum(parts)
        return whole if self.floor is None else Series([whole, Clip(low=self.floor)])

    @property
    def total_names(self) -> tuple[str, ...]:
        """Names of the sums that tell a person what the parts do."""
        names = ["offset"]
        for part in self.parts:
            if part in (MAXWELL, STRENGTHS):
                names += [f"{part} {tau:.3g}" for tau in self.times]
            else:
                names.append(part)
        return tuple(names)

    @property
    def totals(self) -> Float[np.ndarray, "sums unknowns"]:
        """The sums as rows: a rise over the range, a mean strength, a mass of relays."""
        rows = [np.ones((1, 1))]
        for part, size in zip(self.parts, self.sizes[1:], strict=True):
            branches = len(self.times) if part in (MAXWELL, STRENGTHS) else 1
            each = np.ones((1, size // branches))
            rows += [each / each.size if part == STRENGTHS else each] * branches
        return np.asarray(scipy.linalg.block_diag(*rows))

    # Columns of each part

    def _curve(self, record: Record, rows: np.ndarray, starts: tuple[int, ...]) -> Columns:
        units = jnp.eye(CELLS[CURVE])
        like = MonotoneCurve.even(self.low, self.high, units[0])
        return _outputs(like, "increments", units, record, starts)[rows]

    def _branches(self, record: Record, rows: np.ndarray, starts: tuple[int, ...]) -> Columns:
        units = jnp.eye(CELLS[MAXWELL])[:, None]
        return self._by_time("increments", units, record, rows, starts)

    def _strengths(self, record: Record, rows: np.ndarray, starts: tuple[int, ...]) -> Columns:
        units = jnp.eye(CELLS[STRENGTHS] + 1)[:, None]
        return self._by_time("strengths", units, record, rows, starts)

    def _by_time(
        self, field: str, units: Array, record: Record, rows: np.ndarray, starts: tuple[int, ...]
    ) -> Columns:
        found = []
        for tau in self.times:
            own = {"times": np.array([tau]), field: units[0]}
            like = NonlinearMaxwell(self.low, self.high, **own, leading=self.leading)
            found.append(_outputs(like, field, units, record, starts)[rows])
        return np.hstack(found)

    def _softening(self, record: Record, rows: np.ndarray, starts: tuple[int, ...]) -> Columns:
        n = CELLS[SOFTENING]
        units = jax.vmap(lambda unit: _upper(n, unit))(jnp.eye(n * (n + 1) // 2))
        like = Softening(self.low, self.high, units[0], leading=self.leading)
        return _outputs(like, "weights", units, record, starts)[rows]

    def _relays(self, record: Record, rows: np.ndarray, starts: tuple[int, ...]) -> Columns:
        n = CELLS[RELAYS]
        density = GridDensity(self.low, self.high, np.ones((n, n)))
        model = Preisach(density, np.ones(n), initial=self.initial)
        prepared = model.prepare(None, np.clip(record.input, self.low, self.high), starts=starts)
        B = design_rows(model, prepared)[rows]
        ramps, relays = np.split(NodeSpace(n).to_unknowns(B.toarray().T)[1:].T, [n], axis=1)
        i, j = np.tril_indices(n)
        return 2 * (ramps[:, i] + ramps[:, j]) - relays if self.leading else relays


def _upper(n: int, values: Array) -> Array:
    """An upper triangular matrix of its n (n + 1) / 2 entries, column by column."""
    j, i = np.tril_indices(n)
    return jnp.zeros((n, n), values.dtype).at[i, j].set(values)


def _outputs(
    like: AbstractModel, field: str, units: Array, record: Record, starts: tuple[int, ...]
) -> Columns:
    """Outputs (samples, units) of a part whose `field`, in which it is linear, takes each value."""
    prepared = like.prepare(record.time, record.input, starts=starts)
    return np.asarray(_evaluate_each(like, field, units, prepared)).T


@eqx.filter_jit
def _evaluate_each(like: Any, field: str, units: Array, prepared: Any) -> Array:
    def one(unit: Array) -> Array:
        return eqx.tree_at(lambda model: getattr(model, field), like, unit).evaluate(prepared)

    return jax.vmap(one)(units)
