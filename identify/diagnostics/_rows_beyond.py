"""Which held-out rows lie beyond the inputs, rates and hold times of the fitted ones."""

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import Record

from ..results._extrapolation import Extrapolation, RowsBeyond
from ..results._fit_result import SEAM, FitResult
from ._whiteness import speed

BAND = 0.02
"""Of the trained range: an input that stays within it is held."""


def extrapolation(fit: FitResult, predicted: Float[np.ndarray, " samples"]) -> Extrapolation | None:
    """Count and score the held-out rows beyond what was fitted; None where nothing was held out.

    `predicted`: the fit's prediction of its test record.
    """
    if (test := fit.test) is None:
        return None
    beyond = rows_beyond(fit, test)
    error = test.weights * (predicted - test.output)

    def scored(rows: np.ndarray) -> RowsBeyond:
        rows = rows & test.mask
        rmse = float(np.sqrt(np.mean(error[rows] ** 2))) if rows.any() else None
        return RowsBeyond(int(rows.sum()), rmse)

    inside = ~np.logical_or.reduce([*beyond.values()])
    return Extrapolation(*(scored(rows) for rows in (*beyond.values(), inside)))


def rows_beyond(fit: FitResult, test: Record) -> dict[str, Bool[np.ndarray, " samples"]]:
    """Of each row of `test`: is its input, a channel or a condition, its rate or the time it is held beyond
    that of the fitted rows?"""
    train, used = fit.train, fit.used
    span = float(np.ptp(train.input[used]))
    found = {"input": fit.beyond(test)}
    if train.time is None or test.time is None:
        nothing = np.zeros(len(test), bool)
        return found | {"rate": nothing, "time": nothing}
    for name, of in (
        ("rate", lambda record: np.abs(speed(record))),
        ("time", lambda record: held_for(record, BAND * span)),
    ):
        found[name] = of(test) > (1 + SEAM) * of(train)[used].max(initial=0.0)
    return found


def held_for(record: Record, band: float) -> Float[np.ndarray, " samples"]:
    """For how long the input of each row has stayed within `band` of where it then came to rest."""
    assert record.time is not None
    found = np.zeros(len(record))
    for _, rows in record.sequences():
        t, since, level = record.time[rows], 0, record.input[rows.start]
        for k, x in enumerate(record.input[rows].tolist()):
            if abs(x - level) > band:
                since, level = k, x
            found[rows.start + k] = t[k] - t[since]
    return found
