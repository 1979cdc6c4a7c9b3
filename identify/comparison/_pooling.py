"""Pooling of specimens: a random-effects model of their parameters, sampled by Gibbs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._levels import FEW, PART
from ..posterior._posterior import Posterior
from ._change import untested
from ._gaussian_estimate import Fitted, estimate, in_common, opened

CHAINS = BURN_IN = FEW
"""Chains that run side by side, and sweeps before the first draw. Successive draws are nearly independent,
because the specimens are integrated out."""

PRIOR = 0.5
"""Median of tau's prior: half of the specimens then lie within a factor of 1.4 in a positive parameter."""


class Interval(NamedTuple):
    """A median and the ends of its 90 % interval."""

    value: float
    low: float
    high: float


class PooledParameter(NamedTuple):
    """One parameter over the specimens.

    - `mean`: of the population; `spread`: the standard deviation between specimens; both in `unit`.
    - `new`: the prediction for a specimen that was not measured.
    - `specimens`: each measured one, shrunk towards the mean as far as its own data allow.
    """

    name: str
    unit: str
    mean: Interval
    spread: Interval
    new: Interval
    specimens: tuple[Interval, ...]


@dataclass(frozen=True)
class Pooled:
    """Specimens pooled: summaries, and draws in the parameters' units.

    - `parameters`: those that every fit knows. `left_out`: the excluded ones, with the reason.
    - `new`, `specimens`: draws for a new specimen, and for each measured one, in the parameters' units.
    """

    parameters: tuple[PooledParameter, ...]
    left_out: dict[str, str]
    new: Float[np.ndarray, "draws parameters"]
    specimens: Float[np.ndarray, "draws specimens parameters"]

    @property
    def words(self) -> tuple[str, ...]:
        """The results in sentences."""
        return (*map(_sentence, self.parameters), *untested(self.left_out, "pooled"))


class Draws(NamedTuple):
    """Draws in the unconstrained space: of the mean, of tau, and of every specimen."""

    mean: Float[np.ndarray, "*draws parameters"]
    tau: Float[np.ndarray, "*draws parameters"]
    specimens: Float[np.ndarray, "*draws specimens parameters"]


