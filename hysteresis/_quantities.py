"""Units of a model's input, output and time, and their conversion."""

from collections.abc import Iterable
from dataclasses import fields
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ._errors import InputError
from ._format import SAID, is_within_grammar
from ._parameter import as_float, is_concrete

Module = TypeVar("Module")

_USUAL = {
    unit: (quantity, Fraction(size))
    for quantity, units in SAID["sizes"].items() for unit, size in units.items()
}  # fmt: skip

FORCE, LENGTH, TIME = "N", "m", "s"
"""The units in which contacts are solved."""


class Units(NamedTuple):
    """The units of a model's input, output and clock, as its record has them. "1" is none.

    **Example:**

        >>> hysteresis.internal.Units("N", "mm").reversed
        Units(input='mm', output='N', time='s')
    """

    input: str
    output: str
    time: str = "s"

    @property
    def reversed(self) -> "Units":
        """The units of the inverse."""
        return Units(self.output, self.input, self.time)

    @property
    def are_known(self) -> bool:
        """Whether input and output have a unit."""
        return "1" not in (self.input, self.output)


@cache
def conversion(unit: str, wanted: str) -> float | None:
    """What one `unit` is in the `wanted` unit; None where they are not units of one quantity.

    **Example:**

        >>> hysteresis.internal.conversion("gf", "N"), hysteresis.internal.conversion("inch", "mm")
        (0.00980665, 25.4)
        >>> hysteresis.internal.conversion("mm", "N") is None
        True
    """
    if unit == wanted:
        return 1.0
    if not (is_within_grammar(unit) and is_within_grammar(wanted)):
        return None
    if unit in _USUAL and wanted in _USUAL:
        (quantity, size), (other, wanted_size) = _USUAL[unit], _USUAL[wanted]
        return float(size / wanted_size) if quantity == other else None
    import pint  # late: it takes long to load

    try:
        ratio = pint.get_application_registry().Quantity(1.0, unit).to(wanted).magnitude
        twice = pint.get_application_registry().Quantity(2.0, unit).to(wanted).magnitude
    except Exception:  # pint raises its own, tokenizer's and arithmetic errors for odd text
        return None
    return float(ratio) if abs(twice - 2 * ratio) <= 1e-12 * abs(ratio) else None  # no offset


def with_units(module: Module, units: Units | None, trained: Any = None) -> Module:
    """The same model or compensator with these units, and with a range of inputs if one is given.

    **Example:**

        >>> from hysteresis.internal import Units, with_units
        >>> sponge = hysteresis.LinearSponge(K=0.05, b=0.2)
        >>> with_units(sponge, Units("kgf", "cm"), (0.2, 2.0)).units.output
        'cm'
    """
    new: Any = object.__new__(type(module))
    for field in fields(module):  # type: ignore[arg-type]
        if hasattr(module, field.name):
            object.__setattr__(new, field.name, getattr(module, field.name))
    object.__setattr__(new, "units", units)
    if trained is not None:
        object.__setattr__(new, "trained", as_range(trained))
    return new


def require_same(columns: Iterable[tuple[str, str, str]]) -> None:
    """Raise `InputError` `wrong-unit` where a column, (name, unit, wanted unit), is in another unit than
    wanted, and both are known."""
    for name, unit, wanted in columns:
        if unit != wanted and "1" not in (unit, wanted):
            raise InputError(
                "wrong-unit",
                f"{name} is in {unit}; the model was fitted to {wanted}.",
                cause="another quantity, or the same in another unit.",
                fix=f"give the column in {wanted}, and say so in its header.",
            )


def as_units(words: Any) -> Units | None:
    """`Units` of a tuple of words; None stays None."""
    return None if words is None else Units(*words)


def as_range(ends: Any) -> Any:
    """(low, high) as an array; None stays None.

    Raises `InputError` `zero-range` where low is not below high.
    """
    ends = as_float(ends if ends is None or hasattr(ends, "shape") else np.asarray(ends, float))
    if ends is not None and is_concrete(ends) and ends.shape == (2,):
        low, high = np.asarray(ends)
        if not low <= high:
            said = f"the trained inputs reach from {low:g} to {high:g}."
            raise InputError("zero-range", said, fix="give (low, high).")
    return ends
