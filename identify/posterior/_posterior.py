"""What the data leave open: a posterior's draws, and what can be said of each parameter."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float, Int

from hysteresis._drawing import html_of, plot_of
from hysteresis._show import aligned, at_most

from .._levels import CONFIDENCE, FEW, HELD_AT_ONCE, PART, SOME_ROWS
from ._log_posterior import Target

# Whether chains agree, how many draws they are worth, and whether they know one mode or several.

# What a sampler hands over, whichever it was.


Progress = Callable[[int, int, str], None]
"""Called now and then with steps done, steps in all as far as they are known, and a few words."""


class Chains(NamedTuple):
    """Draws in the free space after burn-in. Chains are independent; walkers of one are not.

    - `points`, `log_probability`: (chains, steps, walkers, parameters), (chains, steps, walkers).
    - `rhat`, `ess`: of every parameter. `autocorrelation`: the longest, in steps.
    - `thin`: steps between draws worth keeping.
    - `long_enough`: whether the chains hold so many autocorrelation times that those can be believed.
    - `acceptance`: part of the proposals taken; `statistics`: more of it, (chains, ...).
    - `method`, `notes`: what was done, and what to mind, in words.
    """

    points: Float[np.ndarray, "chains steps walkers parameters"]
    log_probability: Float[np.ndarray, "chains steps walkers"]
    rhat: Float[np.ndarray, " parameters"]
    ess: Float[np.ndarray, " parameters"]
    thin: int
    autocorrelation: float
    long_enough: bool
    acceptance: float
    statistics: dict[str, np.ndarray]
    method: str
    notes: tuple[str, ...]

    @property
    def thinned(self) -> Float[np.ndarray, "chains draws parameters"]:
        """The draws worth keeping of each chain, over all its walkers."""
        chains, _, _, parameters = self.points.shape
        return self.points[:, :: self.thin].reshape(chains, -1, parameters)


VALLEY = 0.5
"""A valley counts below this part of the lower peak, with as many of the draws as lie beyond an end of an
interval, and `FEW` effective ones, on either side."""


def rhat(chains: Float[np.ndarray, "chains draws"]) -> float:
    """Rank-normalised split R-hat, a chain being an ensemble, never one of its walkers.

    The larger of that of the draws and of their distances from the median, which sees chains of
    unequal width; infinite where chains do not move.

    Source: Vehtari and others, Rank-normalization, folding, and localization, Bayesian Analysis 2021.
    """
    half = chains.shape[1] // 2
    split = np.concatenate([chains[:, :half], chains[:, -half:]])
    folded = np.abs(split - np.median(split))
    return max(_rhat_of(_normal_scores(split)), _rhat_of(_normal_scores(folded)))


def has_two_modes(draws: Float[np.ndarray, " draws"], effective: float) -> bool:
    """Whether draws of one number lie about more than one place.

    The density is estimated with a Gaussian kernel of Silverman's width,
    0.9 min(sd, interquartile range / 1.34) / effective^(1/5). There are two modes where it falls below half
    of the lower of two peaks, with a twentieth of the draws, and twenty effective ones, on either
    side; so walkers stuck in separate places count too. Modes that part in several numbers at once, but in
    none of them alone, are not seen, and neither is a mode in which no draw is.

    Source: Silverman, Density Estimation for Statistics and Data Analysis, 1986, section 3.4.
    """
    q1, q3 = np.quantile(draws, [0.25, 0.75])
    sd = draws.std()
    width = 0.9 * min(sd, (q3 - q1) / 1.34 or sd) * max(effective, 2.0) ** -0.2
    if not width > 0:
        return False
    cells = int(min(max(np.ptp(draws) / width * 8, 16), 100_000))
    counts, edges = np.histogram(draws, cells)
    sigma = width / (edges[1] - edges[0])
    density = scipy.ndimage.gaussian_filter1d(counts.astype(float), sigma, mode="constant")
    below = np.cumsum(counts) / len(draws)
    lower = np.minimum(
        np.maximum.accumulate(density), np.maximum.accumulate(density[::-1])[::-1]
    )  # of the highest peaks on either side
    aside = max((1 - CONFIDENCE) / 2, FEW / effective)
    valleys = (density < VALLEY * lower) & (below > aside) & (below < 1 - aside)
    return bool(valleys.any())


def _normal_scores(chains: np.ndarray) -> np.ndarray:
    _, place, count = np.unique(chains, return_inverse=True, return_counts=True)
    # Equal draws share the mean of their ranks.
    ranks = (np.cumsum(count) - (count - 1) / 2)[place].reshape(chains.shape)
    return scipy.special.ndtri((ranks - 0.375) / (chains.size + 0.25))


def _rhat_of(z: np.ndarray) -> float:
    n = z.shape[1]
    within, between = z.var(axis=1, ddof=1).mean(), n * z.mean(axis=1).var(ddof=1)
    if not within > 0:
        return float("inf")
    return float(np.sqrt(((n - 1) / n * within + between / n) / within))


# What draws of a posterior say of every row: its likelihood, and readings to be expected there.


class PerRow(NamedTuple):
    """Draws for every counted row of the fitted record, thinned.

    - `log_likelihood`: log p(y_i | those before it), (ensembles, draws, rows).
    - `predictive`: readings to be expected, of the draw's model and noise, each row for itself.
    - `observed`, `rows`: the readings, and their places in the record.
    """

    log_likelihood: Float[np.ndarray, "ensembles draws rows"]
    predictive: Float[np.ndarray, "ensembles draws rows"]
    observed: Float[np.ndarray, " rows"]
    rows: Int[np.ndarray, " rows"]


def per_row(
    aim: Target, points: Float[np.ndarray, "ensembles draws parameters"], seed: int
) -> PerRow:
    """Of some of the draws, evenly taken."""
    rows = np.flatnonzero(np.asarray(aim.rows.counted))
    ensembles, draws, parameters = points.shape
    most = min(max(HELD_AT_ONCE // (len(rows) * ensembles), 5), SOME_ROWS // ensembles, draws)
    some = points[:, np.linspace(0, draws - 1, most).astype(int)]
    told = _at_points(aim, jnp.asarray(some.reshape(-1, parameters)))
    likelihood, predicted, scale = (np.asarray(a)[:, rows] for a in told[:3])
    random = np.random.default_rng([seed, 3])
    noise = random.normal(size=predicted.shape)
    if aim.noise_template.tail is not None:
        degrees = 1 / np.asarray(told[3])[:, None]
        noise /= np.sqrt(random.chisquare(degrees, (len(degrees), len(rows))) / degrees)
    shape = (ensembles, -1, len(rows))
    predictive = (predicted + scale * noise).reshape(shape)
    return PerRow(likelihood.reshape(shape), predictive, np.asarray(aim.measured)[rows], rows)


@eqx.filter_jit
def _at_points(aim: Target, points: Float[Array, "points parameters"]) -> tuple[Array, ...]:
    """Of each: (log-likelihood, predicted, scale of the noise) by rows, and the tail."""

    def at(point: Array) -> tuple[Array, ...]:
        noise, predicted = aim.noise(point), aim.residuals(point) + aim.measured
        tail = jnp.zeros(()) if noise.tail is None else jnp.asarray(noise.tail)
        scale = noise.scale(aim.rows._replace(output=predicted))
        return aim.pointwise(point), predicted, scale, tail

    return jax.lax.map(at, points, batch_size=16)


class Summary(NamedTuple):
    """One parameter's marginal posterior, and whether the sampler can be believed.

    - `modes`: 2 where the draws lie about more than one place, see `has_two_modes`.
    - `contraction`: 1 - variance / prior variance in the free space, where both are nearest to normal: 0
      where the data said nothing, 1 where they said all; None where no prior is known.
    """

    name: str
    mean: float
    sd: float
    q05: float
    q95: float
    rhat: float
    ess: float
    modes: int = 1
    contraction: float | None = None

    @property
    def words(self) -> tuple[str, ...]:
        """What to mind: two modes, a posterior as wide as its prior."""
        wide = self.contraction is not None and self.contraction < PART
        return ("two modes",) * (self.modes > 1) + ("as wide as its prior",) * wide


@dataclass(frozen=True)
class Posterior:
    """Draws from the posterior of a fit.

    - `names`, `draws`: parameters, (ensembles, draws, parameters).
    - `model`: one model, or calibrated system, with a leading draw axis on every parameter, for `jax.vmap`
      and `invert`.
    - `summaries`: mean, deviation, 5 and 95 % quantiles, R-hat across ensembles, effective draws.
    - `method`: how it was drawn. `acceptance`, `autocorrelation` (steps; NaN where draws are
      independent), `seconds`. `notes`: what to mind, in sentences.
    - `long_enough`: the chains hold so many autocorrelation times that R-hat and effective draws mean
      something.

    Where a sampler walked, and not in a posterior that was loaded:

    - `log_probability`: (ensembles, draws), up to a constant. `statistics`: more of the sampler's,
      (ensembles, ...).
    - `prior`: draws of the priors, (draws, parameters). `per_row`: what the draws say of each row.

    **Example:**

        >>> posterior.names
        ('K', 'b', 'sigma')
        >>> posterior.draws.shape[0], posterior.method
        (4, 'emcee, 4 x 16 walkers, 100 steps')
    """

    names: tuple[str, ...]
    draws: Float[np.ndarray, "ensembles draws parameters"]
    model: Any
    summaries: tuple[Summary, ...]
    method: str
    acceptance: float
    autocorrelation: float
    seconds: float
    notes: tuple[str, ...] = ()
    long_enough: bool = True
    log_probability: Float[np.ndarray, "ensembles draws"] | None = None
    statistics: dict[str, np.ndarray] = field(default_factory=dict)
    prior: Float[np.ndarray, "prior_draws parameters"] | None = None
    per_row: PerRow | None = None

    @property
    def converged(self) -> bool:
        """R-hat below 1.01 and a hundred effective draws of every parameter, from chains that can tell."""
        return self.long_enough and all(s.rhat < 1.01 and s.ess > 100 for s in self.summaries)

    def summary(self) -> str:
        """The posterior in at most 30 lines: how it was drawn, and each parameter's figures."""
        head = ("parameter", "mean", "sd", "5 %", "95 %", "R-hat", "ESS", "")
        rows = [
            (s.name, *(f"{x:.4g}" for x in (s.mean, s.sd, s.q05, s.q95)), f"{s.rhat:.3f}",
             f"{s.ess:.0f}", ", ".join(s.words))
            for s in self.summaries
        ]  # fmt: skip
        ensembles, draws, _ = self.draws.shape
        state = "converged" if self.converged else "not converged"
        return "\n".join([
            f"Posterior: {ensembles * draws} draws by {self.method}, {state}",
            *at_most(self.notes, 8),
            *at_most(aligned([head, *rows]), 20),
        ])  # fmt: skip

    def plot(self, names: Sequence[str] | None = None) -> Any:
        """Histograms of parameters and scatter plots of their pairs, as a matplotlib `Figure`.

        **Arguments:**

        - `names`: the parameters to draw; the first six unless given.

        **Returns:** a `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

        **Raises:** `InputError` `unknown-parameter`; `missing-extra` where matplotlib cannot be imported.
        """
        return plot_of(self, names=names)

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        ensembles, draws, count = self.draws.shape
        return f"<Posterior of {count} parameters, {ensembles * draws} draws by {self.method}>"

    def _repr_html_(self) -> str | None:
        return html_of(self)


