"""What every rig says of an argument that it cannot take."""

from collections.abc import Collection
from dataclasses import fields
from typing import Any

import numpy as np

from .._errors import InputError


def fault(rig: str, problem: str, fix: str) -> InputError:
    """The error to raise, with the rig's name as its place."""
    return InputError("bad-option", problem, place=rig, fix=fix)


def require(rig: str, holds: bool, problem: str, fix: str) -> None:
    """Raises it where something does not hold."""
    if not holds:
        raise fault(rig, problem, fix)


def check_fields(rig: Any, at_zero: Collection[str] = (), other: Collection[str] = ()) -> None:
    """Raises it where a field of a rig is not finite and above 0.

    Those `at_zero` may be 0; `other` ones are not looked at.
    """
    for one in fields(rig):
        if one.name in other:
            continue
        value, zero = np.asarray(getattr(rig, one.name), float), one.name in at_zero
        require(
            type(rig).__name__,
            bool(np.all(np.isfinite(value) & ((value >= 0) if zero else (value > 0)))),
            f"{one.name} = {getattr(rig, one.name)} is out of range.",
            f"Give a finite number {'of 0 or more' if zero else 'above 0'}.",
        )
