"""Parameters: fields that carry their unit, bounds and role beside the value."""

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ._errors import InputError

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


Scalar = Float[Array, ""] | float
"""A scalar parameter: given as a number, kept as an array."""


@dataclass(frozen=True)
class ParameterInfo:
    """What is known about a parameter before any data: its unit, its bounds, its meaning.

    - `unit`: in terms of the record's columns, e.g. `"input / output"`; see `in_units`.
    - `bounds`: the open interval the value must lie in. `at`: its ends that belong to it, "low", "high" or
      "low high"; None for bounds that a model does not insist on.
    - `fixed`: a fit does not change it.
    - `meaning`: in the terms of the field.
    """

    unit: str = "1"
    bounds: tuple[float, float] = (-float("inf"), float("inf"))
    fixed: bool = False
    meaning: str = ""
    at: str | None = ""

    def in_units(self, words: dict[str, str]) -> str:
        """The unit in a record's own units: "input / output" -> "N / mm"."""
        units = [words.get(word, word) for word in self.unit.split()]
        while len(units) > 1 and units[-1] == "1" and units[-2] in ("*", "/"):
            units = units[:-2]
        return " ".join(units)


KEPT = "kept"
"""Metadata of a field of models that stay as they are: none of their numbers is a parameter."""


def parameter(
    default: Any = MISSING,
    *,
    unit: str = "1",
    bounds: tuple[float, float] = (-float("inf"), float("inf")),
    fixed: bool = False,
    meaning: str = "",
    at: str | None = "",
) -> Any:
    """A model field that a fit may change. Becomes a floating JAX array.

    **Arguments:** as `ParameterInfo`; without a `default` the field has to be given. None, where it is
    the default, says that the model has no such part.

    **Example:**

        >>> class Spring(eqx.Module):
        ...     k: float = hysteresis.parameter(unit="N / mm", bounds=(0.0, np.inf))
        >>> [(name, info.unit, info.bounds) for name, info, _ in hysteresis.parameters(Spring(2.0))]
        [('k', 'N / mm', (0.0, inf))]
    """
    info = ParameterInfo(unit, bounds, fixed, meaning, at)
    return eqx.field(converter=as_float, metadata={"parameter": info}, default=default)


POSITIVE: dict[str, Any] = {"bounds": (0.0, float("inf"))}
NOT_NEGATIVE: dict[str, Any] = {**POSITIVE, "at": "low"}
"""Bounds of parameters, as arguments of `parameter`: finite and above 0, and of 0 or more."""


def check_bounds(model: eqx.Module) -> None:
    """Raise `InputError` where one of a model's own parameters is known, and not within its bounds."""
    for field in fields(model):
        info, value = field.metadata.get("parameter"), getattr(model, field.name)
        if info is None or info.at is None or not is_concrete(value):
            continue
        (low, high), x = info.bounds, np.asarray(value)
        inside = ((x > low) | (("low" in info.at) & (x == low))) & (
            (x < high) | (("high" in info.at) & (x == high))
        )
        if inside.all() or not np.isfinite(info.bounds).any():
            continue
        wanted = []
        if low > -np.inf:
            wanted.append(f"{'at least' if 'low' in info.at else 'above'} {low:g}")
        if high < np.inf:
            wanted.append(f"{'at most' if 'high' in info.at else 'below'} {high:g}")
        elif "high" not in info.at:
            wanted.append("finite")
        raise InputError(
            "parameter-out-of-bounds",
            f"{field.name} = {x} ({info.meaning or 'a parameter'}) is not {' and '.join(wanted)}.",
            cause="a sign or a unit slipped.",
            fix=f"keep {field.name} {' and '.join(wanted)}.",
        )


def check_increasing(name: str, value: Any) -> None:
    """Raise `InputError` where numbers that are known are not finite or do not increase."""
    x = np.asarray(value, float) if is_concrete(value) else np.zeros(0)
    if not (np.isfinite(x).all() and np.all(np.diff(x) > 0)):
        said = f"{name} = {value}."
        raise InputError("parameter-out-of-bounds", said, fix=f"keep {name} finite and increasing.")


def check_range(what: str, low: float, high: float) -> None:
    """Raise `InputError` where `what` reaches from `low` to a `high` that is not above it."""
    if not low < high:
        said = f"{what} from {low:g} to {high:g}."
        mend = "give low < high, enclosing the inputs the model will see."
        raise InputError("zero-range", said, fix=mend)


