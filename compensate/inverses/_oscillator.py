"""An oscillator has no inverse sample by sample."""

from hysteresis import CoupledOscillators, InputError, Oscillator

from .._contract import AbstractCompensator
from ._inverse_of import inverse_of


@inverse_of.register
def _(model: Oscillator) -> AbstractCompensator:
    """Raises `InputError`: the mass answers to a force only in its second derivative."""
    raise InputError(
        "not-invertible",
        "the force of an oscillator cannot be recovered sample by sample.",
        cause="its mass answers with an acceleration, and the second derivative of a noisy displacement is"
        " noise.",
        fix="hysteresis.input_force(model, t, displacement, band=...) estimates the force in a band of"
        " frequencies from a whole record; invert(model.hysteresis) is the inverse without the mass.",
    )


@inverse_of.register
def _(model: CoupledOscillators) -> AbstractCompensator:
    """Raises `InputError`: masses answer to a force only in their second derivatives."""
    raise InputError(
        "not-invertible",
        "the force on coupled oscillators cannot be recovered sample by sample.",
        cause="a mass answers with an acceleration, and the second derivative of a noisy displacement is"
        " noise.",
        fix="invert(model.hysteresis[k]) is the inverse of a link without the masses.",
    )
