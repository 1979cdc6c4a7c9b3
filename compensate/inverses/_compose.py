"""Inverses of models that are composed or depend on a condition: by laws, or by bisection without one."""

import numpy as np

from hysteresis import AbstractModel, Conditioned, InputError, Mixture, Scaled, Series, Sum
from hysteresis._parameter import is_concrete
from hysteresis.models._conditioned import last_factor
from hysteresis.trees import input_range, search_range

from .._contract import AbstractCompensator
from ._bisection import BracketedCompensator
from ._inverse_of import check_rises, inverse_of, inverse_of_rising
from ._law import LawCompensator


@inverse_of.register
def _(model: Series | Scaled) -> AbstractCompensator:
    parts = model.parts if isinstance(model, Series) else (model.inner,)
    laws = [isinstance(inverse_of(part), LawCompensator) for part in parts]  # refuses one without
    if all(laws):
        return LawCompensator(model)
    return BracketedCompensator(model, *search_range(parts[0]))


@inverse_of.register
def _(model: Sum) -> AbstractCompensator:
    if len(model.parts) == 1:
        return inverse_of(model.parts[0])
    ends = search_range(model)
    if not any(map(input_range, model.parts)) or not all(map(is_concrete, ends)):
        raise InputError(
            "not-invertible",
            "no part of the sum says over which inputs it holds, so none can be looked for.",
            fix="BracketedCompensator(model, low, high).",
        )
    return _checked(model, model.parts)


@inverse_of.register
def _(model: Mixture) -> AbstractCompensator:
    if len(model.models) == 1:
        return inverse_of(model.whole.parts[0])
    return _checked(model, model.models)


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


def _checked(model: AbstractModel, parts: tuple[AbstractModel, ...]) -> AbstractCompensator:
    if any(map(_falls, parts)):
        check_rises(model)
    return inverse_of_rising(model)


def _falls(model: AbstractModel) -> bool:
    """Whether the output of a model falls as its input rises, by its scales."""
    if isinstance(model, Scaled):
        return _falls(model.inner) != bool(is_concrete(model.factor) and np.all(model.factor < 0))
    if isinstance(model, Series):
        return sum(map(_falls, model.parts)) % 2 == 1
    return isinstance(model, Sum) and any(map(_falls, model.parts))
