"""Maximum likelihood of parameters and noise together, with the kind of noise chosen by evidence."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from hysteresis import AbstractModel

from ..noise._adequacy import BELIEVED, Left, believed
from ..noise._model import NoiseModel, Rows
from ..noise._reml import PARTS, Linearised, lanes, noise_fit, of_free
from ..noise._residual_statistics import Noise
from ..noise._variance_inflation import widening
from ..parameters._transform import Transform
from ._interval_skewness import Skewness, points_about, skewness
from ._multistart import Optimum, refine

ROUNDS = 40
"""Gauss-Newton rounds at most; each linearises the model about the present estimate."""

FIRST, HOPELESS = 3, BELIEVED / 100
"""After FIRST rounds the search stops where the adequacy test of the residuals has a smaller p-value."""

STEP = 1.0
"""Largest change of an unconstrained parameter in one round."""

ENOUGH = 1e-5
"""The rounds have converged where the estimate moves by less than this many standard deviations."""

LONG = 8192
"""Of a record with more rows, the first LONG rows choose the kind of noise."""


class Likeliest(NamedTuple):
    """The maximum of the likelihood.

    - `free`: the model's parameters in unconstrained space. `root`: root'root is the Fisher information
      there. `wider`: factor on each standard error because the noise model itself is estimated.
    - `noise`: the noise model of the kind chosen. `kinds`: the parts of each kind tried. `evidence`:
      -log evidence of each.
    - `believed`: p-value of the adequacy test of the residuals under that noise. `rows`: number of rows
      used. `converged`: whether the last round moved by less than a tolerance.
    """

    free: Float[np.ndarray, " parameters"]
    root: Float[np.ndarray, "rows parameters"]
    wider: Float[np.ndarray, " parameters"]
    noise: NoiseModel
    kinds: tuple[tuple[str, ...], ...]
    evidence: Float[np.ndarray, " kinds"]
    believed: float
    rows: int
    converged: bool = True

    @property
    def over_the_best(self) -> dict[str, float]:
        """-log evidence of each kind of noise, by its name, minus the least."""
        some = NoiseModel(*[0.0] * len(PARTS))
        over = self.evidence - self.evidence.min()
        return {only(some, k).words: float(e) for k, e in zip(self.kinds, over, strict=True)}

    def summary(self) -> Noise:
        """Standard deviation and correlation time; of Student's t the deviation, not the scale."""
        noise = self.noise
        tail = 0.0 if noise.tail is None else float(noise.tail)
        time = max(float(noise.correlation_time), 1.0)
        return Noise(float(noise.sigma) / np.sqrt(1 - 2 * tail), self.rows, time)


def likeliest(
    bounds: Transform,
    model: AbstractModel,
    prepared: Any,
    y: Float[np.ndarray, " rows"],
    rows: Rows,
    free: Float[np.ndarray, " parameters"],
    kinds: tuple[tuple[str, ...], ...],
    temper: float = 1.0,
) -> Likeliest | None:
    """Go from a least-squares fit to the maximum likelihood, and choose the kind of noise by evidence.

    Each round linearises the model, estimates noise and parameters together for every kind (`noise_fit`),
    and moves to the parameters of the kind with the greatest evidence. The evidence is the restricted
    likelihood with the penalty of BIC: half of log(rows) for each part of the noise. In a long record the
    first rows choose the kind. The rounds stop early where even the best kind fails the adequacy test.

    `temper`: number of rows that count as one, relative to user-specified priors. Returns None where the
    rounds do not reach a maximum.
    """
    tried = jnp.asarray(lanes(kinds))
    with_misfit = any("misfit" in kind for kind in kinds)
    z, least, evidence, every = np.asarray(free), np.inf, None, kinds
    for k in range(1, ROUNDS + 1):
        at = linearised_at(bounds, model, prepared, y, rows, z)
        at = at._replace(pull=temper * at.pull, precision=temper * at.precision)
        if evidence is None and len(kinds) > 1 and len(y) > LONG:
            few = _padded(_first(at))
            first = likeliest_about(few, tried, with_misfit)
            if first.believed(few, kinds) < BELIEVED:
                return None
            best, evidence = int(first.best), first.evidence
            kinds, tried = (kinds[best],), tried[best : best + 1]
        padded = _padded(at)
        now = likeliest_about(padded, tried, with_misfit)
        evidence = now.evidence if evidence is None or len(kinds) > 1 else evidence
        root = now.left.root(np.asarray(padded.precision))[:, : len(z)]
        away = np.asarray(now.away)[: len(z)]
        cost = float(now.cost + temper * bounds.penalty(jnp.asarray(z)))
        moved, least = float(np.linalg.norm(root @ away)), min(least, cost)
        if not moved > ENOUGH:  # not a number neither
            break
        if k == FIRST and len(every) > 1 and now.believed(padded, kinds) < HOPELESS:
            break
        z = z + away * min(1.0, STEP / float(np.max(np.abs(away))))
    if not np.isfinite(moved) or cost > least + 1:
        return None
    noise = only(of_free(now.noise, with_misfit=with_misfit), kinds[int(now.best)])
    return Likeliest(
        np.asarray(z), root, np.asarray(now.wider)[: len(z)], noise, every, np.asarray(evidence),
        now.believed(padded, kinds), int(np.sum(rows.counted)), moved < 1e3 * ENOUGH,
    )  # fmt: skip


