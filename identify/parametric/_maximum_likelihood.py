"""The likeliest parameters under noise that the residuals themselves show, and how far to believe it."""

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

ROUNDS = 40
"""How often a model is linearised anew about the likeliest parameters, at most."""

FIRST, HOPELESS = 3, BELIEVED / 100
"""After so many rounds, whatever leaves residuals of a smaller chance than that is given up."""

STEP = 1.0
"""A free number changes by no more than this in a round."""

ENOUGH = 1e-5
"""Standard deviations, all parameters together, by which the last round may still move."""

LONG = 8192
"""Rows from which on the first ones choose the kind of noise."""


class Likeliest(NamedTuple):
    """The maximum of the likelihood.

    - `free`: of the model's parameters, `root`: rows with root'root = its information there, `wider`: by
      how much errors are wider since the noise is not known exactly.
    - `noise`: of the kind chosen; `kinds`: the parts of every kind tried, `evidence`: its -log evidence.
    - `believed`: the chance of such noise to leave what it leaves. `rows`: how many counted. `converged`:
      whether the last round hardly moved.
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
        """-log evidence of every kind, by its name, over the least one."""
        some = NoiseModel(*[0.0] * len(PARTS))
        over = self.evidence - self.evidence.min()
        return {only(some, k).words: float(e) for k, e in zip(self.kinds, over, strict=True)}

    def summary(self) -> Noise:
        """Size and correlation in figures; of Student's t its standard deviation."""
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
    """From a least-squares fit to the maximum of the likelihood, the kind of noise chosen by evidence.

    Each round linearises the model, finds noise and parameters together for every kind (see `noise_fit`)
    and goes to the best one's. Evidence is the restricted likelihood with its Bayesian penalty, half of
    log rows for each part. Of a long record the first rows choose. Where the best kind is far from being
    believed the rounds end early. `temper`: rows that count for one, against the priors that were asked
    for. None where the rounds end at no maximum.
    """
    arguments, tried = (model, prepared, jnp.asarray(y), rows), jnp.asarray(lanes(kinds))
    with_misfit = any("misfit" in kind for kind in kinds)
    z, least, evidence, every = jnp.asarray(free), np.inf, None, kinds
    for k in range(1, ROUNDS + 1):
        at = linearised(bounds, z, arguments)
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
        away = now.away[: len(z)]
        cost = float(now.cost + temper * bounds.penalty(z))
        moved, least = float(np.linalg.norm(root @ away)), min(least, cost)
        if not moved > ENOUGH:  # not a number neither
            break
        if k == FIRST and len(every) > 1 and now.believed(padded, kinds) < HOPELESS:
            break
        z = z + away * jnp.minimum(1.0, STEP / jnp.max(jnp.abs(away)))
    if not np.isfinite(moved) or cost > least + 1:
        return None
    noise = only(of_free(now.noise, with_misfit=with_misfit), kinds[int(now.best)])
    return Likeliest(
        np.asarray(z), root, np.asarray(now.wider)[: len(z)], noise, every, np.asarray(evidence),
        now.believed(padded, kinds), int(np.sum(rows.counted)), moved < 1e3 * ENOUGH,
    )  # fmt: skip


class About(NamedTuple):
    """The likeliest noise and parameters of a linearised model.

    - `best`: which kind of noise has the greatest evidence; `evidence`: -log of each one's.
    - `noise`: its free numbers, `away`: the change of the parameters that goes with it, `cost`: -log of the
      restricted likelihood, the prior's part over its value at the model's place.
    - `wider`: see `widening`. `left`: what that noise leaves.
    """

    best: Int[Array, ""]
    evidence: Float[Array, " kinds"]
    noise: Float[Array, " parts"]
    away: Float[Array, " parameters"]
    cost: Float[Array, ""]
    wider: Float[Array, " parameters"]
    left: Left

    def believed(self, at: Linearised, kinds: tuple[tuple[str, ...], ...]) -> float:
        """The chance of such noise to leave what it leaves."""
        spent = sum(part in ("phi", "theta") for part in kinds[int(self.best)])
        return believed(self.left, at.rows.place, spent)


