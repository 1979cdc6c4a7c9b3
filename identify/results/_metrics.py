"""Error figures: root mean square, normalised, largest, and R^2."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Metrics(NamedTuple):
    """Errors over some rows.

    - `rmse`, `max_abs`: root mean square and largest error, in the output's unit.
    - `nrmse_percent`: 100 rmse / (max - min of the measured output over these rows).
    - `r2`: 1 - sum of squared errors / sum of squared deviations from the mean.
    - `relative_percent`: 100 times the root mean square of error / measured; NaN where a reading is 0.
    """

    rmse: float
    nrmse_percent: float
    max_abs: float
    r2: float
    relative_percent: float = float("nan")


def metrics(
    measured: Float[np.ndarray, " samples"],
    predicted: Float[np.ndarray, " samples"],
    mask: Bool[np.ndarray, " samples"] | None = None,
    weights: Float[np.ndarray, " samples"] | None = None,
) -> Metrics:
    """Errors of a prediction over the masked rows, each times its weight over the weights' rms."""
    each = np.ones(len(measured)) if weights is None else weights
    if mask is not None:
        measured, predicted, each = measured[mask], predicted[mask], each[mask]
    each = each / np.sqrt(np.mean(each**2))
    error = each * (predicted - measured)
    rmse = float(np.sqrt(np.mean(error**2)))
    off = each * (measured - np.average(measured, weights=each**2))
    spread, span = float(np.sum(off**2)), float(np.ptp(measured))
    relative = np.mean((error / measured) ** 2) if measured.all() else np.nan
    return Metrics(
        rmse,
        100 * rmse / span if span > 0 else float("nan"),
        float(np.abs(error).max()),
        1 - float(np.sum(error**2)) / spread if spread > 0 else float("nan"),
        100 * float(np.sqrt(relative)),
    )
