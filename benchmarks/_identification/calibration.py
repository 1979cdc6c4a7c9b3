"""Whether intervals hold the truth as often as they say: a thousand simulated records of each model.

Parameters are drawn from a prior, an output is simulated, noise is added; the fit knows that prior and
finds out by itself what kind of noise there is. Where its posterior is right, 90 % intervals hold nine
truths in ten, and ranks of the truths among draws are uniform (simulation-based calibration). The fits
start from the middle of the prior; all else is what `identify.fit` does.

Source: Talts and others, Validating Bayesian inference algorithms with simulation-based calibration (2018).
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import emcee
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array

from hysteresis import (
    AbstractModel,
    Burgers,
    LinearSponge,
    Preisach,
    Record,
    StandardLinearSolid,
    Sum,
)
from hysteresis.preisach import GaussianDensity
from identify._levels import CHANCE
from identify.noise._arithmetic import Rows
from identify.noise._model import NoiseModel, rows_of
from identify.noise._reml import kinds
from identify.noise._residual_statistics import estimate_noise
from identify.parameters._settings import Settings, numbers_of, with_settings
from identify.parameters._transform import Transform, transform, transform_for
from identify.parametric._maximum_likelihood import likeliest, linearised_at, skewness_at
from identify.parametric._multistart import Problem
from identify.parametric._standard_errors import Skewness, covariance_of, rescaled
from identify.posterior._log_posterior import Target

from .._measure import Row, judged, noted

SEED = 20261121
"""Fixed before the first run."""

SAMPLES, RECORDS, BY_EMCEE = 200, 1000, 100
NOISE, PHI = 0.02, 0.7
"""Deviation of the noise, of the output's range; correlation of neighbouring rows where it has one."""

NINETY = float(scipy.stats.norm.ppf(0.95))
LOW, HIGH = 86.5, 93.5
"""Of 1,000 intervals, 900 give or take 19 hold the truth in 95 of 100 studies."""


class Case(NamedTuple):
    """A model with the prior of its parameters, and the input of its records."""

    name: str
    model: AbstractModel
    settings: Settings
    t: np.ndarray | None
    u: np.ndarray


class Study(NamedTuple):
    """Of every record and parameter: truth, estimate and standard error in the free space.

    - `bent`: how skewed its posterior is.
    - `naive_estimate`, `naive_error`: of plain least squares, as if residuals were independent.
    - `band`, `band_noisy`: share of rows with the noise-free output, and a new reading, in the 90 % band.
    - `believed`: whether the noise model was. `measured`: the records' outputs.
    """

    names: tuple[str, ...]
    truth: np.ndarray
    estimate: np.ndarray
    error: np.ndarray
    bent: Skewness
    naive_estimate: np.ndarray
    naive_error: np.ndarray
    band: np.ndarray
    band_noisy: np.ndarray
    believed: np.ndarray
    measured: np.ndarray

    @property
    def coverage(self) -> np.ndarray:
        """Per cent of the 90 % intervals that hold the truth."""
        middle = self.estimate + self.error * self.bent.displaced(NINETY)
        return _held(self.truth, middle, self.error)

    @property
    def naive_coverage(self) -> np.ndarray:
        """The same of plain least squares."""
        return _held(self.truth, self.naive_estimate, self.naive_error)

    def rank_chances(self, bins: int = 20) -> np.ndarray:
        """Of every parameter the chance of uniform ranks to be as uneven, by chi-square over the bins."""
        deviates = deviates_of(self.bent, (self.truth - self.estimate) / self.error)
        ranks = scipy.stats.norm.cdf(deviates)
        counts = [np.histogram(column, bins, (0.0, 1.0))[0] for column in ranks.T]
        return np.array([scipy.stats.chisquare(c).pvalue for c in counts])


def _held(truth: np.ndarray, estimate: np.ndarray, error: np.ndarray) -> np.ndarray:
    return 100 * np.mean(np.abs(truth - estimate) < NINETY * error, 0)


