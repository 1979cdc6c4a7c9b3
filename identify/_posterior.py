"""What the data leave open: draws from the posterior of a fit."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array, Float

from hysteresis import AbstractModel, InputError

from ._composition_fit import CompositionFit
from ._preisach import LinearFit
from ._preisach_unknowns import TOTALS
from ._result import FitResult, prepare
from ._transform import transform

Progress = Callable[[int, int, str], None]


class Summary(NamedTuple):
    """One parameter's marginal posterior, and whether the sampler can be believed."""

    name: str
    mean: float
    sd: float
    q05: float
    q95: float
    rhat: float
    ess: float


@dataclass(frozen=True)
class Posterior:
    """Draws from the posterior of a fit.

    - `names`, `draws`: parameters, (ensembles, draws, parameters).
    - `model`: one model with a leading draw axis on every parameter, for `jax.vmap` and `invert`.
    - `summaries`: mean, deviation, 5 and 95 % quantiles, R-hat across ensembles, effective draws.
    - `method`: how it was drawn. `acceptance`, `autocorrelation` (steps; NaN where draws are
      independent), `seconds`.
    """

    names: tuple[str, ...]
    draws: Float[np.ndarray, "ensembles draws parameters"]
    model: AbstractModel
    summaries: tuple[Summary, ...]
    method: str
    acceptance: float
    autocorrelation: float
    seconds: float

    @property
    def converged(self) -> bool:
        """R-hat below 1.01 and a hundred effective draws for every parameter."""
        return all(s.rhat < 1.01 and s.ess > 100 for s in self.summaries)


