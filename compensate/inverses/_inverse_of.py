"""`inverse_of`: the inverse of one model, by its kind."""

from functools import singledispatch

from hysteresis import AbstractModel, InputError

from .._contract import AbstractCompensator


@singledispatch
def inverse_of(model: AbstractModel) -> AbstractCompensator:
    """`invert` of one model; a function of `functools.singledispatch`, by the class of the model.

    Register the inverse of a model of your own with `inverse_of.register`, as a decorator of a function
    from the model to an `AbstractCompensator`. A model without one gets a `BracketedCompensator`, after a
    check that its output rises with its input.

    Raises `InputError` `not-invertible` where the output does not rise.

    **Example:**

        >>> from compensate import inverse_of
        >>> from hysteresis import LinearSponge
        >>> type(inverse_of(LinearSponge(K=2.0))).__name__
        'LawCompensator'
    """
    raise InputError("not-a-model", f"a {type(model).__name__} is not a model.")
