"""`hysid.invert`: the compensator of a fit, guarded by what the fit has seen, with its error."""

from dataclasses import replace
from typing import Any

import numpy as np

from compensate import AbstractCompensator, CalibratedCompensator, calibrated, estimate
from compensate import invert as invert_model
from hysteresis import AbstractModel, Record
from hysteresis.numerics._normal import NORMAL_95
from identify import FitResult


def invert(
    fit_or_model: FitResult | AbstractModel, *arguments: Any, **options: Any
) -> AbstractCompensator:
    """`compensate.invert` of a model; or of a fit, limited to the trained inputs and with a deviation.

    ```math
    \\hat u = \\mathrm{clip}(\\hat u_\\text{inverse}, low, high)
    ```

    where low and high are the least and the greatest input of the training rows. The deviation of a fit's
    estimates is the error of the model by level and branch, see `calibrated`, times the error on held-out
    parts of the training rows over that on fitted ones. Value +- 1.645 deviations should hold nine of ten
    inputs; `coverage` is the part of the test rows that they do hold, NaN without test rows. Draws of a
    posterior, `invert(posterior.model)`, tell what the parameters alone leave open, which is less.

    **Arguments:** a fit of one input, or a model; the others are those of `compensate.invert`. `beyond` and
    `start` choose another guard, and `trained` another range.

    **Raises:** `InputError` where the model has no inverse, see `compensate.invert`.

    **Example:**

        >>> found = hysid.invert(fit).simulate(None, [30.0, 1e9])
        >>> [compensate.Status(int(s)).name for s in found.status]
        ['OK', 'EXTRAPOLATED']
    """
    if not isinstance(fit_or_model, FitResult):
        return invert_model(fit_or_model, *arguments, **options)
    fit = fit_or_model
    guarded = invert_model(fit.model, *arguments, **({"trained": fit.trained} | options))
    own = fit.metrics["train"]
    further = 1.0
    if own is not None and own.nrmse_percent > 0 and np.isfinite(fit.score):
        further = max(1.0, fit.score / own.nrmse_percent)
    known = invert_model(fit.model, trained=fit.trained)
    learnt = calibrated(known, fit.train, ahead=further**2)
    learnt = replace(learnt, has_draws=False, units=guarded.units)
    if fit.test is not None:
        learnt = replace(learnt, coverage=_coverage(learnt, fit.test))
    return learnt.around(guarded)


def _coverage(band: CalibratedCompensator, record: Record) -> float:
    """Of the counted rows with a reading."""
    found = estimate(band, record)
    used = record.mask & np.isfinite(record.output)
    off = np.abs(np.asarray(found.value) - record.input)
    return (
        float((off <= NORMAL_95 * np.asarray(found.deviation))[used].mean())
        if used.any()
        else np.nan
    )
