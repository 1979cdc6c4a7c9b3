"""Fitting a model of few parameters: many starts, refinement, held-out score, honest errors."""

from collections.abc import Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, InputError, Record, parameters
from hysteresis.numerics._normal import NORMAL_95

from ..noise._adequacy import BELIEVED, nothing_speaks_against
from ..noise._model import NoiseModel, Rows, rows_of
from ..noise._reml import Linearised, kinds
from ..parameters._settings import Settings
from ..parameters._transform import Transform, transform, transform_for
from ..parametric._interval_skewness import Skewness
from ..parametric._maximum_likelihood import Likeliest, likeliest, linearised, plainest, skewness_at
from ..parametric._multistart import (
    Optimum,
    longer,
    multi_start,
    prepared_longer,
    refine,
    thinned_rows,
)
from ..records._folds import Parts, block_errors
from ..records._run_model import predict, starts_of
from ..results._fit_result import FitResult, Parameter, Status
from ..results._goodness_of_fit import evidence

SPREADS = (1.5, 3.0, 6.0)
"""Standard deviation of the starts in the free space, 1.5 a factor of 4.5 for a positive parameter. Wider
where no output was finite: a density far outside the record vanishes in floating point."""

REFINED = 4
"""Starts that are followed to their end: after few steps the best is not always first."""

EXACT = 1e-8
"""Residuals, of the output's range, below which they are not noise but the solver's tolerance."""


def fit_parametric(
    name: str,
    template: AbstractModel,
    record: Record,
    parts: Parts,
    starts: int = 32,
    seed: int = 0,
    suggested: AbstractModel | None = None,
    noise: str | None = "auto",
    settings: Settings | None = None,
) -> FitResult:
    """Fit the free parameters of `template`, numbers and short arrays: least squares, then likelihood.

    The search for a start runs on about a thousand rows, side by side, from `template`, from others about
    it and from the model that the record suggests, if one is given and has the same parameters; the best
    starts are refined on every row. A conditioning cycle is left out where that predicts the held-out one
    better. From there the maximum of the likelihood is sought under the kind of `noise` that the residuals
    show, see `likeliest`. Where none explains them, because they are coloured otherwise or follow the
    input, or with `noise` None, least squares stays, and its errors are widened by the residuals'
    correlation time.

    Raises `InputError` where no start gives a finite output.
    """
    y = np.where(record.mask, record.output, 0.0)
    bounds = transform_for(template, record, settings).for_fit
    rows, thin_starts = thinned_rows(record, 1000)
    time = None if record.time is None else record.time[rows]
    thin = prepared_longer(template, time, record.input[rows], thin_starts)
    thin_y, thin_mask = longer(y[rows]), longer(record.mask[rows])
    first = bounds.to_free(template)[None]
    if suggested is not None and transform(suggested, 1.0).names == bounds.names:
        first = np.vstack([first, bounds.to_free(suggested)])
    random = np.random.default_rng(seed).normal(0, 1, (starts, first.shape[1]))
    random[0] = 0.0
    for spread in SPREADS:
        points = np.vstack([first[0] + spread * random, first[1:]])
        tried = multi_start(bounds, template, thin, thin_y, thin_mask, points)
        if np.isfinite(tried.objective[0]):
            break
    else:
        raise InputError(
            "no-finite-start",
            f"the data are finite; the model is not, from any of {starts} starts about the one given.",
            cause="a parameter of the start is many times too large or too small.",
            fix="give a model to start from whose output is finite over the record.",
        )
    prepared = prepared_longer(template, record.time, record.input, starts_of(record))
    measured = longer(y)

    def fitted(which: tuple[int, ...], free: np.ndarray) -> Optimum:
        counted = longer(np.isin(parts.label, which))
        return refine(bounds, template, prepared, measured, counted, free)

    ends = [fitted(parts.all, free) for free in tried.free[:REFINED]]
    begin = min(ends, key=lambda end: end.objective).free
    blocks: dict[bool, np.ndarray] = {}
    for drop in (False,) if parts.conditioning is None else (False, True):
        squares = []
        for fold in parts.folds:
            train = parts.without_conditioning(fold.train, drop)
            z = fitted(train, begin).free
            test = np.isin(parts.label, fold.test)
            error = predict(_model(bounds, template, z), record)[test] - y[test]
            squares += block_errors(error)
        blocks[drop] = np.array(squares)
    dropped = min(blocks, key=lambda drop: blocks[drop].mean())
    which = parts.without_conditioning(parts.all, dropped)
    optimum = fitted(which, begin)
    model = _model(bounds, template, optimum.free)

    held_out = float(blocks[dropped].mean())
    predicted = predict(model, record)
    left = evidence(record, parts, predicted, dropped, held_out, len(bounds.names))
    rows = Rows(*(jnp.asarray(longer(x)) for x in rows_of(record, left.used, predicted)))
    about = (bounds, template, prepared, measured, rows, optimum.free)
    arguments = (template, prepared, jnp.asarray(measured), rows)
    at = linearised(bounds, jnp.asarray(optimum.free), arguments)
    found = None
    if noise is not None and not bounds.asked:
        found = _plainest(optimum.free, at, noise)
    if noise is not None and found is None:
        found = likeliest(*about, kinds(noise))
    weighed = {} if found is None else found.over_the_best
    noise_model, size = None, left.noise
    if found is not None and (found.believed > BELIEVED or noise != "auto"):
        noise_model, size, widened = found.noise, found.summary(), 1.0
    else:
        widened = left.noise.correlation_time
        # What is asked of the parameters weighs against as many facts as are independent.
        found = likeliest(*about, kinds("gaussian"), widened) if bounds.asked else None
    if found is None:
        free = optimum.free
        covariance = _covariance(np.asarray(at.jacobian), left.noise.sigma**2 * widened)
        taken, wider = NoiseModel(left.noise.sigma), np.ones_like(free)
    else:
        free, covariance = found.free, _covariance(found.root, widened)
        taken, wider = found.noise, found.wider
        model = _model(bounds, template, free)
        left = evidence(record, parts, predict(model, record), dropped, held_out, len(free))
    bent = skewness_at(bounds, arguments, taken, free, covariance, 1 / widened)
    covariance = _scaled(covariance, wider)
    return FitResult(
        name=name,
        model=model,
        parameters=_parameters(model, bounds, free, covariance, record, bent),
        covariance=_scaled(covariance, bounds.slope(free)),
        residuals=left.residuals,
        metrics=left.metrics,
        success=optimum.converged or (found is not None and found.converged and bounds.asked),
        score=left.score,
        blocks=blocks[dropped],
        noise=size if noise_model is not None else left.noise,
        noise_model=noise_model,
        noise_evidence=weighed,
        settings=settings or {},
        train=record,
        starts=tried,
        notes=left.notes,
        internals={"used": left.used},
        seed=seed,
    )