def cases() -> list[Case]:
    """Sponge, Burgers, Gaussian Preisach, and a composition of relays and a viscoelastic solid."""
    t = np.linspace(0.0, 60.0, SAMPLES)
    steps = np.interp(t, np.linspace(0, 60, 13), [0, 5, 5, 5, 1, 1, 3, 3, 0.5, 4, 4, 2, 0])
    loops = np.interp(
        np.linspace(0, 9, SAMPLES), np.arange(10), [-1, 1, -0.6, 0.7, -0.3, 0.9, -0.9, 0.4, -0.1, 1]
    )
    density = GaussianDensity(-1.0, 1.0, 1.0, 0.3, 0.12, 0.1, 0.2)
    solid = StandardLinearSolid(2.0, 1.0, 8.0, 0.0)
    hysteresis = Preisach(GaussianDensity(-1.0, 1.0, 1.0, 0.3, 0.12, 0.1, 0.2), offset=0.3)
    return [
        _case("LinearSponge", LinearSponge(1.3, 6.0, 1.5), None, np.linspace(0.0, 15.0, SAMPLES)),
        _case("Burgers", Burgers(2.0, 100.0, 1.0, 8.0, 0.3), t, steps),
        _case("Preisach, GaussianDensity", Preisach(density, offset=0.3), None, loops),
        _case("Sum(Preisach, solid)", Sum((hysteresis, solid)), t, loops, fixed="offset"),
    ]


def _case(
    name: str, model: AbstractModel, t: np.ndarray | None, u: np.ndarray, fixed: str = ""
) -> Case:
    """Positive parameters within a factor of 1.3 of the model's, others within a fifth of them or 0.1."""
    said: dict[str, dict[str, Any]] = {}
    for number, info, value in numbers_of(model):
        if info.fixed or not np.isfinite(value):
            continue
        if fixed and number.endswith(f"1.{fixed}"):
            said[number] = {"fixed": True}
        elif info.bounds[0] == 0 and value > 0:
            said[number] = {"prior": f"log-normal({value}, 1.3)"}
        else:
            said[number] = {"prior": f"normal({value}, {max(0.2 * abs(value), 0.1)})"}
    model, settings = with_settings(model, said)
    return Case(name, model, settings, t, u)


def study(case: Case, phi: float, records: int, seed: int = SEED) -> Study:
    """Simulate and fit so many records."""
    random = np.random.default_rng([seed, len(case.name), round(100 * phi)])
    typical = np.asarray(case.model.simulate(case.t, case.u))
    record = Record.from_arrays(case.u, typical, case.t)
    bounds = transform_for(case.model, record, case.settings)
    prepared = case.model.prepare(case.t, jnp.asarray(case.u), starts=(0,))
    values = np.stack([prior.draws(random, records) for prior in bounds.priors], 1)
    truth = bounds.from_values(values)
    clean = np.asarray(_outputs(bounds, case.model, prepared, jnp.asarray(truth)))
    size = NOISE * np.ptp(clean, axis=1, keepdims=True)
    y, again = (clean + size * _noise(random, clean.shape, phi) for _ in range(2))
    rows = rows_of(record, record.mask, typical)
    middle = bounds.to_free(case.model)
    fits = [_fit(bounds, case.model, prepared, one, rows, middle) for one in y]
    estimate, least = np.stack([f.estimate for f in fits]), np.stack([f.least for f in fits])
    covariance, plain = np.stack([f.covariance for f in fits]), np.stack([f.plain for f in fits])
    spread = np.stack([np.sqrt(np.einsum("ij,jk,ik->i", f.J, f.covariance, f.J)) for f in fits])
    predicted = np.asarray(_outputs(bounds, case.model, prepared, jnp.asarray(estimate)))
    noisy = np.sqrt(spread**2 + np.array([[f.sigma] for f in fits]) ** 2)
    bent = Skewness(*(np.stack(part) for part in zip(*(f.bent for f in fits), strict=True)))
    return Study(
        bounds.names, truth, estimate, np.sqrt(np.einsum("njj->nj", covariance)), bent,
        least, np.sqrt(np.einsum("njj->nj", plain)),
        np.mean(np.abs(predicted - clean) <= NINETY * spread, 1),
        np.mean(np.abs(predicted - again) < NINETY * noisy, 1), np.array([f.believed for f in fits]), y,
    )  # fmt: skip


