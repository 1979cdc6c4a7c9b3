"""Many records of one shape and one model of few parameters, fitted side by side by one `vmap`."""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from hysteresis import AbstractModel, InputError, Record, check_identifiable

from ..fitting._parametric import ParametricCandidate
from ..fitting._verdict import judge
from ..noise._model import NoiseModel, rows_of
from ..noise._residual_statistics import Noise
from ..parameters._settings import Settings
from ..parameters._transform import Transform, transform_for
from ..parametric._maximum_likelihood import skewness_at
from ..parametric._multistart import (
    REFINED,
    SPREADS,
    STEPS,
    levenberg_marquardt,
    scaled_residuals,
    thinned_rows,
)
from ..parametric._standard_errors import covariance_of, reported, rescaled, statuses
from ..records._folds import Parts
from ..records._run_model import predict, prepare
from ..results._fit_result import FitResult, Starts
from ..results._goodness_of_fit import evidence

MEMORY = 2**28
"""Bytes that the searches side by side may take, as far as is known of them: 256 MB."""

LARGEST = 1024
"""Records side by side, at most: more are no faster."""

SAID = "Fitted side by side with others: no part of its rows was held out, so it has no score."


class Problem(NamedTuple):
    """A record and the model it starts from.

    - `suggests`: the search starts from what the record suggests too.
    - `settings`: what the user said of the parameters. `structure`: that of the template.
    """

    record: Record
    template: AbstractModel
    suggests: bool
    settings: Settings
    structure: Hashable

    @property
    def bounds(self) -> Transform:
        """The transform between unconstrained and physical parameters."""
        return transform_for(self.template, self.record, self.settings).for_fit


class Solved(NamedTuple):
    """Fits of like-shaped records as plain arrays, one entry for each.

    - `scale`: that of the `Transform` used.
    - `free`, `triangle`: the free vector at the minimum; R of J = QR, J the residuals' Jacobian there.
    - `values`, `slope`: the parameters, and d value / d free.
    - `squares`, `fourths`, `rows`: sums of powers of the residuals, infinite where no start
      had a finite output; how many rows.
    - `objective`, `points`: mean squared error and free vector of every start, best first.
    """

    scale: Float[np.ndarray, "records parameters"]
    free: Float[np.ndarray, "records parameters"]
    triangle: Float[np.ndarray, "records parameters parameters"]
    values: Float[np.ndarray, "records parameters"]
    slope: Float[np.ndarray, "records parameters"]
    squares: Float[np.ndarray, " records"]
    fourths: Float[np.ndarray, " records"]
    rows: Int[np.ndarray, " records"]
    converged: Bool[np.ndarray, " records"]
    objective: Float[np.ndarray, "records starts"]
    points: Float[np.ndarray, "records starts parameters"]

    def sigma(self, k: int) -> float:
        """Size of the residuals of the k-th, independent and Gaussian: the restricted likelihood's."""
        return float(np.sqrt(self.squares[k] / max(self.rows[k] - self.free.shape[1], 1)))

    def covariance(self, k: int) -> Float[np.ndarray, "parameters parameters"]:
        """Of the free vector of the k-th; with what `widening` adds, which is cosh(2 sd of log sigma)."""
        size = self.sigma(k) or 1.0
        scores = self.fourths[k] / size**4 - 2 * self.squares[k] / size**2 + self.rows[k]
        wider = np.cosh(2 / np.sqrt(1 + max(scores, 0.0)))
        return covariance_of(self.triangle[k], self.sigma(k) ** 2 * wider)


def kin(problem: Problem) -> Hashable:
    """A key that is equal for problems that one compiled program can fit."""
    record = problem.record
    return len(record), record.starts.tobytes(), record.time is None, problem.structure


def structure(model: AbstractModel) -> Hashable:
    """The static part of a model: everything but its arrays."""
    arrays, static = eqx.partition(model, eqx.is_array)
    shapes = tuple(np.shape(leaf) for leaf in jax.tree.leaves(arrays))
    return jax.tree.structure(arrays), shapes, eqx.tree_pformat(static)


