"""Criteria of a fit's own likelihood."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from hysteresis import InputError

from ..noise._model import rows_of
from ..noise._residual_statistics import estimate_noise

if TYPE_CHECKING:
    from ._fit_result import FitResult

COLOURED = 2.0
"""Correlation time of residuals from which on rows are not exchangeable."""


class Criteria(NamedTuple):
    """Akaike's and Schwarz's criterion; less is better, differences alone mean something."""

    aic: float
    bic: float


def criteria_of(fit: "FitResult") -> Criteria:
    """AIC = 2 k - 2 log L and BIC = k log n - 2 log L, of the k fitted parameters, those of the noise too.

    Raises `InputError` `not-comparable` where the fit has no likelihood of its n rows, or k is not known.
    """
    noise, count, used = fit.noise_model, fit.parameter_count, fit.used
    if count is None:
        raise _none(f"{fit.name} has weights that a prior holds together, which are not counted.")
    if noise is None:
        raise _none("No noise model explains the residuals, so the rows have no likelihood.")
    if any(one.prior is not None and not one.prior.default for one in fit.settings.values()):
        raise _none(
            "A prior that you gave holds parameters, so this is no maximum of the likelihood."
        )
    residuals = np.where(used, fit.residuals, 0.0)
    rows = rows_of(fit.train, used, np.where(used, fit.train.output + residuals, 0.0))
    white = np.asarray(noise.whitened(residuals, rows))
    left = estimate_noise([white[part][used[part]] for _, part in fit.train.sequences()])
    if left.correlation_time > COLOURED:
        raise _none(
            "The noise model takes surprises for independent of each other, and they are correlated over"
            f" {left.correlation_time:.0f} rows."
        )

    def less(log_scale: float) -> float:
        parts = {
            name: getattr(noise, name) for name in ("sigma", "growth", "input_sigma", "misfit")
        }
        sized = {k: x * np.exp(log_scale) for k, x in parts.items() if x is not None}
        return -2 * float(replace(noise, **sized).log_likelihood(residuals, rows))

    # Fits estimate the size of the noise without bias, which is not where the likelihood is greatest.
    best: Any = minimize_scalar(less, bounds=(-2, 2), method="bounded", options={"xatol": 1e-6})
    twice = float(best.fun)
    k = count + sum(part is not None for part in vars(noise).values())
    return Criteria(2 * k + twice, float(k * np.log(used.sum()) + twice))


def _none(why: str) -> InputError:
    fix = "Compare models by their held-out errors: fit.score, hysid.compare."
    return InputError("not-comparable", f"This fit has no AIC or BIC. {why}", fix=fix)
