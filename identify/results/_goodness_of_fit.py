"""Goodness of fit: residuals, errors and noise on the rows that a model was fitted to."""

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize_scalar

from hysteresis import InputError, Record

from ..noise._model import rows_of
from ..noise._residual_statistics import Noise, estimate_noise
from ..records._folds import Parts

if TYPE_CHECKING:
    from ._fit_result import FitResult


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


# Criteria of a fit's own likelihood.

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