class About(NamedTuple):
    """Maximum likelihood of noise and parameters of a linearised model.

    - `best`: index of the kind of noise with the greatest evidence. `evidence`: -log evidence of each kind.
    - `noise`: its parameters in unconstrained space. `away`: the change of the model's parameters that
      goes with it. `cost`: -log of the restricted likelihood, with the prior relative to its value at the
      point of linearisation.
    - `wider`: see `widening`. `left`: what that noise leaves, whitened.
    """

    best: Int[Array, ""]
    evidence: Float[Array, " kinds"]
    noise: Float[Array, " parts"]
    away: Float[Array, " parameters"]
    cost: Float[Array, ""]
    wider: Float[Array, " parameters"]
    left: Left

    def believed(self, at: Linearised, kinds: tuple[tuple[str, ...], ...]) -> float:
        """p-value of the adequacy test of the residuals."""
        spent = sum(part in ("phi", "theta") for part in kinds[int(self.best)])
        return believed(self.left, at.rows.place, spent)


@partial(jax.jit, static_argnames="with_misfit")
def likeliest_about(
    at: Linearised, kinds: Bool[Array, "kinds parts"], with_misfit: bool = False
) -> About:
    """Estimate every kind of noise, in pure JAX. `with_misfit`: whether any kind has a misfit."""
    found = jax.vmap(lambda kind: noise_fit(at, kind, with_misfit))(kinds)
    parts = jnp.sum(jnp.where(kinds, 1.0, 0.0), 1)
    evidence = found.cost + parts * jnp.log(jnp.sum(jnp.where(at.rows.counted, 1.0, 0.0))) / 2
    evidence = jnp.where(jnp.isfinite(evidence), evidence, jnp.inf)
    best = jnp.argmin(evidence)
    free, away, cost = found.free[best], found.away[best], found.cost[best]
    noise = of_free(free, with_misfit=with_misfit)
    W = noise.whitened_columns(at.jacobian, at.rows)
    x = noise.without_misfit(noise.whitened(at.residuals, at.rows), at.rows)
    if with_misfit:
        # The misfit has taken up these shapes, so the test need not look for them.
        values, vectors = jnp.linalg.eigh(noise.information_of(at.jacobian, at.rows))
        W, shapes = vectors.T * jnp.sqrt(jnp.clip(values, 0.0))[:, None], at.rows.shapes[:, :0]
    else:
        shapes = noise.whitened_columns(at.rows.shapes, at.rows)
    left = Left(x, W, shapes, noise.information)
    wider = widening(at, free, kinds[best], with_misfit)
    return About(best, evidence, free, away, cost, wider, left)


def plainest(
    free: Float[np.ndarray, " parameters"],
    residuals: Float[np.ndarray, " rows"],
    jacobian: Float[np.ndarray, "rows parameters"],
    rows: Rows,
) -> tuple[Likeliest, Left]:
    """Independent Gaussian noise at a least-squares fit, in closed form: sigma^2 = sum of squares / (rows -
    parameters). Its own uncertainty multiplies variances by cosh(2 sd of log sigma), see `widening`."""
    counted = int(np.sum(rows.counted))
    sigma = float(np.sqrt(residuals @ residuals / max(counted - len(free), 1)))
    x, W = residuals / (sigma or 1.0), jacobian / (sigma or 1.0)
    scores = np.sum((x**2 - 1)[np.asarray(rows.counted)] ** 2)
    wider = np.full(len(free), np.sqrt(np.cosh(2 / np.sqrt(1 + scores))))
    left = Left(x, W, np.asarray(rows.shapes) * np.asarray(rows.counted)[:, None], np.ones(()))
    kind, evidence = (("sigma",),), np.zeros(1)
    return Likeliest(free, W, wider, NoiseModel(sigma), kind, evidence, 1.0, counted), left


