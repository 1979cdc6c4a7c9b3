"""The figures of a baseline, and which one of several is the best."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ._metrics import Metrics


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
