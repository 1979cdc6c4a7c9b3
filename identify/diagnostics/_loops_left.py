"""How wide the loops of a record are, and how much of that the residuals of a fit keep."""

import hashlib
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool

from hysteresis import Record
from hysteresis.records._cycles import loop_sums, noise_level
from hysteresis.records._excitation import WIDER

from ..results._fit_result import FitResult

SMALLEST = 1e-3
"""A loop counts if it is wider than this part of the output's range, and than `WIDER` times the noise."""


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
        return self.width > max(WIDER * self.noise, SMALLEST * self.span)

    @property
    def share(self) -> float:
        """Part of the width that the fit does not describe."""
        return self.left / self.width


def loops_left(fit: FitResult) -> LoopsLeft:
    """Loops in the measured output and in the residuals, over the rows that were fitted."""
    width, noise, span = _measured(fit.train, fit.used)
    return LoopsLeft(width, loop_sums(fit.train, fit.residuals, fit.used).width, noise, span)


_known: "WeakKeyDictionary[Record, dict[bytes, tuple[float, float, float]]]" = WeakKeyDictionary()


def _measured(record: Record, used: Bool[np.ndarray, " samples"]) -> tuple[float, float, float]:
    """Width, noise and span of the measured loops: once for all candidates of a fit."""
    rows_used = hashlib.sha256(used.tobytes()).digest()
    known = _known.setdefault(record, {})
    if rows_used not in known:
        y, parts = record.output, [rows for _, rows in record.sequences()]
        noise = [noise_level(y[rows][used[rows]]) for rows in parts if used[rows].any()]
        known[rows_used] = (
            loop_sums(record, y, used).width,
            float(np.median(noise)) if noise else 0.0,
            float(np.ptp(y[used])) if used.any() else 0.0,
        )
    return known[rows_used]