def check_shapes(least: int = 0, stacked: bool = True, /, **given: tuple[Any, str]) -> None:
    """Raise `InputError` where arrays do not fit each other: (array, its axes), None for no array.

    Axes are numbers, or words for lengths of `least` or more, the same in all arrays. Others may stand
    before them, unless arrays are not to be `stacked`.
    """
    first: dict[str, tuple[str, int]] = {}
    for name, (value, said) in given.items():
        if value is None:
            continue
        shape, axes = np.shape(value), said.split()
        own = shape[-len(axes) :]
        for axis, n in zip(axes, own, strict=False):
            first.setdefault(axis, (name, int(axis) if axis.isdigit() else max(n, least)))
        wanted = tuple(first[axis][1] for axis in axes if axis in first)
        if len(own) < len(axes) or own != wanted or (len(shape) > len(own) and not stacked):
            names = dict.fromkeys([*(first[axis][0] for axis in axes if axis in first), name])
            shapes = " and ".join(str(np.shape(given[one][0])) for one in names)
            raise InputError(
                "length-mismatch",
                f"the shapes of {' and '.join(names)} are {shapes}.",
                fix=f"give {', '.join(f'{one} ({given[one][1]})' for one in names)}"
                f"{f', of {least} or more' if least else ''}.",
            )


def as_float(value: Any) -> Any:
    """`value` as a floating array, integers in JAX's present default precision; None stays None."""
    if value is None:
        return value
    whole = isinstance(value, np.ndarray) and value.dtype.kind in "iub"
    # Python's numbers would be of weak type, for which JAX compiles every program once more.
    if whole or isinstance(value, int | float):
        value = np.asarray(value, float)
    array = as_array(value)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else jnp.asarray(value, float)


def as_array(value: Any) -> Array:
    """As `jnp.asarray`, without the program of 20 ms that it compiles for every shape of NumPy's arrays."""
    own = isinstance(value, np.ndarray) and value.dtype.kind in "fiub"
    if own and not value.dtype.isnative:  # as files of other machines have it
        value = value.astype(value.dtype.newbyteorder())
    return jax.device_put(value) if own else jnp.asarray(value)


def is_concrete(value: Any) -> bool:
    """Whether `value` can be looked at now: not traced by `jit`, `vmap` or `grad`."""
    return eqx.is_array_like(value) and not isinstance(value, Tracer)


def array_module(*values: Any) -> Any:
    """NumPy where all values can be looked at now, because it compiles nothing; else `jax.numpy`."""
    return np if all(value is None or is_concrete(value) for value in values) else jnp


def parameters(model: eqx.Module) -> Iterator[tuple[str, ParameterInfo, Any]]:
    """Every parameter of a model, those of its parts with a dotted name: (name, info, value).

    **Example:**

        >>> for name, info, value in hysteresis.parameters(hysteresis.LinearSponge(K=1.3, b=6.0)):
        ...     print(name, float(value), info.unit)
        K 1.3 output / input
        b 6.0 output
        threshold -inf input
    """
    for field in fields(model):
        value = getattr(model, field.name)
        info = field.metadata.get("parameter")
        if info is not None:
            yield field.name, info, value
        if info is not None or field.metadata.get(KEPT):
            continue
        parts = {field.name: value}
        if isinstance(value, tuple):
            parts = {f"{field.name}.{k}": part for k, part in enumerate(value)}
        for path, part in parts.items():
            if isinstance(part, eqx.Module):
                for name, nested, inner in parameters(part):
                    yield f"{path}.{name}", nested, inner


def parameter_at(model: eqx.Module, name: str) -> Any:
    """The parameter of a dotted name, as `parameters` gives them."""
    place: Any = model
    for step in name.split("."):
        place = place[int(step)] if step.isdigit() else getattr(place, step)
    return place


def size_of_inputs(model: eqx.Module) -> Float[Array, ""]:
    """The largest size that a parameter gives to inputs; 1 where none has their unit."""
    found = [(info.unit, value) for _, info, value in parameters(model) if value is not None]
    given = {unit: [v for one, v in found if one == unit] for unit in ("input", "1 / input")}
    xp = array_module(*(value for values in given.values() for value in values))
    one, over = (
        xp.abs(xp.concatenate([xp.zeros(1), *(xp.ravel(xp.asarray(v, float)) for v in values)]))
        for values in given.values()
    )
    sizes = xp.concatenate([one, 1 / xp.where(over > 0, over, xp.inf)])
    largest = xp.where(xp.isfinite(sizes), sizes, 0.0).max()
    return jnp.asarray(xp.where(largest > 0, largest, 1.0))


# Types of models. Type checkers see defaults, so that the bare name of a generic class is a whole type.

Output = Float[Array, " samples"]

Series = Output | Any
"""A time series on the way in: anything `jnp.asarray` takes, one-dimensional."""

Times = Series | None
"""Of a series; None where the rate does not matter."""

Starts = tuple[int, ...]
"""First samples of independent sequences."""
