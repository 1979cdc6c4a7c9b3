"""Linear sponges by least squares in closed form: a row of the table in 0.1 ms, without a fit."""

from typing import Any

import numpy as np

from hysteresis import Record

from ..fitting._verdict import USABLE
from ..noise._arithmetic import Rows
from ..parametric._maximum_likelihood import plainest
from ..parametric._standard_errors import covariance_of
from ._folder import parameter_cells

ROWS, CORRELATION = 20, 0.6
"""Least rows and correlation with the input of a record that certainly passes `check_identifiable`."""


def line_row(record: Record, threshold: float) -> dict[str, Any] | None:
    """The row of the `LinearSponge` that has the least squares, its noise Gaussian; None where `fit` itself
    has to tell whether the record identifies one."""
    u, y = record.input[record.mask], record.output[record.mask]
    if len(u) < ROWS or record.channels or record.sigma is not None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.mean((u - u.mean()) * (y - y.mean())) / (u.std() * y.std())
    touched = u >= threshold
    if not correlation > CORRELATION or np.ptp(u[touched]) == 0:
        return None
    J = np.column_stack([np.where(touched, u, 0.0), touched])
    values = np.linalg.lstsq(J, y, rcond=None)[0]
    residuals = J @ values - y
    none, one = np.zeros(len(u)), np.ones(len(u))
    found, _ = plainest(values, residuals, J, Rows(one > 0, none, none, none, none[:, None], one))
    errors = found.wider * np.sqrt(np.diagonal(covariance_of(found.root, 1.0)))
    rmse = float(np.sqrt(np.mean(residuals**2)))
    nrmse = 100 * rmse / float(np.ptp(y))
    row = {
        "model": "LinearSponge", "trusted": nrmse <= USABLE and rmse < float(np.std(y)), "rmse": rmse,
        "nrmse_percent": nrmse, "sigma": float(found.noise.sigma), "correlation_time": 1.0,
    }  # fmt: skip
    for name, value, error in zip(("K", "b"), values, errors, strict=True):
        row |= parameter_cells(name, float(value), float(error), "free")
    return row
