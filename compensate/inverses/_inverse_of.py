"""`inverse_of`: the inverse of one model, by its kind."""

from functools import singledispatch

from hysteresis import AbstractModel, InputError

from .._contract import AbstractCompensator


@singledispatch
def inverse_of(model: AbstractModel) -> AbstractCompensator:
    """`invert` of one kind of model; each kind registers its own."""
    raise InputError(
        "not-invertible",
        f"no inverse is known for {type(model).__name__}.",
        fix="BracketedCompensator(model, low, high), if its output rises with its input.",
    )