@partial(jax.jit, static_argnames="with_misfit")
def likeliest_about(
    at: Linearised, kinds: Bool[Array, "kinds parts"], with_misfit: bool = False
) -> About:
    """Try every kind of noise; pure JAX. `with_misfit`: whether any kind has one."""
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
        # Its shapes are no longer news: none are left to look for.
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
    """Independent Gaussian noise at a least-squares fit, in closed form: sigma^2 = squares / (rows -
    parameters), whose own uncertainty widens variances by cosh(2 sd of log sigma), see `widening`."""
    counted = int(np.sum(rows.counted))
    sigma = float(np.sqrt(residuals @ residuals / max(counted - len(free), 1)))
    x, W = residuals / (sigma or 1.0), jacobian / (sigma or 1.0)
    scores = np.sum((x**2 - 1)[np.asarray(rows.counted)] ** 2)
    wider = np.full(len(free), np.sqrt(np.cosh(2 / np.sqrt(1 + scores))))
    left = Left(x, W, np.asarray(rows.shapes) * np.asarray(rows.counted)[:, None], np.ones(()))
    kind, evidence = (("sigma",),), np.zeros(1)
    return Likeliest(free, W, wider, NoiseModel(sigma), kind, evidence, 1.0, counted), left


def only(noise: NoiseModel, kind: tuple[str, ...]) -> NoiseModel:
    """The noise with the parts of its kind alone."""
    return NoiseModel(**{part: getattr(noise, part) for part in PARTS if part in kind})


@eqx.filter_jit
def linearised(bounds: Transform, z: Array, arguments: Any) -> Linearised:
    """The model about z."""
    model, prepared, y, rows = arguments

    def residuals(z: Array) -> tuple[Array, Array]:
        predicted = bounds.insert(model, bounds.to_values(z)).evaluate(prepared)
        return jnp.where(rows.counted, predicted - y, 0.0), predicted

    (r, predicted), J = residuals(z), jax.jacfwd(lambda z: residuals(z)[0])(z)
    rows = rows._replace(output=predicted)
    return Linearised(r, J, rows, jax.grad(bounds.penalty)(z), jax.hessian(bounds.penalty)(z))


def skewness_at(
    bounds: Transform,
    arguments: Any,
    noise: NoiseModel,
    free: Float[np.ndarray, " parameters"],
    covariance: Float[np.ndarray, "parameters parameters"],
    weight: float,
) -> Skewness:
    """Of log-likelihood times weight and priors, the noise as it is; `arguments` as of `linearised`."""
    noise, points = jax.tree.map(jnp.asarray, noise), points_about(free, covariance)
    about = [linearised(bounds, jnp.asarray(z), arguments) for z in points]
    scores = [weight * score(at, arguments[2], noise) - at.pull for at in about]
    return skewness(np.array(scores), covariance)


@eqx.filter_jit
def score(
    at: Linearised, measured: Float[Array, " rows"], noise: NoiseModel
) -> Float[Array, " parameters"]:
    """d log-likelihood / dz."""

    def likelihood(r: Array) -> Array:
        return noise.log_likelihood(r, at.rows._replace(output=measured + r))

    return at.jacobian.T @ jax.grad(likelihood)(at.residuals)


def _first(at: Linearised) -> Linearised:
    """Its first rows."""
    rows = Rows(*(x[:LONG] for x in at.rows))
    return at._replace(residuals=at.residuals[:LONG], jacobian=at.jacobian[:LONG], rows=rows)


def _padded(at: Linearised) -> Linearised:
    """With rows that do not count and parameters that do nothing: few shapes, so little to compile."""
    rows = max(256, 1 << (len(at.residuals) - 1).bit_length()) - len(at.residuals)
    more = -at.jacobian.shape[1] % 4
    return Linearised(
        jnp.pad(at.residuals, (0, rows)),
        jnp.pad(at.jacobian, ((0, rows), (0, more))),
        jax.tree.map(lambda x: jnp.pad(x, ((0, rows), (0, 0))[: x.ndim]), at.rows),
        jnp.pad(at.pull, (0, more)),
        jnp.pad(at.precision, (0, more)),
    )
