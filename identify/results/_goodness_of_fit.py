"""Goodness of fit: residuals, errors and noise on the rows that a model was fitted to."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record

from ..noise._residual_statistics import Noise, estimate_noise
from ..records._folds import Parts
from ._metrics import Metrics, metrics


class Evidence(NamedTuple):
    """What a fitted model leaves over, in the fields of `FitResult` with the same names."""

    used: Bool[np.ndarray, " samples"]
    residuals: Float[np.ndarray, " samples"]
    metrics: dict[str, Metrics | None]
    noise: Noise
    score: float


def evidence(
    record: Record,
    parts: Parts,
    predicted: Float[np.ndarray, " samples"],
    dropped: bool,
    held_out: float,
    free: int = 0,
) -> Evidence:
    """Judge a prediction on the rows it was fitted to, given its mean squared error where it was not.

    `dropped`: the conditioning cycle was left out of the fit; `held_out`: mean squared error on the
    held-out parts; `free`: how many parameters were fitted.
    """
    used = np.isin(parts.label, parts.without_conditioning(parts.fitted, dropped))
    residuals = np.where(record.mask, predicted - record.output, np.nan)
    weighted = residuals * record.weights
    sequences = [weighted[rows][used[rows]] for _, rows in record.sequences() if used[rows].any()]
    return Evidence(
        used,
        residuals,
        {"train": metrics(record.output, predicted, used, record.weights), "test": None},
        estimate_noise(sequences, free),
        100 * float(np.sqrt(held_out)) / float(np.ptp(record.output[record.mask])),
    )
