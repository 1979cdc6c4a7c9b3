"""What a record is given, as rows of numbers of one length."""

import numpy as np
from numpy.typing import ArrayLike

from .._errors import InputError


def numbers(name: str, values: ArrayLike) -> np.ndarray:
    """A copy as float64. Raises `InputError` `not-numbers`."""
    try:
        return np.array(values, float)
    except (TypeError, ValueError) as error:
        raise InputError(
            "not-numbers", f"{name} is no row of numbers: {error}.", fix="give real numbers."
        ) from error


def same_length(**arrays: np.ndarray | None) -> None:
    """Raise `InputError` `length-mismatch` where one is no row, or they differ."""
    shapes = {name: x.shape for name, x in arrays.items() if x is not None}
    if any(len(shape) != 1 for shape in shapes.values()):
        raise InputError("length-mismatch", f"Each must be one row of numbers; have {shapes}.")
    (name, (n,)), *rest = shapes.items()
    for other, (m,) in rest:
        if m != n:
            raise InputError("length-mismatch", f"{name} has {n} values, {other} {m}.")


def fill(x: np.ndarray, t: np.ndarray) -> None:
    """Put straight lines over `t` where `x` is not finite, and the nearest value at its ends."""
    good = np.isfinite(x)
    if good.any():
        x[~good] = np.interp(t[~good], t[good], x[good])
