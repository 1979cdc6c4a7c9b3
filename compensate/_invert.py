"""`invert`: the inverse of a fitted model, or of many draws of one."""

from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, parameters

from ._contract import AbstractCompensator
from .inverses import inverse_of
from .uncertainty._ensemble import EnsembleCompensator


def invert(
    model: AbstractModel, output_sigma: ArrayLike | None = None, seed: int = 0
) -> AbstractCompensator:
    """The exact inverse of a fitted model, as a compensator.

    Of many models, such as `Posterior.model`, an `EnsembleCompensator`, which tells how far their
    estimates lie apart; `output_sigma` and `seed` are its own.

    Raises `InputError` where the model has no inverse: a decreasing stage, a signed density, no slope.

    **Example:**

        >>> y = model.simulate(t, u)
        >>> compensate.invert(model).simulate(t, y).value.round(6).tolist() == u.tolist()
        True
    """
    if min((value.ndim for _, _, value in parameters(model) if value is not None), default=0):
        return EnsembleCompensator(model, output_sigma, seed)
    if output_sigma is not None:
        raise InputError(
            "not-invertible",
            "one model's inverse has no spread for a reading's noise to add to.",
            fix="FilteredCompensator(model, input_step, output_sigma), or invert(posterior.model, ...).",
        )
    return inverse_of(model)