def only(noise: NoiseModel, kind: tuple[str, ...]) -> NoiseModel:
    """The noise model with only the parts of its kind."""
    return NoiseModel(**{part: getattr(noise, part) for part in PARTS if part in kind})


def linearised(
    bounds: Transform, at: Optimum, measured: Float[np.ndarray, " rows"], rows: Rows
) -> Linearised:
    """The model linearised where its output and the Jacobian are known."""
    residuals = np.where(np.asarray(rows.counted), at.predicted - measured, 0.0)
    pull, precision = np.zeros(len(at.free)), np.zeros((len(at.free),) * 2)
    if bounds.asked:
        pull, precision = map(np.asarray, _slopes_of_penalty(bounds, at.free))
    rows = rows._replace(output=at.predicted)
    return Linearised(residuals, at.jacobian, rows, pull, precision)


def linearised_at(
    bounds: Transform,
    model: AbstractModel,
    prepared: Any,
    measured: Float[np.ndarray, " rows"],
    rows: Rows,
    z: Float[np.ndarray, " parameters"],
) -> Linearised:
    """The model linearised about z, by the program that fits it."""
    at = refine(bounds, model, prepared, measured, np.asarray(rows.counted), z, steps=1)
    return linearised(bounds, at, measured, rows)


@eqx.filter_jit
def _slopes_of_penalty(bounds: Transform, z: Array) -> tuple[Array, Array]:
    """Gradient and Hessian of the priors' penalty."""
    return jax.grad(bounds.penalty)(z), jax.hessian(bounds.penalty)(z)


def skewness_at(
    bounds: Transform,
    arguments: tuple[AbstractModel, Any, np.ndarray, Rows],
    noise: NoiseModel,
    free: Float[np.ndarray, " parameters"],
    covariance: Float[np.ndarray, "parameters parameters"],
    weight: float,
) -> Skewness:
    """Skewness of weighted log-likelihood plus log-prior, noise fixed.

    `arguments`: as those of `linearised_at` after the bounds.
    """
    about = [linearised_at(bounds, *arguments, z) for z in points_about(free, covariance)]
    scores = [weight * score(at, arguments[2], noise) - at.pull for at in about]
    return skewness(np.array(scores), covariance)


def score(
    at: Linearised, measured: Float[np.ndarray, " rows"], noise: NoiseModel
) -> Float[np.ndarray, " parameters"]:
    """The gradient of the log-likelihood with respect to z."""
    if noise.is_white:
        slope = -at.residuals / float(noise.sigma) ** 2
    else:
        slope = np.asarray(likelihood_slope(at.residuals, at.rows, measured, noise))
    return np.asarray(at.jacobian).T @ slope


@eqx.filter_jit
def likelihood_slope(
    r: Array, rows: Rows, measured: Array, noise: NoiseModel
) -> Float[Array, " rows"]:
    """The gradient of the log-likelihood with respect to the residuals."""
    noise = jax.tree.map(jnp.asarray, noise)

    def likelihood(r: Array) -> Array:
        return noise.log_likelihood(r, rows._replace(output=measured + r))

    return jax.grad(likelihood)(r)


def _first(at: Linearised) -> Linearised:
    """The first LONG rows."""
    rows = Rows(*(x[:LONG] for x in at.rows))
    return at._replace(residuals=at.residuals[:LONG], jacobian=at.jacobian[:LONG], rows=rows)


def _padded(at: Linearised) -> Linearised:
    """Padded with masked rows and parameters without effect, so that few shapes are compiled."""
    rows = max(256, 1 << (len(at.residuals) - 1).bit_length()) - len(at.residuals)
    more = -at.jacobian.shape[1] % 4
    return Linearised(
        np.pad(at.residuals, (0, rows)),
        np.pad(at.jacobian, ((0, rows), (0, more))),
        Rows(*(np.pad(x, ((0, rows), (0, 0))[: np.ndim(x)]) for x in at.rows)),
        np.pad(at.pull, (0, more)),
        np.pad(at.precision, (0, more)),
    )