def summary_of(
    name: str,
    draws: Float[np.ndarray, "ensembles draws"],
    ess: float,
    agreement: float | None = None,
    modes: int = 1,
    contraction: float | None = None,
) -> Summary:
    """Of one parameter's draws; R-hat from them where it is not given."""
    low, high = np.quantile(draws, [0.05, 0.95])
    return Summary(
        name, float(draws.mean()), float(draws.std(ddof=1)), float(low), float(high),
        rhat(draws) if agreement is None else agreement, ess, modes, contraction,
    )  # fmt: skip


def posterior_of(
    names: tuple[str, ...],
    chains: Chains,
    values: Callable[[np.ndarray], np.ndarray | Array],
    models: Callable[[Array], Any],
    prior_variance: Float[np.ndarray, " parameters"],
    begin: float,
) -> Posterior:
    """Chains in the parameters' units, thinned, with what can be said of each.

    **Arguments:** `values` and `models`: of many points of the free space; `prior_variance`: of each
    parameter there; `begin`: when the work began, `time.perf_counter()`.
    """

    def in_units(points: np.ndarray) -> np.ndarray:
        flat = points.reshape(-1, points.shape[-1])
        return np.asarray(values(flat)).reshape(points.shape)

    ensembles, _, _, parameters = chains.points.shape
    every, thinned = in_units(chains.points), chains.thinned
    summaries = []
    for j, name in enumerate(names):
        column, ess = every[..., j].reshape(ensembles, -1), float(chains.ess[j])
        contraction = 1 - chains.points[..., j].var() / prior_variance[j]
        modes = 1 + has_two_modes(thinned[..., j].ravel(), ess)
        summaries.append(
            summary_of(name, column, ess, float(chains.rhat[j]), modes, float(contraction))
        )
    flat = jnp.asarray(thinned.reshape(-1, parameters))
    density = chains.log_probability[:, :: chains.thin].reshape(ensembles, -1)
    return Posterior(
        names, in_units(thinned), models(flat), tuple(summaries), chains.method, chains.acceptance,
        chains.autocorrelation, time.perf_counter() - begin, chains.notes, chains.long_enough,
        density, chains.statistics,
    )  # fmt: skip