class _Fit(NamedTuple):
    """Estimate, covariance and skewness in the free space of one record, size of the noise, Jacobian,
    whether the noise is believed; estimate and covariance of plain least squares."""

    estimate: np.ndarray
    covariance: np.ndarray
    bent: Skewness
    sigma: float
    J: np.ndarray
    believed: bool
    least: np.ndarray
    plain: np.ndarray


def _fit(
    bounds: Transform, model: AbstractModel, prepared: Any, y: np.ndarray, rows: Rows, z: np.ndarray
) -> _Fit:
    """What a fit does, from the middle of the prior."""
    problem = Problem(bounds, model, prepared, y)
    first = problem.refined(np.ones(len(y)), z)
    r = first.predicted - y
    plain = covariance_of(first.jacobian, float(r @ r) / (len(y) - len(z)))
    found = likeliest(problem, rows, first.free, kinds("auto"))
    if found is None or found.believed < CHANCE:
        # No noise model is believed: least squares, its errors widened.
        noise = estimate_noise([r], len(z))
        nothing = Skewness(np.zeros(len(z)), np.zeros(len(z)))
        covariance = plain * noise.correlation_time
        return _Fit(
            first.free, covariance, nothing, noise.sigma, first.jacobian, False, first.free, plain
        )
    covariance = covariance_of(found.root, 1.0)
    bent = skewness_at(problem, rows, found.noise, found.free, covariance, 1.0)
    at = linearised_at(problem, rows, found.free)
    covariance = rescaled(covariance, found.wider)
    sigma = float(found.noise.sigma)
    return _Fit(
        found.free, covariance, bent, sigma, np.asarray(at.jacobian), True, first.free, plain
    )


def deviates_of(bent: Skewness, x: np.ndarray) -> np.ndarray:
    """The normal deviates that stand for x deviations from the top."""
    a = bent.skew / 6
    away = x - bent.shift + a
    return 2 * away / (1 + np.sqrt(np.maximum(1 + 4 * a * away, 0.0)))


def _noise(random: np.random.Generator, shape: tuple[int, ...], phi: float) -> np.ndarray:
    """Gaussian of unit variance, e_i = phi e_(i-1) + w_i."""
    e = random.normal(size=shape)
    for i in range(1, shape[1]):
        e[:, i] = phi * e[:, i - 1] + np.sqrt(1 - phi**2) * e[:, i]
    return e


@eqx.filter_jit
def _outputs(bounds: Transform, model: AbstractModel, prepared: Any, z: Array) -> Array:
    return jax.vmap(lambda z: bounds.insert(model, bounds.to_values(z)).evaluate(prepared))(z)


