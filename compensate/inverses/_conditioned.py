"""Inverse of a model that depends on a condition, given the output and the condition."""

from hysteresis import AbstractModel, Conditioned, InputError
from hysteresis._parameter import is_concrete
from hysteresis.models._conditioned import last_factor
from hysteresis.trees import search_range

from .._contract import AbstractCompensator
from ._bisection import BracketedCompensator
from ._inverse_of import inverse_of
from ._law import LawCompensator, has_laws


@inverse_of.register
def _(model: Conditioned) -> AbstractCompensator:
    for one in model.models:
        inverse_of(one)  # refuses a model that has no inverse
    falls = {_falls(one) for one in model.models}
    if len(falls) > 1:
        raise InputError(
            "not-invertible",
            f"the output rises with the input at some values of {model.condition}, and falls at others.",
            fix="fit the conditions apart (--each COL).",
        )
    if has_laws(model):
        return LawCompensator(model)
    return BracketedCompensator(model, *search_range(model))


def _falls(model: AbstractModel) -> bool:
    factor = last_factor(model)
    return is_concrete(factor) and float(factor) < 0
