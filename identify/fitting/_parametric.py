"""Fitting a model of few parameters: many starts, refinement, held-out score, noise, standard errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import AbstractModel, InputError, Preisach, Scaled
from hysteresis.preisach import GaussianDensity, GridDensity, LorentzianDensity
from hysteresis.preisach._density import AbstractDensity, SumDensity
from hysteresis.records._excitation import check_rows

from .._levels import CHANCE, COARSE, LITTLE, ROUNDING, SOME_ROWS, STEPS
from ..linear._preisach_fit import fit_preisach
from ..noise._arithmetic import Rows
from ..noise._model import NoiseModel, nothing_speaks_against, rows_of
from ..noise._reml import Linearised, kinds
from ..parameters._settings import Settings, with_settings
from ..parameters._transform import Transform, transform_for
from ..parametric._maximum_likelihood import (
    Likeliest,
    likeliest,
    linearised,
    linearised_at,
    plainest,
    skewness_at,
)
from ..parametric._multistart import (
    FEW,
    SPREADS,
    Optimum,
    Problem,
    longer,
    prepared_longer,
    thinned_rows,
)
from ..parametric._standard_errors import covariance_of, reported, rescaled
from ..records._folds import Parts, earned, held_out_errors
from ..records._new_record import starts_of
from ..results._fit_result import FitResult, Starts
from ..results._goodness_of_fit import Evidence, evidence
from ._training_data import Candidate, Options, TrainingData, Trial

# Preisach models whose density has few parameters: where their fits start, from the weights of a grid.

INCREMENTS = 8
"""Equal steps of the input over which the reversible part rises by a parameter each. More of them raise the
held-out error of measured loops, because each is a parameter beside a density of four or eight."""

ORDER = 12
"""Of the quadrature while a Gaussian density is fitted and used: errors of 1e-7 of the output's range."""

NEAR = 2.0
"""Cells from the diagonal within which relays of a grid count as reversible: a narrow loop and none are
alike to its cells."""


class Moments(NamedTuple):
    """Mass of relays, and mean and standard deviation of their coercivity and bias."""

    mass: float
    coercivity: float
    coercivity_width: float
    bias: float
    bias_width: float


class _MadeOfMoments(Protocol):
    def __call__(self, low: float, high: float, found: Moments) -> AbstractDensity: ...


def _gaussian(low: float, high: float, found: Moments) -> AbstractDensity:
    return GaussianDensity(low, high, *found, order=ORDER)


def _lorentzian(low: float, high: float, found: Moments) -> AbstractDensity:
    """Half widths are half of the deviations, which tails determine."""
    mass, h, h_width, m, m_width = found
    return LorentzianDensity(low, high, mass, h, h_width / 2, m, m_width / 2)


class Shape(NamedTuple):
    """A density of `count` equal parts, each of which `made` makes of moments."""

    made: _MadeOfMoments
    count: int = 1


SHAPES = {
    "GaussianPreisach": Shape(_gaussian),
    "TwoGaussianPreisach": Shape(_gaussian, 2),
    "LorentzianPreisach": Shape(_lorentzian),
}
"""Names of Preisach models with few parameters, and their densities."""


def starts_of_shape(name: str, data: TrainingData, initial: str) -> tuple[Preisach, ...]:
    """Models of few parameters to start from, all of one structure.

    A grid is fitted, and the moments of its weights are those of the parts. If the output falls, all are of
    its negative.
    """
    known = tuple(word for word in data.initials if word != "fit") or ("negative",)
    states = known if initial in ("auto", "fit") else (initial,)
    linear, _ = fit_preisach(data.rising, data.parts, data.leadings, states, (COARSE,))
    grid = linear.model
    assert isinstance(grid, Preisach)
    return of_grid(grid, SHAPES[name])