def unfit(problems: Sequence[Problem]) -> dict[int, InputError]:
    """By their places, those of like-shaped records that cannot tell their model, and why.

    A record of ten rows for each parameter, whose output goes with its input, passes `check_identifiable`
    for certain; the others are asked one by one.
    """
    free = len(problems[0].bounds.names)
    data = _data([p.record for p in problems], np.arange(len(problems[0].record)))
    du, dy = (
        np.where(data.counted, x - np.mean(x, 1, where=data.counted, keepdims=True), 0.0)
        for x in (data.input, data.output)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = (du * dy).sum(1) / np.sqrt((du**2).sum(1) * (dy**2).sum(1))
    sure = (data.counted.sum(1) >= max(10 * free, 8)) & (np.abs(correlation) > 0.6)
    found = {}
    for k in np.flatnonzero(~(sure & data.counted.all(1))).tolist():
        try:
            check_identifiable(problems[k].record)
            check_identifiable(problems[k].record, n_parameters=free)
        except InputError as error:
            found[k] = error
    return found


def side_by_side(problem: Problem, starts: int) -> int:
    """Number of records of this shape to fit at a time."""
    rows, free = len(problem.record), len(problem.bounds.names)
    lane = 8 * (free + 6) * (min(rows, 1000) * (starts + 2) + rows * (REFINED + 2))
    return int(np.clip(MEMORY // lane, 1, LARGEST))


def fit_alike(problems: Sequence[Problem], starts: int, seed: int) -> Solved:
    """Fit problems that are `kin`, none of them `unfit`.

    Where the output goes straight with every parameter, as a linear sponge's, the sum of squares has one
    minimum and one step leads there. Else as `fit_parametric`: a short search from many starts on about a
    thousand rows, and the best ones refined on every row.
    """
    count = len(problems)
    # A number of records that was compiled before: the next power of two.
    padded = [
        problems[k] for k in np.resize(np.arange(count), 1 << (count - 1).bit_length()).tolist()
    ]
    records, rows = [p.record for p in padded], tuple(int(k) for k in problems[0].record.starts)
    models, bounds = _stacked([p.template for p in padded]), problems[0].bounds
    data = _data(records, np.arange(len(records[0])))
    scale = np.tile(bounds.scale, (len(padded), 1))
    templates = {id(p.template): p.template for p in padded}
    first = {key: bounds.to_free(template) for key, template in templates.items()}
    begin = np.stack([first[id(p.template)] for p in padded])
    straight, *found = _step(bounds, rows, models, data, scale, begin)
    points, converged = np.asarray(found[0])[:, None], np.ones(len(padded), bool)
    objective = np.asarray(found[-2])[:, None] / data.counted.sum(1, keepdims=True)
    if not np.all(np.asarray(straight)):
        scale = np.stack([p.bounds.scale for p in padded])
        objective, points = _searched(bounds, models, padded, scale, starts, seed)
        converged, *found = _refined(bounds, rows, models, data, scale, points[:, :REFINED])
    z, triangle, values, slope, *sums = (np.asarray(x)[:count] for x in found)
    squares, fourths = (np.where(np.isfinite(x), x, np.inf) for x in sums)
    return Solved(
        scale[:count], z, triangle, values, slope, squares, fourths,
        data.counted.sum(1)[:count], np.asarray(converged)[:count],
        objective[:count], points[:count],
    )  # fmt: skip


def result(problem: Problem, solved: Solved, k: int, seed: int) -> FitResult:
    """The k-th fit, as `identify.fit` returns it."""
    record, bounds = problem.record, problem.bounds._replace(scale=solved.scale[k])
    model = bounds.insert(problem.template, jnp.asarray(solved.values[k]))
    nothing = Parts(np.where(record.mask, 0, -1), (), None, "nothing held out")
    predicted = predict(model, record)
    left = evidence(record, nothing, predicted, False, np.nan, len(bounds.names))
    covariance, sigma = solved.covariance(k), solved.sigma(k)
    y = np.where(record.mask, record.output, 0.0)
    rows = rows_of(record, left.used, predicted)
    about = (problem.template, prepare(problem.template, record), y, rows)
    bent = skewness_at(bounds, about, NoiseModel(sigma), solved.free[k], covariance, 1.0)
    away = np.linalg.norm(solved.points[k] - solved.points[k][0], axis=1)
    noise_model = NoiseModel(sigma) if sigma > 0 else None
    fit = FitResult(
        name=type(model).__name__,
        model=model,
        parameters=reported(model, bounds, solved.free[k], covariance, record, bent),
        covariance=rescaled(covariance, solved.slope[k]),
        residuals=left.residuals,
        metrics=left.metrics,
        success=bool(solved.converged[k]),
        score=left.score,
        noise=Noise(sigma, int(solved.rows[k]), 1.0),
        noise_model=noise_model,
        noise_evidence={} if noise_model is None else {noise_model.words: 0.0},
        settings=problem.settings,
        train=record,
        starts=Starts(solved.objective[k], away, solved.points[k]),
        notes=(SAID,),
        used=left.used,
        seed=seed,
    )
    fit = replace(fit, verdict=judge(fit, tuple(check_identifiable(record))))
    return replace(fit, candidates=(fit,))


def errors_and_statuses(bounds: Transform, solved: Solved) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors, in the parameters' units, and statuses of all fits."""
    covariances = [np.diagonal(solved.covariance(k)) for k in range(len(solved.free))]
    error = np.sqrt(covariances)
    return error * np.abs(solved.slope), statuses(bounds, solved.free, error)


class _Data(NamedTuple):
    """Columns of like-shaped records, (records, rows), and the output's range, (records,)."""

    time: np.ndarray | None
    input: np.ndarray
    output: np.ndarray
    counted: np.ndarray
    size: np.ndarray


def _data(records: Sequence[Record], rows: np.ndarray) -> _Data:
    u, y, counted = (
        np.stack([getattr(r, n)[rows] for r in records]) for n in ("input", "output", "mask")
    )
    time = (
        None
        if records[0].time is None
        else np.stack([r.time[rows] for r in records if r.time is not None])
    )
    high, low = (np.where(counted, y, -s * np.inf) for s in (1, -1))
    size = high.max(1) - low.min(1)
    return _Data(time, u, np.where(counted, y, 0.0), counted, np.where(size > 0, size, 1.0))


def _stacked(models: list[AbstractModel]) -> Any:
    """The models stacked into one, with a leading axis on every array."""
    arrays = [eqx.partition(model, eqx.is_array) for model in models]
    stacked = jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *(a for a, _ in arrays))
    return eqx.combine(stacked, arrays[0][1])


def _searched(
    bounds: Transform,
    models: Any,
    problems: list[Problem],
    scale: np.ndarray,
    starts: int,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Objective and free vector of every start, best first; it draws wider starts if none was finite."""
    begin = np.stack([_begin(p) for p in problems])
    # Rows that all records keep: the turning points of one are not those of another.
    rows, thin_starts = thinned_rows(problems[0].record, 1000, turning=False)
    thin = _data([p.record for p in problems], rows)
    random = np.random.default_rng(seed).normal(0, 1, (starts, begin.shape[2]))
    random[0] = 0.0
    objective = np.full((len(problems), starts + begin.shape[1] - 1), np.inf)
    points = np.zeros((*objective.shape, begin.shape[2]))
    for spread in SPREADS:
        lost = ~np.isfinite(objective).any(1)
        if not lost.any():
            break
        tried = np.concatenate([begin[:, :1] + spread * random, begin[:, 1:]], axis=1)
        z, f = map(np.asarray, _search(bounds, thin_starts, models, thin, scale, tried))
        f = np.where(np.isfinite(f), f, np.inf)
        order = np.argsort(f, axis=1, kind="stable")
        objective[lost] = np.take_along_axis(f, order, 1)[lost]
        points[lost] = np.take_along_axis(z, order[..., None], 1)[lost]
    return objective, points


def _begin(problem: Problem) -> np.ndarray:
    """Free vectors of the template, and of the model that the record suggests."""
    template, other = problem.template, None
    if problem.suggests:
        kind = type(template)
        other = ParametricCandidate(kind.__name__, kind, template).suggested(problem.record)
    return problem.bounds.points_of(template, other)


@eqx.filter_jit
def _step(
    bounds: Transform, rows: tuple[int, ...], models: Any, data: _Data, scale: Any, free: Any
) -> Any:
    """Whether residuals are straight in every parameter, and `_end` where their squares are least."""

    def one(model: Any, data: _Data, scale: Array, z: Array) -> Any:
        own, arguments = _arguments(bounds, rows, model, data, scale)

        def residuals(z: Array) -> Array:
            return scaled_residuals(own, z, arguments)[0]

        r, J = residuals(z), jax.jacfwd(residuals)(z)
        straight = jnp.asarray(True)
        for away in np.random.default_rng(0).normal(0, 1.5, (3, z.size)):
            bent = residuals(z + away) - r - jnp.sum(J * away[None], axis=1)
            large = jnp.max(jnp.sum(jnp.abs(J * away[None]), axis=1) + jnp.abs(r))
            straight &= jnp.max(jnp.abs(bent)) <= 1e-11 * large  # rounding; False where not finite
        upper = _triangle(jnp.concatenate([J, r[:, None]], 1))
        least = z - jnp.linalg.pinv(upper[: z.size, : z.size]) @ upper[: z.size, -1]
        return straight, *_end(
            own, arguments, least, residuals(least), jax.jacfwd(residuals)(least)
        )

    return jax.vmap(one)(models, data, scale, free)


@eqx.filter_jit
def _search(
    bounds: Transform, rows: tuple[int, ...], models: Any, data: _Data, scale: Any, points: Any
) -> Any:
    def one(model: Any, data: _Data, scale: Array, points: Array) -> Any:
        own, arguments = _arguments(bounds, rows, model, data, scale)

        def from_(z: Array) -> tuple[Array, Array]:
            end = levenberg_marquardt(own, arguments, z, 40)
            return end.free, jnp.sum((data.size * end.residuals) ** 2)

        return jax.vmap(from_)(points)

    return jax.vmap(one)(models, data, scale, points)


@eqx.filter_jit
def _refined(
    bounds: Transform, rows: tuple[int, ...], models: Any, data: _Data, scale: Any, points: Any
) -> Any:
    """Whether the best of several points converged, and `_end` there."""

    def one(model: Any, data: _Data, scale: Array, points: Array) -> Any:
        own, arguments = _arguments(bounds, rows, model, data, scale)

        ends = jax.vmap(lambda z: levenberg_marquardt(own, arguments, z, STEPS))(points)
        squares = jnp.nan_to_num(jnp.sum(ends.residuals**2, 1), nan=jnp.inf)
        best = jax.tree.map(lambda x: x[jnp.argmin(squares)], ends)
        return best.converged, *_end(own, arguments, best.free, best.residuals, best.jacobian)

    return jax.vmap(one)(models, data, scale, points)


def _arguments(
    bounds: Transform, rows: tuple[int, ...], model: Any, data: _Data, scale: Array
) -> tuple[Transform, Any]:
    """The arguments of `scaled_residuals` for one record."""
    prepared = model.prepare(data.time, data.input, starts=rows)
    arguments = model, prepared, data.output, data.counted, data.size
    return bounds._replace(scale=scale), arguments


def _end(bounds: Transform, arguments: Any, z: Array, r: Array, J: Array) -> tuple[Array, ...]:
    """z; R of the residuals' Jacobian, in the output's unit; the values, their slopes; sums of powers."""
    *_, counted, size = arguments
    unit = size * jnp.sqrt(counted.sum())
    squares, fourths = (jnp.sum((unit * r) ** k) for k in (2, 4))
    values, slope = jax.jvp(bounds.to_values, (z,), (jnp.ones_like(z),))
    return z, _triangle(unit * J), values, slope, squares, fourths


def _triangle(A: Float[Array, "rows columns"]) -> Float[Array, "columns columns"]:
    """R of A = QR by modified Gram-Schmidt.

    With the residuals for a last column that solves least squares as stably as Householder's QR. Side by
    side it is faster than LAPACK, of which two calls at once can leave XLA's threads waiting for ever.

    Source: Bjorck, Solving linear least squares problems by Gram-Schmidt orthogonalization, BIT 7 (1967).
    """
    columns, rows = [*A.T], []
    for k in range(len(columns)):
        size = jnp.sqrt(jnp.sum(columns[k] ** 2))
        q = columns[k] / jnp.where(size > 0, size, 1.0)
        along = [jnp.zeros(())] * k + [size] + [jnp.sum(q * a) for a in columns[k + 1 :]]
        columns = columns[: k + 1] + [
            a - x * q for a, x in zip(columns[k + 1 :], along[k + 1 :], strict=True)
        ]
        rows.append(jnp.stack(along))
    return jnp.stack(rows)