def by_emcee(case: Case, phi: float, done: Study, records: int, steps: int = 600) -> np.ndarray:
    """Mean and deviation of every parameter's posterior by emcee, (records, 2, parameters)."""
    typical = np.asarray(case.model.simulate(case.t, case.u))
    record = Record.from_arrays(case.u, typical, case.t)
    bounds = transform_for(case.model, record, case.settings)
    prepared = case.model.prepare(case.t, jnp.asarray(case.u), starts=(0,))
    noise = NoiseModel(1.0, phi=0.5) if phi else NoiseModel(1.0)
    noise_bounds, size = transform(noise, float(np.ptp(typical))), NOISE * np.ptp(typical)
    begin = [np.log(size), 2 * np.arctanh(phi)][: len(noise_bounds.names)]
    aim = Target(
        bounds, noise_bounds, case.model, noise, prepared, jnp.asarray(typical),
        rows_of(record, record.mask, typical), jnp.zeros(len(bounds.names) + len(begin)), 1.0,
    )  # fmt: skip
    found = []
    for k in range(records):
        one = eqx.tree_at(lambda a: a.measured, aim, jnp.asarray(done.measured[k]))
        spread = np.append(done.error[k], 0.1 * np.ones(len(begin)))
        middle, walkers = np.append(done.estimate[k], begin), 4 * len(spread)
        random = np.random.RandomState(k)
        sampler = emcee.EnsembleSampler(
            walkers, len(middle), lambda z, one=one: np.asarray(_log_probability(one, jnp.asarray(z))),
            vectorize=True, moves=[(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)],
        )  # fmt: skip
        first = middle + 0.5 * spread * random.normal(size=(walkers, len(middle)))
        sampler.run_mcmc(emcee.State(first, random_state=random.get_state()), steps)
        draws = sampler.get_chain(discard=steps // 3, flat=True)
        assert draws is not None
        draws = draws[:, : len(bounds.names)]
        found.append([draws.mean(0), draws.std(0)])
    return np.array(found)


@eqx.filter_jit
def _log_probability(aim: Target, points: Array) -> Array:
    return jax.vmap(aim.log_probability)(points)


def _double_precision() -> None:
    jax.config.update("jax_enable_x64", True)


def _measured(job: tuple[int, float, int, int]) -> tuple[Study, np.ndarray]:
    which, phi, records, by_sampling = job
    case = cases()[which]
    done = study(case, phi, records)
    return done, by_emcee(case, phi, done, by_sampling)


def calibration_rows(quick: bool) -> list[Row]:
    """Of every model and noise the worst coverages; over all of them the evenness of the ranks."""
    records, by_sampling = (60, 6) if quick else (RECORDS, BY_EMCEE)
    chosen = cases()[:1] if quick else cases()
    why = f"{records} records of {len(chosen)} of 4 models cannot tell 90 % from 88 %"
    rows, chances = [], []
    jobs = [(k, phi, records, by_sampling) for k in range(len(chosen)) for phi in (0.0, PHI)]
    with ProcessPoolExecutor(2, get_context("spawn"), _double_precision) as processes:
        for (k, phi, *_), (done, sampled) in zip(jobs, processes.map(_measured, jobs), strict=True):
            case = chosen[k]
            name = f"{case.name}, {f'AR(1) {phi:g}' if phi else 'white'}"
            chances += list(done.rank_chances())
            listed = dict(zip(done.names, done.coverage, strict=True))
            listed |= {
                "band": 100 * done.band.mean(),
                "band of readings": 100 * done.band_noisy.mean(),
            }
            worst = max(listed, key=lambda n: abs(listed[n] - 90))
            print(f"  {name}: {worst} {listed[worst]:.1f} %", file=sys.stderr, flush=True)
            met = LOW <= listed[worst] <= HIGH
            what = f"{name}: coverage of 90 % intervals farthest from it ({worst}), %"
            rows.append(Row(what, listed[worst], None, None, None if quick else bool(met), why))
            for parameter, value in listed.items():
                rows.append(noted(f"    {parameter}", value))
            naive = done.naive_coverage.min()
            rows.append(noted("    naive Gaussian errors of least squares, worst parameter", naive))
            means, deviations = np.swapaxes(sampled, 0, 1)
            held = _held(done.truth[:by_sampling], means, deviations)
            wider = np.median(deviations / done.error[:by_sampling])
            rows.append(noted(f"    emcee on {by_sampling} of them, mean coverage", held.mean()))
            rows.append(noted("    its errors over ours, median", float(wider)))
    ordered = np.sort(chances)
    holm = float(np.min(ordered * np.arange(len(ordered), 0, -1)))
    what = "rank histograms: chance of uniform ones to be as uneven, all parameters (Holm)"
    row = judged(what, min(holm, 1.0), 0.01, at_least=True)
    return [*rows, row._replace(met=None, reason=why) if quick else row]