def of_grid(grid: Preisach, shape: Shape) -> tuple[Preisach, ...]:
    """Preisach models with densities of a few parameters, each with the moments of a grid's relays.

    Of two parts one start has the narrow and the wide loops, one those at low and at high inputs, and one a
    narrow and a wide distribution about the same centre. Relays near the diagonal join the reversible part.
    """
    density = grid.density
    assert isinstance(density, GridDensity)
    low, high, cells = density.low, density.high, density.cells
    masses, edges = np.tril(np.asarray(density.weights)), density.edges
    middle = (edges[1:] + edges[:-1]) / 2
    alpha, beta = np.meshgrid(middle, middle, indexing="ij")
    h, m = (alpha - beta) / 2, (alpha + beta) / 2
    far = np.tri(cells, k=-1, dtype=bool) & (2 * h > NEAR * (high - low) / cells)
    if not masses[far].sum() > 0:
        far = np.tri(cells, dtype=bool)
    least = LITTLE * (high - low)

    def moments(which: Bool[np.ndarray, "cells cells"]) -> Moments:
        weights = masses[which]
        total = float(weights.sum())
        if not total > 0:  # no relays there: as many as there are, everywhere
            return moments(far)
        means = [float(weights @ x[which]) / total for x in (h, m)]
        widths = [
            max(float(np.sqrt(weights @ (x[which] - mean) ** 2 / total)), least)
            for x, mean in zip((h, m), means, strict=True)
        ]
        return Moments(total, max(means[0], least), widths[0], means[1], widths[1])

    whole = moments(far)
    splits = [(whole,)]
    if shape.count == 2:
        halves = [far & (x <= mean) for x, mean in ((h, whole.coercivity), (m, whole.bias))]
        splits = [(moments(half), moments(far & ~half)) for half in halves]
        splits.append((_spread(whole, 0.5), _spread(whole, 1.5)))
    reversible = _reversible(grid, np.where(far, 0.0, masses), edges)
    densities = ([shape.made(low, high, part) for part in split] for split in splits)
    return tuple(
        Preisach(
            parts[0] if len(parts) == 1 else SumDensity(parts),
            reversible,
            float(grid.offset),
            leading=grid.leading,
            initial=grid.initial,
        )
        for parts in densities
    )


def _spread(found: Moments, factor: float) -> Moments:
    """Half of the relays, spread so many times as far about the same centre."""
    mass, h, h_width, m, m_width = found
    return Moments(mass / 2, h, factor * h_width, m, factor * m_width)


def _reversible(
    grid: Preisach,
    near: Float[np.ndarray, "cells cells"],
    edges: Float[np.ndarray, " nodes"],
) -> Float[np.ndarray, " increments"]:
    """Increments of the grid's reversible part and of the relays `near` its diagonal, over equal steps."""
    own = 0.0 if grid.reversible is None else np.asarray(grid.reversible)
    rises = np.broadcast_to(own + 2 * grid.orientation * near.sum(1), len(edges) - 1)
    level = np.interp(
        np.linspace(edges[0], edges[-1], INCREMENTS + 1), edges, np.append(0.0, np.cumsum(rises))
    )
    increments = np.diff(level)
    size = np.abs(increments).sum() or 1.0
    return np.maximum(increments, LITTLE * size)


@dataclass(frozen=True)
class ParametricCandidate(Candidate):
    """A model of few parameters; `shape` is the name of a Preisach density of few."""

    shape: str | None = None

    has_weights: ClassVar[bool] = False

    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        search = self.searched(data, options)
        # Several are ranked by least squares; noise is sought for the residuals of the chosen one alone.
        if options.alone:
            return [Trial(explained(search, options.noise))]
        return [Trial(explained(search, None), partial(explained, search))]

    def searched(self, data: TrainingData, options: Options) -> "LeastSquares":
        """The optimum of least squares. Raises `InputError` as `fitted` does."""
        start, others, starts = self._starts(data, options)
        said = options.parameters
        if data.falls and self.template is None:
            # Its class may only rise: the fit is that of the output's negative.
            start, *others = (Scaled(one, -1.0) for one in (start, *others))
            said = {"factor": {"fixed": -1.0}, "offset": {"fixed": 0.0}, **said}
        start, settings = with_settings(start, said)
        others = [with_settings(one, said)[0] for one in others]
        bounds = transform_for(start, data.record, settings)
        if not bounds.names:
            raise InputError(
                "nothing-free",
                f"every parameter of {self.name} is fixed or tied, so nothing is to fit.",
            )
        first = bounds.points_of(start, *others)
        check_rows(data.record, len(bounds.names))
        return least_squares(self.name, start, data, bounds, settings, first, starts, options)

    def _starts(
        self, data: TrainingData, options: Options
    ) -> tuple[AbstractModel, Sequence[AbstractModel], int]:
        """The model to start from, other ones, and how many random starts are tried beside them."""
        if self.shape is not None:
            # A grid's weights tell more than random starts about them.
            start, *others = starts_of_shape(self.shape, data, options.initial)
            return start, others, 1
        suggested = self.suggested(data.record if self.template else data.rising)
        start = self.template or suggested
        assert start is not None  # a class without a model can start, or is not a candidate
        # What the record suggests is one more start, but where the user said something of the start.
        more = [suggested] if self.template and suggested and not options.parameters else []
        return start, more, options.starts


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """A model of few parameters fitted by least squares, before its residuals are explained.

    - `problem`: of the training record, lengthened by `longer`. `settings`: what the user said of it.
    - `starts`: every start of the search; `optimum`: the best one, followed to its end.
    - `blocks`: held-out mean squared errors.
    """

    name: str
    data: TrainingData
    problem: Problem
    settings: Settings
    starts: Starts
    optimum: Optimum
    blocks: Float[np.ndarray, " blocks"]
    seed: int

    def model(self, free: Float[np.ndarray, " parameters"]) -> AbstractModel:
        """The model of a free vector."""
        return self.problem.bounds.model(self.problem.template, free)

    def evidence(self, predicted: Float[np.ndarray, " samples"]) -> Evidence:
        """What a prediction of the training record leaves over."""
        held_out, free = float(self.blocks.mean()), len(self.problem.bounds.names)
        return evidence(self.data.record, self.data.parts, predicted, held_out, free)


