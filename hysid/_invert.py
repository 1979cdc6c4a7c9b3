"""`hysid.invert`: the compensator of a fit, guarded by what the fit has seen."""

from typing import Any

from compensate import AbstractCompensator
from compensate import invert as invert_model
from hysteresis import AbstractModel
from identify import FitResult


def invert(
    fit_or_model: FitResult | AbstractModel, *arguments: Any, **options: Any
) -> AbstractCompensator:
    """`compensate.invert` of a model, or of a fit with its estimates limited to the trained inputs.

    ```math
    \\hat u = \\mathrm{clip}(\\hat u_\\text{inverse}, low, high)
    ```

    where low and high are the least and the greatest input of the training rows.

    **Arguments:** a fit of one input, or a model; the others are those of `compensate.invert`. `beyond` and
    `start` choose another guard, and `trained` another range.

    **Raises:** `InputError` where the model has no inverse, see `compensate.invert`.

    **Example:**

        >>> found = hysid.invert(fit).simulate(None, [30.0, 1e9])
        >>> [compensate.Status(int(s)).name for s in found.status]
        ['OK', 'EXTRAPOLATED']
    """
    if isinstance(fit_or_model, FitResult):
        options = {"trained": fit_or_model.trained} | options
        fit_or_model = fit_or_model.model
    return invert_model(fit_or_model, *arguments, **options)
