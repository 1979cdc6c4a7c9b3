"""Inverse of a model that depends on a condition, given the output and the condition."""

from hysteresis import Conditioned, InputError
from hysteresis._parameter import is_concrete
from hysteresis.models._conditioned import last_factor

from .._contract import AbstractCompensator
from ._bisection import inverse_of_rising
from ._inverse_of import inverse_of


@inverse_of.register
def _(model: Conditioned) -> AbstractCompensator:
    for one in model.models:
        inverse_of(one)  # refuses a model that has no inverse
    factors = [last_factor(one) for one in model.models]
    if len({is_concrete(factor) and float(factor) < 0 for factor in factors}) > 1:
        raise InputError(
            "not-invertible",
            f"the output rises with the input at some values of {model.condition}, and falls at others.",
            fix="fit the conditions apart (--each COL).",
        )
    return inverse_of_rising(model)