def _plainest(free: np.ndarray, at: Linearised, noise: str) -> Likeliest | None:
    """Independent Gaussian noise, where it is asked for, nothing speaks against it, or the residuals are
    the solver's tolerance."""
    found, left = plainest(free, np.asarray(at.residuals), np.asarray(at.jacobian), at.rows)
    size = np.ptp(np.asarray(at.rows.output)[np.asarray(at.rows.counted)])
    asked = noise == "gaussian" or found.noise.sigma < EXACT * size
    return found if asked or (noise == "auto" and nothing_speaks_against(left, at.rows)) else None


def _model(bounds: Transform, template: Any, z: np.ndarray) -> Any:
    return bounds.insert(template, bounds.to_values(z))


def _covariance(jacobian: np.ndarray, variance: float) -> np.ndarray:
    """variance (J'J)^-1 of the free vector; directions the data do not see get infinite variance."""
    _, size, V = np.linalg.svd(jacobian, full_matrices=False)
    seen = size > 1e-10 * size.max(initial=1e-300)
    inverse = np.where(seen, 1 / np.where(seen, size, 1.0) ** 2, np.inf)
    with np.errstate(invalid="ignore"):
        blind = (V[~seen] ** 2).sum(0) > 1e-12
        covariance = (V[seen].T * inverse[seen]) @ V[seen] * variance
    covariance[blind, blind] = np.inf
    return covariance


def _scaled(covariance: np.ndarray, slope: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return covariance * slope[:, None] * slope


def _parameters(
    model: AbstractModel,
    bounds: Transform,
    z: np.ndarray,
    covariance: np.ndarray,
    record: Record,
    bent: Skewness,
) -> tuple[Parameter, ...]:
    """Values with honest errors: none at a bound, none where the data cannot tell.

    A positive parameter whose logarithm is uncertain by more than 2 (a factor of 7), or that ran off by
    more than a factor of a million from the others, is not identified; it acts as a limit (0 or
    infinity) there.
    """
    found = []
    words = model.unit_words(record.input_unit, record.output_unit, record.time_unit)
    for name, unit, value in _numbers(model, words):
        if name not in bounds.names:
            found.append(Parameter(name, value, unit, None, "fixed"))
            continue
        k = bounds.names.index(name)
        error = float(np.sqrt(covariance[k, k]))
        bounded = np.isfinite(bounds.low[k]) or np.isfinite(bounds.high[k])
        two_sided = np.isfinite(bounds.low[k]) and np.isfinite(bounds.high[k])
        status: Status = "free"
        # The distance from a bound other than 0, on the bound's own scale.
        end = bounds.low[k] if np.isfinite(bounds.low[k]) else bounds.high[k]
        near = bounded and end != 0 and np.exp(z[k]) < 1e-3 * abs(end)
        if abs(z[k]) > 7 if two_sided else near:
            status = "at bound"
        elif not np.isfinite(error) or (bounded and error > 2):
            status = "unidentified"
        slope = float(bounds.slope(z)[k])
        if status != "free":
            found.append(Parameter(name, value, unit, None, status))
            continue
        lean = bent.displaced(NORMAL_95)[k]
        ends = [z + np.eye(len(z))[k] * error * (lean + side) for side in (-NORMAL_95, NORMAL_95)]
        low, high = (float(bounds.to_values(end)[k]) for end in ends)
        found.append(Parameter(name, value, unit, error * abs(slope), status, low, high))
    return tuple(found)


def _numbers(model: AbstractModel, words: dict[str, str]) -> Iterator[tuple[str, str, float]]:
    """Name, unit and value of every number among the parameters, named as in `Transform`."""
    for name, info, value in parameters(model):
        if value is None or value.ndim > 1:
            continue
        for k, number in enumerate(np.ravel(value)):
            yield name if value.ndim == 0 else f"{name}.{k}", info.in_units(words), float(number)
