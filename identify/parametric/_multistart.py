"""Non-linear least squares from many starts at once, the best one refined."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float, Int

from hysteresis import AbstractModel, Record

from ..parameters._transform import Transform
from ..results._fit_result import Starts

SPREADS = (1.5, 3.0, 6.0)
"""Standard deviation of the starts on the unconstrained scale: 1.5 is a factor of 4.5 for a positive one.
Wider where no output was finite: a density far outside the record vanishes in floating point."""

REFINED = 4
"""Starts that are followed to their end: after few steps the best is not always first."""


class Optimum(NamedTuple):
    """Free vector at the minimum, the objective (mean squared error) there, and whether it converged."""

    free: Float[np.ndarray, " parameters"]
    objective: float
    converged: bool
    steps: int


def refine(
    transform: Transform,
    model: AbstractModel,
    prepared: Any,
    y: Float[np.ndarray, " samples"],
    mask: Bool[np.ndarray, " samples"],
    free: Float[np.ndarray, " parameters"],
    steps: int = 200,
) -> Optimum:
    """Levenberg-Marquardt from one start to full accuracy, on the masked rows."""
    arguments = arguments_of(model, prepared, y, mask)
    z, objective, converged, taken = _run(transform, arguments, jnp.asarray(free), steps, 1e-10)
    objective = np.nan_to_num(objective, nan=np.inf)
    return Optimum(np.asarray(z), float(objective), bool(converged), int(taken))


def multi_start(
    transform: Transform,
    model: AbstractModel,
    prepared: Any,
    y: Float[np.ndarray, " samples"],
    mask: Bool[np.ndarray, " samples"],
    starts: Float[np.ndarray, "starts parameters"],
    few: int = 8,
    best: int = 8,
) -> Starts:
    """A few steps of Levenberg-Marquardt from every start, side by side, and the best to their end; sorted,
    best first.

    The steps are capped, since under `vmap` the slowest lane sets the pace.
    """
    arguments = arguments_of(model, prepared, y, mask)
    z, objective = _sorted(*_run_all(transform, arguments, jnp.asarray(starts), few))
    for k in range(min(best, len(z))):
        end = refine(transform, model, prepared, y, mask, z[k])
        if end.objective < objective[k]:
            z[k], objective[k] = end.free, end.objective
    z, objective = _sorted(z, objective)
    return Starts(objective, np.linalg.norm(z - z[0], axis=1), z)


def _sorted(z: Any, objective: Any) -> tuple[np.ndarray, np.ndarray]:
    """Best first, infinite where not finite."""
    objective = np.where(np.isfinite(objective), objective, np.inf)
    order = np.argsort(objective, kind="stable")
    return np.asarray(z)[order], objective[order]


def thinned_rows(record: Record, most: int) -> tuple[Int[np.ndarray, " rows"], tuple[int, ...]]:
    """About `most` rows of a record and the starts among them: enough to look for a start.

    Every k-th sequence is kept where there are many, then every k-th sample of each.
    """
    sequences = [rows for _, rows in record.sequences()]
    few = sequences[:: max(1, min(len(record) // most, len(sequences) // 8))]
    stride = -(-sum(rows.stop - rows.start for rows in few) // most)
    kept = [np.arange(rows.start, rows.stop, stride) for rows in few]
    starts = np.cumsum([0, *(len(rows) for rows in kept[:-1])])
    return np.concatenate(kept), tuple(int(k) for k in starts)


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
        time = np.append(time, time[-1] + step * np.arange(1, more + 1))
    return model.prepare(time, np.pad(u, (0, more), mode="edge"), starts=starts)


def longer(rows: Any) -> np.ndarray:
    """With as many zeros behind, rows that do not count."""
    return np.pad(rows, [(0, _missing(len(rows))), *[(0, 0)] * (np.ndim(rows) - 1)])


def _missing(rows: int) -> int:
    """To the next multiple of 64, above 512 of a quarter of the power of two before it."""
    step = max(64, 1 << (rows - 1).bit_length() >> 3)
    return -rows % step


def arguments_of(model: AbstractModel, prepared: Any, y: np.ndarray, mask: np.ndarray) -> tuple:
    """What `scaled_residuals` needs beside the free vector."""
    scale = np.ptp(y[mask]) or 1.0  # an array, so that another record does not compile again
    counted = np.where(mask, y, 0.0)
    return model, prepared, jnp.asarray(counted), jnp.asarray(mask), jnp.asarray(float(scale))


def scaled_residuals(transform: Transform, z: Array, arguments: Any) -> Array:
    """Residuals over the output's range and the root of the number of rows; see `arguments_of`."""
    model, prepared, y, mask, scale = arguments
    predicted = transform.model(model, z).evaluate(prepared)
    return jnp.where(mask, predicted - y, 0.0) / (scale * jnp.sqrt(mask.sum()))


def mean_squared_error(transform: Transform, z: Array, arguments: Any) -> Array:
    """The mean squared error at z."""
    return jnp.sum((arguments[-1] * scaled_residuals(transform, z, arguments)) ** 2)


def levenberg_marquardt(
    transform: Transform, arguments: Any, z: Array, steps: int, tolerance: float
) -> Any:
    """The solution from z, after at most so many steps."""
    return optimistix.least_squares(
        lambda z, arguments: scaled_residuals(transform, z, arguments),
        optimistix.LevenbergMarquardt(rtol=tolerance, atol=tolerance),
        z,
        args=arguments,
        max_steps=steps,
        throw=False,
    )


@eqx.filter_jit
def _run(
    transform: Transform, arguments: Any, z: Array, steps: int, tolerance: float
) -> tuple[Array, Array, Array, Array]:
    """Minimum, objective, convergence, steps taken."""
    solution = levenberg_marquardt(transform, arguments, z, steps, tolerance)
    end, converged = solution.value, solution.result == optimistix.RESULTS.successful
    return (
        end,
        mean_squared_error(transform, end, arguments),
        converged,
        solution.stats["num_steps"],
    )


@eqx.filter_jit
def _run_all(transform: Transform, arguments: Any, z: Array, steps: int) -> tuple[Array, Array]:
    """Minimum and objective from every start."""

    def one(z: Array) -> tuple[Array, Array]:
        end = levenberg_marquardt(transform, arguments, z, steps, 1e-6).value
        return end, mean_squared_error(transform, end, arguments)

    return jax.vmap(one)(z)
