"""How wide the loops of a record are, and how much of that the residuals of a fit keep."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record
from hysteresis.records._cycles import loop_sums, noise_level

from ..results._fit_result import FitResult

NOISE, SMALLEST = 3.0, 1e-3
"""A loop counts if it is wider than this times the noise, and than this part of the output's range."""


class LoopsLeft(NamedTuple):
    """Mean distance between rising and falling branches of the fitted rows, in the output's unit.

    - `width`: of the measured loops. `left`: of the residuals over the same input. NaN without a loop.
    - `noise`: standard deviation of the reading from row to row; two branches with nothing but noise are
      1.1 times that apart. `span`: range of the output.
    """

    width: float
    left: float
    noise: float
    span: float

    @property
    def are_there(self) -> bool:
        """Whether there are loops that the noise cannot make."""
        return self.width > max(NOISE * self.noise, SMALLEST * self.span)

    @property
    def share(self) -> float:
        """Part of the width that the fit does not describe."""
        return self.left / self.width


def loops_left(fit: FitResult) -> LoopsLeft:
    """Loops in the measured output and in the residuals, over the rows that were fitted."""
    record, used = fit.train, fit.used
    y = record.output
    noise = [noise_level(y[rows][used[rows]]) for _, rows in record.sequences() if used[rows].any()]
    return LoopsLeft(
        _width(record, y, used),
        _width(record, fit.residuals, used),
        float(np.median(noise)) if noise else 0.0,
        float(np.ptp(y[used])) if used.any() else 0.0,
    )


def _width(
    record: Record, values: Float[np.ndarray, " samples"], used: Bool[np.ndarray, " samples"]
) -> float:
    sums = [loop_sums(record.input[r], values[r], used[r]) for _, r in record.sequences()]
    _, total, span = np.sum(sums, axis=0)
    return float(total / span) if span > 0 else float("nan")