def least_squares(
    name: str,
    template: AbstractModel,
    data: TrainingData,
    bounds: Transform,
    settings: Settings,
    first: Float[np.ndarray, "points parameters"],
    starts: int,
    options: Options,
) -> LeastSquares:
    """Fit the free parameters of `template`, numbers and short arrays, by least squares.

    The search for a start runs on about 2,000 rows, side by side, from the free vectors in `first` and
    from `starts` others about the first of them. The best are refined on every row. The fit leaves out a
    conditioning cycle where that takes away a part of the held-out error, see `earned`.

    Raises `InputError` where no start gives a finite output.
    """
    record, parts, bounds = data.record, data.parts, bounds.for_fit
    y = np.where(record.mask, record.output, 0.0)
    tried, optima = _search(template, data, y, bounds, first, starts, options)
    prepared = prepared_longer(template, record.time, record.input, starts_of(record))
    problem = Problem(bounds, template, prepared, longer(y))

    def fitted(which: tuple[int, ...], free: np.ndarray, steps: int = STEPS) -> Optimum:
        weights = longer(np.where(np.isin(parts.label, which), record.weights, 0.0))
        return problem.refined(weights, free, steps)

    # Where all rows were searched the best optimum is that of the record. Else few steps on every row tell
    # which of the different optima it is, and that one alone is followed to its end.
    whole = optima[0]
    if (
        len(whole.predicted) != len(problem.measured)
        or (np.isin(parts.label, parts.all) != record.mask).any()
    ):
        ends = (fitted(parts.all, end.free, FEW) for end in optima)  # each holds every row
        whole = min(ends, key=lambda end: end.objective)
        if not whole.converged:
            whole = fitted(parts.all, whole.free)

    def blocks_of(parts: Parts) -> np.ndarray:
        def error(end: Optimum, test: tuple[int, ...]) -> np.ndarray:
            rows = np.isin(parts.label, test)
            return (end.predicted[: len(y)][rows] - y[rows]) * record.weights[rows]

        return held_out_errors(parts.folds, lambda train: fitted(train, whole.free), error)

    blocks = blocks_of(parts)
    if parts.conditioning is not None:
        later = parts.conditioned
        if earned(blocks, fewer := blocks_of(later)):
            data, blocks, whole = (
                replace(data, parts=later),
                fewer,
                fitted(later.fitted, whole.free),
            )
    return LeastSquares(name, data, problem, settings, tried, whole, blocks, options.seed)