def pool(
    fits: Sequence[Fitted],
    parameters: Sequence[str] | None = None,
    *,
    posteriors: Sequence[Posterior | None] | None = None,
    draws: int = 4000,
    seed: int = 0,
) -> Pooled:
    """Pool fits of several specimens by a random-effects model in the unconstrained parameter space:

        z_s ~ N(theta_s, V_s)            the fit of specimen s (Laplace, or the draws of a posterior),
        theta_s ~ N(mu, diag(tau^2))     specimens differ; logarithms of positive parameters,
        p(mu) = 1,   tau_k ~ half-Cauchy(A_k)

    A_k is 0.5 for a bounded parameter and half the root mean square of the estimates for an unbounded one.
    tau is sampled and not set to one estimate, because three specimens that happen to agree do not show
    that the next one will.

    **Arguments:**

    - `fits`: of one kind of model, one of each specimen, or their folders.
    - `parameters`: names of those to pool; by default all that every fit knows.
    - `posteriors`: one for each fit, or None; by default those saved in the folders.
    - `draws`: how many draws to return; `seed`: of the random numbers.

    Raises `InputError` `too-few-fits` for fewer than two fits, and `not-comparable` if no parameter is
    known in all of them.

    Source: Gelman, Prior distributions for variance parameters in hierarchical models, Bayesian Analysis 1
    (2006); Higgins, Thompson, Spiegelhalter, A re-evaluation of random-effects meta-analysis, J. R.
    Statist. Soc. A 172 (2009).

    In the example: the stiffness of three specimens.

    **Example:**

        >>> pooled = identify.pool(specimens, ["K"], draws=200)
        >>> pooled.new.shape, pooled.specimens.shape
        ((200, 1), (200, 3, 1))
    """
    opened_fits, found = opened(fits, posteriors)
    each = [estimate(*pair) for pair in zip(opened_fits, found, strict=True)]
    shared, left_out = in_common(each, parameters)
    bounds, units, values = shared[0].bounds, shared[0].units, shared[0].bounds.to_values
    z, V = np.stack([e.free for e in shared]), np.stack([e.covariance for e in shared])
    bounded = np.isfinite(bounds.low) | np.isfinite(bounds.high)
    prior = PRIOR * np.where(bounded, 1.0, np.sqrt(np.mean(z**2, 0)))
    random = np.random.default_rng(seed)
    chains = np.broadcast_to(z, (CHAINS, *z.shape))
    free = Draws(
        *(
            a.reshape(-1, *a.shape[2:])
            for a in population_draws(chains, V, prior, -(-draws // CHAINS), random)
        )
    )
    new = values(free.mean + free.tau * random.normal(size=free.tau.shape))
    specimens = values(free.specimens)
    middle = np.median(free.mean, 0)
    mean, spread = values(free.mean), free.tau * np.abs(bounds.slope(middle))
    listed = tuple(
        PooledParameter(
            name, units[k], _interval(mean[:, k]), _interval(spread[:, k]), _interval(new[:, k]),
            tuple(_interval(specimens[:, s, k]) for s in range(len(z))),
        )
        for k, name in enumerate(bounds.names)
    )  # fmt: skip
    return Pooled(listed, left_out, new, specimens)


def population_draws(
    z: Float[np.ndarray, "chains specimens parameters"],
    V: Float[np.ndarray, "specimens parameters parameters"],
    prior: Float[np.ndarray, " parameters"],
    count: int,
    random: np.random.Generator,
) -> Draws:
    """Draws from the posterior of a random-effects model, `count` in every chain: (chains, count, ...).

    A Gibbs sampler on mu and tau. The specimens are integrated out, so the chains mix even if tau is small.
    With
    C_s = V_s + diag(tau^2) and its inverse A_s,

        mu | tau      N(M^-1 sum A_s z_s, M^-1),  M = sum A_s
        tau_k | rest  in proportion to  prior * prod_s |C_s|^-1/2 exp(-(z_s - mu)' A_s (z_s - mu) / 2)

    on a grid. tau_k is a change of rank one: with A_s at tau_k = 0, a its column k, g = A_kk, r = z_s - mu,

        log |C_s| + r'C_s^-1 r  =  constant + log(1 + tau_k^2 g) - tau_k^2 (a'r)^2 / (1 + tau_k^2 g).
    """
    chains, specimens, size = z.shape
    deviation = np.sqrt(np.diagonal(V, axis1=1, axis2=2))
    least = 1e-2 * np.minimum(deviation.min(0), prior)
    most = 50 * np.maximum(np.ptp(z, axis=1).max(0), np.maximum(prior, deviation.max(0)))
    cells = np.ceil(np.log(most / least) / np.log1p(PART)).astype(int) + 1
    grids = [np.geomspace(*ends) for ends in zip(least, most, cells, strict=True)]
    tau, found = np.broadcast_to(prior, (chains, size)).copy(), []
    eye = np.eye(size)
    for sweep in range(BURN_IN + count):
        A = np.linalg.inv(V + (tau**2)[:, None, :, None] * eye)
        M = A.sum(1)
        root = np.linalg.cholesky(np.linalg.inv(M))
        mu = np.linalg.solve(M, (A @ z[..., None]).sum(1))
        mu = (mu + root @ random.normal(size=(chains, size, 1)))[..., 0]
        r = z - mu[:, None]
        for k in range(size):
            others = np.where(np.arange(size) == k, 0.0, tau**2)
            A = np.linalg.inv(V + others[:, None, :, None] * eye)
            tau[:, k] = _draw_tau(A[..., k, k], (A[..., k] * r).sum(-1), grids[k], prior[k], random)
        if sweep >= BURN_IN:
            found.append((mu, tau.copy()))
    mean, tau = (np.stack(a, 1) for a in zip(*found, strict=True))
    # Matheron's rule: draw a specimen from the population, then move it by its data's misfit.
    deviation = tau[:, :, None] * random.normal(size=(chains, count, specimens, size))
    error = (np.linalg.cholesky(V) @ random.normal(size=(*deviation.shape, 1)))[..., 0]
    anyone = mean[:, :, None] + deviation
    D = (tau**2)[:, :, None, :, None] * eye
    moved = D @ np.linalg.solve(V + D, (z[:, None] - anyone - error)[..., None])
    return Draws(mean, tau, anyone + moved[..., 0])


def _draw_tau(
    g: Float[np.ndarray, "chains specimens"],
    ar: Float[np.ndarray, "chains specimens"],
    grid: Float[np.ndarray, " cells"],
    prior: float,
    random: np.random.Generator,
) -> Float[np.ndarray, " chains"]:
    """One of its conditional distribution in every chain; a cell of the grid weighs density times width."""
    squares = (grid**2)[:, None, None]
    wide = 1 + squares * g
    log_density = (squares * ar**2 / wide - np.log(wide)).sum(-1) / 2
    log_density += np.log(grid / (1 + (grid / prior) ** 2))[:, None]
    chances = np.cumsum(np.exp(log_density - log_density.max(0)), 0)
    chains = len(g)
    cell = (chances < random.random(chains) * chances[-1]).sum(0)
    step = np.log(grid[1] / grid[0])
    return grid[cell] * np.exp(step * random.uniform(-0.5, 0.5, chains))


def _interval(draws: Float[np.ndarray, " draws"]) -> Interval:
    low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
    return Interval(float(middle), float(low), float(high))


def _sentence(p: PooledParameter) -> str:
    unit = "" if p.unit == "1" else f" {p.unit}"
    mean, spread = (
        f"{x.value:.4g}{unit} ({x.low:.4g} to {x.high:.4g})" for x in (p.mean, p.spread)
    )
    new = f"{p.new.low:.4g} to {p.new.high:.4g}{unit}"
    return f"{p.name}: mean {mean}; specimens differ by {spread}; a new one is within {new}."
