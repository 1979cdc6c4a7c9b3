"""What a fit predicts behind known rows."""

from typing import Any

import numpy as np

from hysteresis import InputError, Record
from hysteresis.models._extrapolation import extended

from ..records._from_known import RELATIVE, FromKnown, Misfit, from_known


def misfit_of(fit: Any) -> Misfit:
    """What the model of a fit errs by on its training rows, and how long an error lasts."""
    error, relative = fit.metrics["train"], fit.train.sigma_name == RELATIVE
    rms = 0.0 if error is None else error.rmse
    rms = rms / fit.train.typical_sigma if relative else rms
    return Misfit(rms, relative, fit.noise.correlation_time / 2)


def told(fit: Any, record: Record) -> FromKnown:
    """Outputs on a record as the model sees it, and their deviation for want of knowing the first state.

    Raises `InputError` `wrong-unit` where the output has another unit than the fit's.
    """
    check_unit(record.output_name, record.output_unit, fit.train.output_unit)
    if fit.sequences is not None:
        return FromKnown(*fit.sequences.predicted(record))
    low, high = float(np.nanmin(record.input)), float(np.nanmax(record.input))
    return from_known(extended(fit.model, low, high), record, misfit_of(fit))


def check_unit(name: str, unit: str, fitted: str) -> None:
    """Raise `InputError` where a column is in another unit than it was fitted in, and both are known."""
    if unit != fitted and "1" not in (unit, fitted):
        raise InputError(
            "wrong-unit",
            f"{name} is in {unit}; the model was fitted to {fitted}.",
            cause="another quantity, or the same in another unit.",
            fix=f"give the column in {fitted}, and say so in its header.",
        )