def sample(
    fit: FitResult,
    steps: int = 2000,
    ensembles: int = 4,
    seed: int = 0,
    *,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Posterior:
    """Draw from the posterior of a fit.

    Models of few parameters: emcee's affine-invariant ensembles, vectorised and compiled, several of
    them independent, so that R-hat means something. Weights on a grid: the Gaussian posterior of the
    linear problem, each draw projected in its own metric onto the models that can be (no negative
    weight, no falling branch); such draws are independent. Where the data leave much open their mean
    moves away from the fit, into the models that can be.

    The likelihood is that of `Noise`: coloured residuals count for as many as are independent.
    Priors are flat in the free space of `Transform` (log-uniform for a positive parameter), held
    within a factor of a million of the fit.

    **Arguments:** `steps` for each of `ensembles` (total, also when resumed); `seed`.

    **Other arguments:** `checkpoint`, an HDF5 file that keeps the chains; `resume` goes on from it;
    `progress(done, total, text)` is called now and then.

    Raises `InputError` for a spectrum, a fit without free parameters, too few steps, a checkpoint that does
    not belong to the fit.
    """
    if steps < 20 or ensembles < 2:
        raise InputError(
            "too-few-draws",
            f"{steps} steps in {ensembles} ensembles say nothing about convergence.",
            fix="take at least 20 steps and 2 ensembles.",
        )
    if "spectrum" in fit.internals:
        raise InputError(
            "no-posterior",
            "a spectrum has no posterior to draw from.",
            fix="what its record leaves open are the errors of its parameters and the range of"
            " `Spectrum.predict` (hysid predict, hysid report).",
        )
    begin = time.perf_counter()
    tell = progress or (lambda done, total, text: None)
    if "linear" in fit.internals or "composition" in fit.internals:
        return _sample_weights(fit, steps, ensembles, seed, tell, begin)
    return _sample_parameters(fit, steps, ensembles, seed, checkpoint, resume, tell, begin)


# Few parameters: emcee


def _sample_parameters(
    fit: FitResult,
    steps: int,
    ensembles: int,
    seed: int,
    checkpoint: str | Path | None,
    resume: bool,
    tell: Progress,
    begin: float,
) -> Posterior:
    import emcee

    log_probability, z0, spread, bounds = _log_probability(fit)
    dimension = len(z0)
    walkers = 2 * max(2 * dimension, 8)
    chains, taus, accepted = [], [], []
    for k in range(ensembles):
        # Even and odd halves have one shape, so the function is compiled once.
        backend = None
        if checkpoint is not None:
            backend = emcee.backends.HDFBackend(str(checkpoint), name=f"ensemble_{k}")
        done = 0 if backend is None else _steps_kept(backend, resume, (walkers, dimension))
        sampler = emcee.EnsembleSampler(
            walkers,
            dimension,
            lambda z: np.asarray(log_probability(jnp.asarray(z))),
            vectorize=True,
            backend=backend,
        )
        random = np.random.RandomState(seed + 1000 * k)
        if done and backend is not None:
            state = sampler._previous_state = backend.get_last_sample()
        else:
            first = _first_walkers(
                log_probability, z0, spread * random.normal(size=(walkers, dimension))
            )
            state = emcee.State(first, random_state=random.get_state())
        for step, _ in enumerate(sampler.sample(state, iterations=max(steps - done, 0)), done + 1):
            if step % 50 == 0 or step == steps:
                rate = float(np.mean(sampler.acceptance_fraction))
                tell(
                    k * steps + step, ensembles * steps, f"ensemble {k + 1}, acceptance {rate:.2f}"
                )
        short = np.full(dimension, np.nan)
        taus.append(sampler.get_autocorr_time(quiet=True, tol=0) if steps > 20 else short)
        burn = min(int(5 * np.max(np.nan_to_num(taus[-1], nan=steps / 10))), steps // 2)
        chain = sampler.get_chain()
        assert chain is not None
        chains.append(chain[burn:steps])
        accepted.append(np.mean(sampler.acceptance_fraction))
    kept = min(len(chain) for chain in chains)
    chain = np.stack([c[-kept:] for c in chains])
    tau = np.nan_to_num(np.mean(taus, axis=0), nan=float(kept))
    free = jnp.asarray(chain[..., :-1].reshape(-1, dimension - 1))
    values = np.asarray(jax.vmap(bounds.to_values)(free)).reshape(*chain.shape[:-1], -1)
    values = np.concatenate([values, np.exp(chain[..., -1:])], -1)
    names = (*bounds.names, "sigma")
    summaries = tuple(
        _summarise(name, values[..., j], float(ensembles * walkers * kept / max(tau[j], 1.0)))
        for j, name in enumerate(names)
    )
    thin = max(1, int(np.max(tau) / 2))
    flat = values[:, ::thin].reshape(ensembles, -1, len(names))
    posterior_model = jax.vmap(lambda v: bounds.insert(fit.model, v))(
        jnp.asarray(flat[..., :-1].reshape(-1, dimension - 1))
    )
    return Posterior(
        names, flat, posterior_model, summaries, f"emcee, {ensembles} x {walkers} walkers",
        float(np.mean(accepted)), float(np.max(tau)), time.perf_counter() - begin,
    )  # fmt: skip


def _first_walkers(log_probability: Any, z0: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Start about the fit, each where the posterior is not hopeless, lest a walker stays there.

    Whoever is more than 10 + 3 per dimension below the fit in log-probability comes halfway back.
    """
    floor = float(np.asarray(log_probability(jnp.asarray(z0[None])))[0]) - 10 - 3 * len(z0)
    for _ in range(60):
        low = np.asarray(log_probability(jnp.asarray(z0 + away))) < floor
        if not low.any():
            break
        away = np.where(low[:, None], away / 2, away)
    return z0 + away


def _steps_kept(backend: Any, resume: bool, shape: tuple[int, int]) -> int:
    """Steps to go on from; without `resume` the file is emptied."""
    if not (resume and backend.initialized):
        backend.reset(*shape)
        return 0
    kept = tuple(int(n) for n in backend.shape)
    if kept != shape:
        raise InputError(
            "other-checkpoint",
            f"the checkpoint has {kept} walkers and parameters, the fit {shape}.",
            place=str(backend.filename),
            cause="it was made with another model.",
            fix="name a new file, or sample without --resume.",
        )
    return int(backend.iteration)


def _log_probability(fit: FitResult) -> tuple[Any, np.ndarray, np.ndarray, Any]:
    """The vectorised log-posterior over (z, log sigma), a start and the spread of first walkers."""
    record, used, noise = fit.train, fit.internals["used"], fit.noise
    sizes = (float(np.ptp(x[record.mask])) for x in (record.output, record.input))
    bounds = transform(fit.model, *sizes)
    if not bounds.names:
        raise InputError("nothing-free", "the model has no free parameter, so nothing to sample.")
    prepared = prepare(fit.model, record)
    z_fit = bounds.to_free(fit.model)
    y, mask = jnp.asarray(np.where(used, record.output, 0.0)), jnp.asarray(used)
    wide = float(np.log(1e6))

    @eqx.filter_jit
    def log_probability(points: Array, arguments: Any) -> Array:
        model, prepared, y, mask, z_fit = arguments

        def one(point: Array) -> Array:
            z, log_sigma = point[:-1], point[-1]
            predicted = bounds.insert(model, bounds.to_values(z)).evaluate(prepared)
            squares = jnp.sum(jnp.where(mask, predicted - y, 0.0) ** 2)
            rows = mask.sum().astype(point.dtype)
            likelihood = -squares / (2 * jnp.exp(2 * log_sigma)) - rows * log_sigma
            likelihood = likelihood / noise.correlation_time
            inside = jnp.all(jnp.abs(z - z_fit) < wide)
            return jnp.where(inside & jnp.isfinite(likelihood), likelihood, -jnp.inf)

        return jax.vmap(one)(points)

    arguments = (fit.model, prepared, y, mask, jnp.asarray(z_fit))
    slope = bounds.slope(z_fit)
    deviation = np.sqrt(np.diagonal(fit.covariance)) / np.maximum(np.abs(slope), 1e-300)
    deviation = np.where(np.isfinite(deviation), np.clip(deviation, 1e-6, 1.0), 1.0)
    start = np.append(z_fit, np.log(max(noise.sigma, 1e-12)))
    spread = np.append(deviation, 0.5 / np.sqrt(noise.effective))
    return lambda points: log_probability(points, arguments), start, spread, bounds


# Weights on a grid: projected Gaussian


def _sample_weights(
    fit: FitResult, steps: int, ensembles: int, seed: int, tell: Progress, begin: float
) -> Posterior:
    """Independent draws of linear unknowns, see `LinearFit.draws`; sigma from its own posterior."""
    linear: LinearFit | CompositionFit
    if "linear" in fit.internals:
        grid: LinearFit = fit.internals["linear"]
        linear, sums, model = grid, TOTALS, grid.meaning.model
    else:
        composed: CompositionFit = fit.internals["composition"]
        linear, sums = composed, composed.meaning.total_names
        model = jax.vmap(composed.meaning.model)
    draws = min(steps, 200)
    found = [
        linear.draws(
            fit.noise,
            draws,
            np.random.default_rng([seed, k]),
            lambda d, k=k: tell(k * draws + d, ensembles * draws, f"ensemble {k + 1}"),
        )
        for k in range(ensembles)
    ]
    unknowns = np.concatenate(found)
    totals = unknowns @ linear.meaning.totals.T * linear.meaning.scale
    effective = max(fit.noise.effective, 2.0)
    random = np.random.default_rng([seed, ensembles])
    sigma = fit.noise.sigma * np.sqrt(effective / random.chisquare(effective, (len(unknowns), 1)))
    values = np.hstack([totals, sigma]).reshape(ensembles, draws, -1)
    names = (*sums, "sigma")
    summaries = tuple(
        _summarise(name, values[..., j], float(ensembles * draws)) for j, name in enumerate(names)
    )
    return Posterior(
        names, values, model(unknowns), summaries,
        f"projected Gaussian, {ensembles} x {draws} independent draws",
        1.0, float("nan"), time.perf_counter() - begin,
    )  # fmt: skip


# Summaries


def _summarise(name: str, draws: Float[np.ndarray, "ensembles *draws"], ess: float) -> Summary:
    flat = draws.reshape(len(draws), -1)
    low, high = np.quantile(flat, [0.05, 0.95])
    return Summary(
        name, float(flat.mean()), float(flat.std(ddof=1)), float(low), float(high), rhat(flat), ess
    )


def rhat(chains: Float[np.ndarray, "chains draws"]) -> float:
    """Rank-normalised split R-hat, a chain being an ensemble, never one of its walkers.

    Source: Vehtari and others, Rank-normalization, folding, and localization, Bayesian Analysis 2021.
    """
    half = chains.shape[1] // 2
    split = np.concatenate([chains[:, :half], chains[:, -half:]])
    folded = np.abs(split - np.median(split))
    return max(_rhat_of_ranks(split), _rhat_of_ranks(folded))


def _rhat_of_ranks(chains: np.ndarray) -> float:
    ranks: np.ndarray = scipy.stats.rankdata(chains).reshape(chains.shape)
    z = scipy.stats.norm.ppf((ranks - 0.375) / (chains.size + 0.25))
    n = chains.shape[1]
    within, between = z.var(axis=1, ddof=1).mean(), n * z.mean(axis=1).var(ddof=1)
    return float(np.sqrt(((n - 1) / n * within + between / n) / within))
