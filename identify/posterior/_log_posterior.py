"""The log-posterior of a fit: what samplers draw from, and what profiles and evidence look at."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import AbstractModel, InputError
from hysteresis._precision import in_own_precision

from ..noise._arithmetic import Rows
from ..noise._model import NoiseModel, rows_of
from ..parameters._priors import Prior
from ..parameters._settings import Setting
from ..parameters._transform import Transform, Vectors, transform, transform_for
from ..records._run_model import prepare
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
