"""Goodness of fit: residuals, errors and noise on the rows that a model was fitted to."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record

from ..noise._residual_statistics import Noise, estimate_noise
from ..records._folds import Parts

# Error figures: root mean square, normalised, largest, and R^2.


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


# The figures of a baseline, and which one of several is the best.


class Baseline(NamedTuple):
    """A simple predictor on the folds, the training rows and the held-out rows of a fit.

    - `name`: such as "straight line". `score`: held-out NRMSE (%) inside the training part, as a fit's.
    - `metrics`: {"train": Metrics, "test": Metrics or None}.
    - `blocks`, `test_blocks`: mean squared errors of the held-out parts, and of the test rows, in blocks of
      consecutive rows, paired with those of a fit.
    - `residuals`: predicted - measured on the training rows, NaN where not counted; None of a fit that was
      loaded.
    """

    name: str
    score: float
    metrics: dict[str, Metrics | None]
    blocks: Float[np.ndarray, " blocks"]
    test_blocks: Float[np.ndarray, " test_blocks"] | None = None
    residuals: Float[np.ndarray, " samples"] | None = None

    @property
    def judged(self) -> tuple[float, float]:
        """Rms error, in the output's unit, and NRMSE (%): of the test rows, else of the held-out parts."""
        if (test := self.metrics["test"]) is not None:
            return test.rmse, test.nrmse_percent
        return (float(np.sqrt(self.blocks.mean())) if len(self.blocks) else np.nan), self.score

    @property
    def document(self) -> dict[str, Any]:
        """Plain data for JSON: the figures."""
        rmse, percent = self.judged
        return {
            "name": self.name,
            "nrmse_percent": percent,
            "rmse": rmse,
            "score_percent": self.score,
            "metrics": {k: None if m is None else m._asdict() for k, m in self.metrics.items()},
            "blocks": self.blocks,
            "test_blocks": self.test_blocks,
        }

    @classmethod
    def of(cls, document: dict[str, Any]) -> "Baseline":
        """The inverse of `document`, decoded."""
        test_blocks = document["test_blocks"]
        return cls(
            document["name"], document["score_percent"], document["metrics"],
            np.array(document["blocks"], float),
            None if test_blocks is None else np.array(test_blocks, float),
        )  # fmt: skip


def best_baseline(baselines: Iterable[Baseline]) -> Baseline | None:
    """The one with the least error where fits are judged; None where there is none."""
    known = [one for one in baselines if np.isfinite(one.judged[0])]
    return min(known, key=lambda one: one.judged[0], default=None)


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
    held_out: float,
    free: int = 0,
) -> Evidence:
    """Judge a prediction on the rows it was fitted to, given its mean squared error where it was not.

    `held_out`: mean squared error on the held-out parts; `free`: how many parameters were fitted.
    """
    used = np.isin(parts.label, parts.fitted)
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
