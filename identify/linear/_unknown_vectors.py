"""Vectors of unknowns: in units of the output's range about its mean, in its own unit, and as matrices.

Equations are made of outputs less their mean: a column that lies a million times its range away from zero
would otherwise keep four digits.
"""

from typing import Any, Protocol, TypeAlias, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

Values: TypeAlias = Array | np.ndarray


@runtime_checkable
class OutputUnits(Protocol):
    """What a kind of unknowns says of the output, which is `centre` + `scale` times what they give.

    - `offsets`: which unknowns are an offset.
    """

    @property
    def scale(self) -> float: ...
    @property
    def centre(self) -> float: ...
    @property
    def offsets(self) -> slice: ...


def relative(meaning: OutputUnits, y: np.ndarray) -> np.ndarray:
    """An output about `centre`, over `scale`."""
    return (y - meaning.centre) / meaning.scale


def in_units(meaning: OutputUnits, unknowns: Any) -> Any:
    """Vectors of unknowns in the unit of the output, whose mean joins the offset; NumPy or JAX."""
    mean = np.zeros(unknowns.shape[-1])
    mean[meaning.offsets] = meaning.centre
    return meaning.scale * unknowns + mean


def split(values: Values, rows: int, columns: int) -> tuple[Values, Values]:
    """A matrix (rows, columns) and what follows it."""
    count = rows * columns
    return values[:count].reshape(rows, columns), values[count:]


def upper_triangular(n: int, values: Values) -> Values:
    """An upper triangular matrix of its n (n + 1) / 2 entries, column by column."""
    j, i = np.tril_indices(n)
    if isinstance(values, np.ndarray):
        found = np.zeros((n, n))
        found[i, j] = values
        return found
    return jnp.zeros((n, n), values.dtype).at[i, j].set(values)
