"""How probable a fitted model makes the rows it was fitted to: criteria, evidence, leave-one-out."""

from dataclasses import fields
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from hysteresis import AbstractModel

from ..noise._arithmetic import Rows
from ..noise._model import NoiseModel, rows_of
from ..posterior._log_posterior import target
from ..posterior._mode import top_of
from ..posterior._posterior import Posterior
from ..records._run_model import prepare
from ..results._fit_result import FitResult
from ..results._likelihood import COLOURED, Criteria
from ._psis_loo import Loo, loo

DRAWS = 1000
"""Draws of a posterior that leave-one-out takes, at most, and as many TERMS of all its rows together."""
TERMS = 20_000_000


def criteria(rmse: float, numbers: int, rows: float) -> Criteria:
    """AIC = 2 k - 2 log L and BIC = k log n - 2 log L of Gaussian residuals at the likeliest sigma:

        log L = -n / 2 (log(2 pi rmse^2) + 1),      k = numbers + 1, sigma being the last.

    `rows`: n, as many as are worth one each where residuals are coloured.

    Source: Burnham, Anderson, Model Selection and Multimodel Inference (2002), chapters 2 and 6.
    """
    twice = -rows * (np.log(2 * np.pi * rmse**2) + 1)
    k = numbers + 1
    return Criteria(float(2 * k - twice), float(k * np.log(rows) - twice))


def log_evidence(fit: FitResult) -> float | None:
    """log of the probability of the counted rows under the model and its priors, by Laplace's method:

        log integral p(y | z) p(z) dz  =  log p(y, z0) + d / 2 log 2 pi + log |C| / 2,

    z0 the likeliest point, C the covariance there, d numbers, those of the noise among them. None for a fit
    without a noise model, whose likelihood counts rows for less and so is not one of the rows.

    Source: Tierney, Kadane, J. American Statistical Association 81 (1986).
    """
    if fit.noise_model is None:
        return None
    about = target(fit)
    top = top_of(about)
    log_root = np.linalg.slogdet(np.asarray(top.root))[1]
    return float(top.height + len(about.names) / 2 * np.log(2 * np.pi) + log_root)


def is_coloured(fit: FitResult) -> bool:
    """Whether a row's residual tells of the next one's, so that rows cannot be left out one by one."""
    correlated = fit.noise_model is not None and fit.noise_model.phi is not None
    return correlated or fit.noise.correlation_time > COLOURED


def leave_one_out(fit: FitResult, posterior: Posterior) -> Loo | None:
    """`loo` of the counted rows, each given those before it; None where they are too many."""
    used = fit.used
    total = posterior.draws.shape[0] * posterior.draws.shape[1]
    count = min(total, DRAWS, TERMS // int(used.sum()))
    if count < 100:
        return None
    chosen = np.linspace(0, total - 1, count).astype(int)
    draws = posterior.draws.reshape(total, -1)[chosen]
    models = jax.tree.map(lambda leaf: leaf[chosen], posterior.model)
    parts = {field.name for field in fields(NoiseModel)} & set(posterior.names)
    noise = NoiseModel(
        **{name: jnp.asarray(draws[:, posterior.names.index(name)]) for name in parts}  # type: ignore[arg-type]
    )
    record = fit.train
    predicted = np.where(used, record.output + fit.residuals, 0.0)
    rows = rows_of(record, used, predicted)
    measured = jnp.asarray(np.where(used, record.output, 0.0))
    terms = _pointwise(models, noise, prepare(fit.model, record), measured, rows)
    return loo(np.asarray(terms)[:, used])


@eqx.filter_jit
def _pointwise(
    models: AbstractModel, noise: NoiseModel, prepared: Any, measured: Array, rows: Rows
) -> Array:
    """log p(y_i | those before) under every draw, (draws, rows)."""

    def one(pair: tuple[AbstractModel, NoiseModel]) -> Array:
        model, noise = pair
        predicted = model.evaluate(prepared)
        return noise.pointwise(predicted - measured, rows._replace(output=predicted))

    return jax.lax.map(one, (models, noise), batch_size=10)
