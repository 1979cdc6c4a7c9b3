"""Non-linear least squares from many starts, on few rows until the best optimum is known."""

import time
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from hysteresis import AbstractModel, Record
from hysteresis.numerics._even_clock import even_step

from .._levels import MUCH, NOTHING, STEPS
from ..parameters._transform import Transform
from ..results._fit_result import Starts
from ._levenberg_marquardt import Found
from ._levenberg_marquardt import least_squares as levenberg_marquardt_from

SPREADS = MUCH * 2.0 ** np.arange(3)
"""Standard deviation of the starts on the unconstrained scale: 1.5 is a factor of 4.5 for a positive one.
Wider where no output was finite: a density far outside the record vanishes in floating point."""

FEW = BEST = 8
"""Steps from every start, and starts that then go on to their end: after few steps the best one is not
always first."""


class Optimum(NamedTuple):
    """Free vector at the minimum, the objective (mean squared error) there, and whether it converged.

    - `predicted`: the output of every row. `jacobian`: its derivative, 0 where a row does not count.
    """

    free: Float[np.ndarray, " parameters"]
    objective: float
    converged: bool
    predicted: Float[np.ndarray, " samples"]
    jacobian: Float[np.ndarray, "samples parameters"]


class Problem(NamedTuple):
    """A model, of which the parameters of `bounds` move, what it is run over, and what was measured there.

    A row whose weight is 0 does not count.
    """

    bounds: Transform
    template: AbstractModel
    prepared: Any
    measured: Float[np.ndarray, " samples"]

    def arguments(self, weights: Float[np.ndarray, " samples"]) -> tuple[Any, ...]:
        """What `scaled_residuals` needs beside the free vector."""
        mask, y = weights > 0, self.measured
        scale = np.ptp(y[mask]) or 1.0  # an array, so that another record does not compile again
        y, scale = np.where(mask, y, 0.0), np.asarray(float(scale))
        return self.template, self.prepared, y, np.asarray(weights), scale

    def refined(
        self,
        weights: Float[np.ndarray, " samples"],
        free: Float[np.ndarray, " parameters"],
        steps: int = STEPS,
    ) -> Optimum:
        """Levenberg-Marquardt from one start to full accuracy; one step only evaluates."""
        arguments = self.arguments(weights)
        found = _run(self.bounds, arguments, jnp.asarray(free), np.asarray(steps))
        size = float(arguments[-1]) * float(np.sqrt(np.count_nonzero(weights)))
        each = size / np.where(weights > 0, weights, 1.0)
        residuals = np.asarray(found.residuals)
        objective = np.nan_to_num(
            float(arguments[-1]) ** 2 * float(residuals @ residuals), nan=np.inf
        )
        return Optimum(
            np.asarray(found.free), float(objective), bool(found.converged),
            np.asarray(found.beside), each[:, None] * np.asarray(found.jacobian),
        )  # fmt: skip

    def searched(
        self,
        weights: Float[np.ndarray, " samples"],
        starts: Float[np.ndarray, "starts parameters"],
        until: float = np.inf,
    ) -> tuple[Starts, tuple[Optimum, ...]]:
        """A few steps of Levenberg-Marquardt from every start, and the best to their end; best first.

        Also the optima that are different. After `until` no further one is begun.
        """
        ends = list[Optimum]()
        for z in starts:
            if ends and time.perf_counter() > until:
                break
            ends.append(self.refined(weights, z, FEW))
        ends.sort(key=lambda end: end.objective)
        for k in range(min(BEST, len(ends))):
            if k and time.perf_counter() > until:
                break
            if np.isfinite(ends[k].objective) and not ends[k].converged:
                ends[k] = self.refined(weights, ends[k].free)
        ends.sort(key=lambda end: end.objective)
        # Of optima that explain alike the nearest one: what the record does not tell stays where the first
        # start has it, not where rounding ends.
        alike = [
            k for k, end in enumerate(ends)
            if end.converged and end.objective <= (1 + NOTHING) * ends[0].objective
        ]  # fmt: skip
        if alike:
            nearest = min(alike, key=lambda k: float(np.linalg.norm(ends[k].free - starts[0])))
            ends.insert(0, ends.pop(nearest))
        objective, z = (
            np.array([end.objective for end in ends]),
            np.stack([end.free for end in ends]),
        )
        optima: list[Optimum] = []
        for end in ends[:BEST]:
            if all(end.objective > (1 + NOTHING) * other.objective for other in optima):
                optima.append(end)
        return Starts(objective, np.linalg.norm(z - z[0], axis=1), z), tuple(optima)