def explained(
    fit: LeastSquares,
    noise: str | None = "auto",
    covariance: Float[np.ndarray, "parameters parameters"] | None = None,
) -> FitResult:
    """The fit of greatest likelihood under a kind of `noise`, from the least-squares optimum, with errors.

    The kind is the one that the residuals show, see `likeliest`. Where none explains them, because they are
    coloured otherwise or follow the input, or with `noise` None, least squares stays, and its errors are
    widened by the residuals' correlation time, unless the free vector's `covariance` is known.
    """
    bounds, data = fit.problem.bounds, fit.data
    optimum, rows = fit.optimum, len(data.record)
    judged = fit.evidence(optimum.predicted[:rows])
    noise_rows = Rows(
        *(longer(x) for x in rows_of(data.record, judged.used, optimum.predicted[:rows]))
    )
    residual, sought = judged.noise, _Sought(None, False, {})
    widened = residual.correlation_time
    if covariance is None:
        at = linearised(fit.problem, optimum, noise_rows)
        sought = _sought(fit, at, noise, widened)
        if sought.found is None:
            weight = np.asarray(noise_rows.weight)[:, None]
            variance = residual.sigma**2 * widened
            covariance = covariance_of(np.asarray(at.jacobian) * weight, variance)
        del at  # every row by every parameter
    found, explains, _ = sought
    free, taken, wider = optimum.free, NoiseModel(residual.sigma), np.ones(len(optimum.free))
    if found is not None:
        free, taken, wider = found.free, found.noise, found.wider
        widened = 1.0 if explains else widened
        covariance = covariance_of(found.root, widened)
    assert covariance is not None
    if taken.misfit is None:  # nobody asks for the largest array any more
        noise_rows = noise_rows._replace(shapes=np.zeros((len(noise_rows.place), 0)))
    if found is not None and free is not optimum.free:
        at_found = linearised_at(fit.problem, noise_rows, free)
        judged = fit.evidence(np.asarray(at_found.rows.output)[:rows])
    model = fit.model(free)
    bent = skewness_at(fit.problem, noise_rows, taken, free, covariance, 1 / widened)
    covariance = rescaled(covariance, wider)
    at_maximum = found is not None and found.converged and bounds.asked
    if found is not None and explains:
        judged = judged._replace(noise=found.summary())
    return FitResult(
        name=fit.name,
        model=model,
        parameters=reported(model, bounds, free, covariance, data.record, bent),
        covariance=rescaled(covariance, bounds.slope(free)),
        **judged._asdict(),
        success=fit.optimum.converged or at_maximum,
        blocks=fit.blocks,
        noise_model=taken if explains else None,
        noise_evidence=sought.evidence,
        settings=fit.settings,
        starts=fit.starts,
        **data.shown,
        seed=fit.seed,
    )


def _search(
    template: AbstractModel,
    data: TrainingData,
    y: Float[np.ndarray, " samples"],
    bounds: Transform,
    first: Float[np.ndarray, "points parameters"],
    starts: int,
    options: Options,
) -> tuple[Starts, tuple[Optimum, ...]]:
    """Every start and its objective on about 2,000 rows, and the different optima; wider starts where
    none was finite."""
    record = data.record
    rows, thin_starts = thinned_rows(record, SOME_ROWS)
    time = None if record.time is None else record.time[rows]
    thin = prepared_longer(template, time, record.input[rows], thin_starts)
    problem = Problem(bounds, template, thin, longer(y[rows]))
    weights = longer(np.where(record.mask, record.weights, 0.0)[rows])
    random = np.random.default_rng(options.seed).normal(0, 1, (starts, first.shape[1]))
    random[0] = 0.0
    for spread in SPREADS:
        points = np.vstack([first[0] + spread * random, first[1:]])
        tried = problem.searched(weights, points, options.until)
        if np.isfinite(tried[0].objective[0]):
            return tried
    raise InputError(
        "no-finite-start",
        f"the data are finite; the model is not, from any of {starts} starts about the one given.",
        cause="a parameter of the start is many times too large or too small.",
        fix="give a model to start from whose output is finite over the record.",
    )


class _Sought(NamedTuple):
    """The maximum of the likelihood, None where least squares stays; whether its noise explains the
    residuals; and the evidence of every kind of noise that was tried."""

    found: Likeliest | None
    explains: bool
    evidence: dict[str, float]


def _sought(fit: LeastSquares, at: Linearised, noise: str | None, widened: float) -> _Sought:
    """The noise that explains the residuals of a least-squares fit."""
    problem, free, found = fit.problem, fit.optimum.free, None
    if noise is not None and not problem.bounds.asked:
        found = _plainest(free, at, noise)
    if noise is not None and found is None:
        found = likeliest(problem, at.rows, free, kinds(noise))
    # Without a maximum plain noise was tried, and is too far from the residuals to go on from.
    tried = {} if noise is None else {NoiseModel(0.0).words: 0.0}
    evidence = tried if found is None else found.over_the_best
    if found is not None and (found.believed > CHANCE or noise != "auto"):
        return _Sought(found, True, evidence)
    # No kind of noise explains the residuals. Neighbouring rows repeat each other, so `widened` of them
    # count for one, also against the priors that the user gave.
    found = None
    if problem.bounds.asked:
        found = likeliest(problem, at.rows, free, kinds("gaussian"), widened)
    return _Sought(found, False, evidence)


def _plainest(free: np.ndarray, at: Linearised, noise: str) -> Likeliest | None:
    """Independent Gaussian noise, where the user names it, nothing speaks against it, or the residuals are
    the solver's tolerance."""
    found, remainder = plainest(free, np.asarray(at.residuals), np.asarray(at.jacobian), at.rows)
    size = np.ptp(np.asarray(at.rows.output)[np.asarray(at.rows.counted)])
    named = noise == "gaussian" or found.noise.sigma < ROUNDING * size
    plain = noise == "auto" and nothing_speaks_against(remainder, at.rows)
    return found if named or plain else None
