"""The log-posterior of a fit: what samplers draw from, and what profiles and evidence look at."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from hysteresis import AbstractModel, InputError
from hysteresis._precision import in_own_precision

from .._levels import ROUNDING, STEPS
from ..noise._arithmetic import Rows
from ..noise._model import NoiseModel, rows_of
from ..parameters._settings import Prior, Setting
from ..parameters._transform import Transform, Vectors, transform, transform_for
from ..records._new_record import prepare
from ..results._detail import Motion, Parametric
from ..results._fit_result import FitResult

NOISE_PRIORS = {
    "growth": Setting(prior=Prior("half-normal", 1.0, default=True)),
    "input_sigma": Setting(prior=Prior("half-normal", 1.0, default=True)),
}


class Target(eqx.Module):
    """log p(z | data) = weight * log-likelihood + log-prior, z the model's free numbers, then the noise's.

    Pure JAX in `point` (parameters,): every method may be traced, mapped and differentiated.

    - `bounds`, `noise_bounds`: between z and parameters; `template`, `noise_template`: what those go into.
    - `prepared`, `measured`, `rows`: the record.
    - `start`: the maximum that the fit found.
    - `weight`: below 1 where no noise model explains the residuals' correlation: they count for as many as
      are independent.
    """

    bounds: Transform
    noise_bounds: Transform
    template: AbstractModel
    noise_template: NoiseModel
    prepared: Any
    measured: Float[Array, " rows"]
    rows: Rows
    start: Float[Array, " parameters"]
    weight: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of the numbers in z: the model's, then the noise's."""
        return (*self.bounds.names, *self.noise_bounds.names)

    @in_own_precision
    def model(self, point: Float[Array, " parameters"]) -> AbstractModel:
        """The model at a point."""
        z = point[: len(self.bounds.names)]
        return self.bounds.insert(self.template, self.bounds.to_values(z))

    @in_own_precision
    def noise(self, point: Float[Array, " parameters"]) -> NoiseModel:
        """The noise at a point."""
        z = point[len(self.bounds.names) :]
        return self.noise_bounds.insert(self.noise_template, self.noise_bounds.to_values(z))

    def values(self, points: Vectors) -> Vectors:
        """The parameters in their units."""
        xp: Any = np if isinstance(points, np.ndarray) else jnp
        z, noise = xp.split(points, [len(self.bounds.names)], -1)
        return xp.concatenate([self.bounds.to_values(z), self.noise_bounds.to_values(noise)], -1)

    @in_own_precision
    def residuals(self, point: Float[Array, " parameters"]) -> Float[Array, " rows"]:
        """predicted - measured; 0 where a row does not count."""
        return self._compared(point)[0]

    @in_own_precision
    def pointwise(self, point: Float[Array, " parameters"]) -> Float[Array, " rows"]:
        """log p(y_i | those before it), without a misfit's part; 0 where a row does not count."""
        residuals, rows = self._compared(point)
        return jnp.asarray(self.noise(point).pointwise(residuals, rows))

    @in_own_precision
    def log_likelihood(self, point: Float[Array, " parameters"]) -> Float[Array, ""]:
        """log p(data | point), times the weight."""
        residuals, rows = self._compared(point)
        return jnp.asarray(self.weight * self.noise(point).log_likelihood(residuals, rows))

    @in_own_precision
    def log_prior(self, point: Float[Array, " parameters"]) -> Float[Array, ""]:
        """log of the priors' density in the free space."""
        z, noise = jnp.split(point, [len(self.bounds.names)])
        return self.bounds.log_prior(z) + self.noise_bounds.log_prior(noise)

    @in_own_precision
    def log_probability(self, point: Float[Array, " parameters"]) -> Float[Array, ""]:
        """log of the posterior up to a constant; -inf where it is not a number."""
        found = self.log_likelihood(point) + self.log_prior(point)
        return jnp.where(jnp.isfinite(found), found, -jnp.inf)

    def _compared(self, point: Array) -> tuple[Array, Rows]:
        predicted = self.model(point).evaluate(self.prepared)
        rows = self.rows._replace(output=predicted)
        return jnp.where(rows.counted, predicted - self.measured, 0.0), rows


def target(fit: FitResult, held: tuple[str, ...] = ()) -> Target:
    """The log-posterior of a fit of few parameters.

    Parameters that are `held` keep the value of the fit.

    Without a noise model that explains the residuals they are Gaussian and count for as many as are
    independent.

    Raises `InputError` for a fit by weights or a spectrum, and where no parameter is free.
    """
    if isinstance(fit.detail, Motion):
        raise InputError(
            "no-posterior",
            f"the log-posterior of {fit.name} is run by a compiled loop, and JAX does not know it.",
            fix="identify.sample draws from it; standard errors and 90 % intervals are in the fit.",
        )
    if not isinstance(fit.detail, Parametric):
        raise InputError(
            "no-posterior", f"{fit.name} was fitted by linear weights, not by parameters."
        )
    record, used, noise = fit.train, fit.used, fit.noise_model
    settings = fit.settings | {name: Setting(fixed=True) for name in held}
    bounds = transform_for(fit.model, record, settings)
    if not bounds.names:
        raise InputError("nothing-free", "the model has no free parameter, so nothing to sample.")
    predicted = np.where(used, record.output + np.where(used, fit.residuals, 0.0), 0.0)
    weight = 1.0 if noise is not None else 1 / fit.noise.correlation_time
    noise = noise or NoiseModel(max(fit.noise.sigma, 1e-12))
    size = float(np.ptp(record.output[record.mask]))
    noise_bounds = transform(noise, size, float(np.ptp(record.input[record.mask])), NOISE_PRIORS)
    point = np.concatenate([bounds.to_free(fit.model), noise_bounds.to_free(noise)])
    return Target(
        bounds, noise_bounds, fit.model, noise, prepare(fit.model, record),
        jnp.asarray(np.where(used, record.output, 0.0)),
        rows_of(record, used, predicted),
        jnp.asarray(point), weight,
    )  # fmt: skip


