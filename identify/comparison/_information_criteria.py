"""How probable a fitted model makes the rows it was fitted to: criteria and evidence."""

import numpy as np

from ..posterior._log_posterior import target
from ..posterior._mode import top_of
from ..results._fit_result import FitResult
from ..results._likelihood import Criteria


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
