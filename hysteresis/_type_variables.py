"""Types of models. Type checkers see defaults, so that the bare name of a generic class is a whole type."""

from typing import TYPE_CHECKING, Any

from jaxtyping import Array, Float

if TYPE_CHECKING:
    from typing_extensions import TypeVar

    PyTree = Any  # what jaxtyping exports is not a type to them

    State = TypeVar("State", default=Any)
    Prepared = TypeVar("Prepared", default=Any)
    Pairs = TypeVar("Pairs", default=Any)
    Table = TypeVar("Table", default=Any)
else:  # beartype, which the tests check types with, refuses defaults
    from typing import TypeVar

    from jaxtyping import PyTree as PyTree

    State, Prepared, Pairs, Table = map(TypeVar, ("State", "Prepared", "Pairs", "Table"))

Output = Float[Array, " samples"]

Series = Output | Any
"""A time series on the way in: anything `jnp.asarray` takes, one-dimensional."""

Times = Series | None
"""Of a series; None where the rate does not matter."""

Starts = tuple[int, ...]
"""First samples of independent sequences."""