# The greatest value of a smooth function, of a fit's likelihood above all: Newton's method, never
# downwards.

Function = Callable[[Float[Array, " numbers"]], Float[Array, ""]]


class Maximum(NamedTuple):
    """Where the function is greatest, its value and minus its Hessian there (1 on the diagonal of numbers
    that do not move)."""

    point: Float[Array, " numbers"]
    value: Float[Array, ""]
    curvature: Float[Array, "numbers numbers"]


def maximise(
    function: Function,
    point: Float[Array, " numbers"],
    moves: Bool[Array, " numbers"],
) -> Maximum:
    """The maximum near `point` over those numbers that move; pure JAX.

    Newton's step in the eigenvectors of the Hessian, each by its size whatever its sign, so that a saddle
    is left upwards; at most 1 along each, which in a logarithm is a factor of e; a quarter of it after a
    step that did not rise. Directions whose curvature is rounding, 1e-13 of the largest, barely move.
    """
    both, fixed = moves[:, None] & moves[None], jnp.diag(jnp.where(moves, 0.0, 1.0))

    def looked_at(point: Array) -> tuple[Array, Array, Array]:
        """Value, gradient and Hessian by one program: compiling it is most of the work."""

        def slope(point: Array) -> Any:
            # Forwards twice: half as much to compile as backwards and forwards.
            gradient, value = jax.jacfwd(lambda z: (function(z),) * 2, has_aux=True)(point)
            return gradient, (value, gradient)

        hessian, (value, gradient) = jax.jacfwd(slope, has_aux=True)(point)
        return value, jnp.where(moves, gradient, 0.0), jnp.where(both, -hessian, fixed)

    def step(carry: Any) -> Any:
        point, value, gradient, curvature, shrink, gain, count = carry
        values, vectors = jnp.linalg.eigh(curvature)
        sizes = jnp.maximum(jnp.abs(values), 1e-13 * jnp.max(jnp.abs(values)))
        along = vectors.T @ gradient
        gain = jnp.where(count > 0, jnp.sum(along**2 / sizes), gain)
        away = vectors @ jnp.clip(along / sizes, -1.0, 1.0)
        new = jnp.where(moves, point + shrink * away, point)
        found = looked_at(new)
        # At the top the value differs by rounding alone.
        better = (found[0] > value) | ((gain < ROUNDING) & jnp.isfinite(found[0]))
        kept = [
            jnp.where(better, *x) for x in zip(found, (value, gradient, curvature), strict=True)
        ]
        shrink = jnp.where(better, jnp.minimum(4 * shrink, 1.0), shrink / 4)
        return jnp.where(better, new, point), *kept, shrink, gain, count + 1

    def goes_on(carry: Any) -> Array:
        *_, shrink, gain, count = carry
        return (gain > ROUNDING) & (shrink > 1e-7) & (count <= STEPS)

    # The first step goes nowhere: it looks at the beginning.
    begin = (jnp.full((), -jnp.inf), jnp.zeros_like(point), jnp.eye(len(point)))
    infinite = jnp.full((), jnp.inf)
    point, value, _, curvature, *_ = jax.lax.while_loop(
        goes_on, step, (point, *begin, jnp.ones(()), infinite, 0)
    )
    return Maximum(point, value, curvature)


class Top(NamedTuple):
    """Of a log-posterior: where it is greatest, its value there, and a root of Laplace's covariance,

    root root' = -(d2 log p)^-1; what the data leave open is as wide as the prior.
    """

    point: Float[Array, " parameters"]
    height: Float[Array, ""]
    root: Float[Array, "parameters parameters"]


@eqx.filter_jit
def top_of(aim: Target) -> Top:
    """The posterior's maximum next to the fit: priors that were not asked for, and noise that was
    estimated after the fit, move it a little."""
    found = maximise(aim.log_probability, aim.start, jnp.ones(len(aim.start), bool))
    of_prior = jnp.clip(-jnp.diagonal(jax.hessian(aim.log_prior)(found.point)), 1e-6)
    unit = jnp.sqrt(jnp.clip(jnp.diagonal(found.curvature), of_prior))
    values, vectors = jnp.linalg.eigh(found.curvature / jnp.outer(unit, unit))
    values = jnp.clip(values, jnp.min(of_prior / unit**2))
    return Top(found.point, found.value, vectors / jnp.sqrt(values)[None] / unit[:, None])


@eqx.filter_jit
def likeliest_near(
    aim: Target,
    begin: Float[Array, " parameters"],
    moves: Bool[Array, " parameters"],
    scored: Float[Array, " rows"],
) -> Maximum:
    """Where the log-likelihood of the `scored` rows (1, else 0) is greatest, near `begin`.

    Priors that were asked for count as data, as they do in the fit. Compiled once for every use.
    """

    def score(point: Array) -> Array:
        asked = aim.bounds.penalty(point[: len(aim.bounds.names)])
        return aim.weight * jnp.sum(scored * aim.pointwise(point)) - asked

    return maximise(score, begin, moves)