def thinned_rows(record: Record, most: int) -> tuple[Int[np.ndarray, " rows"], tuple[int, ...]]:
    """About `most` rows of a record and the starts among them: enough to look for a start.

    Every k-th sequence is kept where there are many. Of each, blocks of rows give those of the least and
    the greatest input, so that turning points stay. Up to twice `most` all are kept.
    """
    sequences = [rows for _, rows in record.sequences()]
    if len(record) <= 2 * most:
        return np.arange(len(record)), tuple(rows.start for rows in sequences)
    few = sequences[:: max(1, min(len(record) // most, len(sequences) // 8))]
    stride = -(-sum(rows.stop - rows.start for rows in few) // most)
    kept = [rows.start + _extremes(record.input[rows], 2 * stride) for rows in few]
    starts = np.cumsum([0, *(len(rows) for rows in kept[:-1])])
    return np.concatenate(kept), tuple(int(k) for k in starts)


def _extremes(u: Float[np.ndarray, " rows"], width: int) -> Int[np.ndarray, " extremes"]:
    """The first row, and those of the least and the greatest input of every block of so many rows."""
    blocks = np.pad(u, (0, -len(u) % width), mode="edge").reshape(-1, width)
    begin = width * np.arange(len(blocks))
    return np.unique(np.concatenate([[0], begin + blocks.argmin(1), begin + blocks.argmax(1)]))


def prepared_longer(
    model: AbstractModel,
    time: Float[np.ndarray, " rows"] | None,
    u: Float[np.ndarray, " rows"],
    starts: tuple[int, ...],
) -> Any:
    """`model.prepare` with a few rows behind the last one, in which the input rests and the clock goes on.

    Of all numbers of rows few are left, so that a fit finds what the fit of another record compiled. Models
    are causal: what comes before does not change. What is measured is made as long by `longer`.
    """
    more = _missing(len(u))
    if time is not None:
        step = time[-1] - time[-2] if len(time) - starts[-1] > 1 else 1.0
        if (even := even_step(time, starts)) is not None:
            # Without the rounding of its print, so that the clock is even with the rows behind, too.
            first, step = np.asarray(starts), even
            lengths = np.diff(np.append(first, len(time)))
            time = np.repeat(time[first], lengths) + even * (
                np.arange(len(time)) - np.repeat(first, lengths)
            )
        time = np.append(time, time[-1] + step * np.arange(1, more + 1))
    return model.prepare(time, np.pad(u, (0, more), mode="edge"), starts=starts)


def longer(rows: Any) -> np.ndarray:
    """With as many zeros behind, rows that do not count."""
    return np.pad(rows, [(0, _missing(len(rows))), *[(0, 0)] * (np.ndim(rows) - 1)])


def _missing(rows: int) -> int:
    """To the next multiple of 64, above 512 of a quarter of the power of two before it."""
    step = max(64, 1 << (rows - 1).bit_length() >> 3)
    return -rows % step


def scaled_residuals(transform: Transform, z: Array, arguments: Any) -> tuple[Array, Array]:
    """Residuals over the output's range and the root of the number of rows, and the output itself; see
    `Problem.arguments`."""
    model, prepared, y, weights, scale = arguments
    predicted, mask = transform.model(model, z).evaluate(prepared), weights > 0
    off = weights * jnp.where(mask, predicted - y, 0.0)
    return off / (scale * jnp.sqrt(mask.sum())), predicted


def levenberg_marquardt(transform: Transform, arguments: Any, z: Array, limit: Any) -> Found:
    """The solution from z, after at most so many steps."""
    return levenberg_marquardt_from(
        lambda z, arguments: scaled_residuals(transform, z, arguments),
        z, arguments, (arguments[3] > 0).sum(), limit,
    )  # fmt: skip


_run = eqx.filter_jit(levenberg_marquardt)
