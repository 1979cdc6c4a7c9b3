"""What every rig says of an argument that it cannot take."""

from collections.abc import Collection, Mapping
from dataclasses import fields
from types import MappingProxyType
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


def check_fields(
    rig: Any, at_zero: Collection[str] = (), other: Collection[str] = (),
    below: Mapping[str, float] = MappingProxyType({}),
) -> None:  # fmt: skip
    """Raises it where a field of a rig is not finite and above 0.

    Those `at_zero` may be 0; `other` ones are not looked at; some have to lie `below` a number.
    """
    for name in (one.name for one in fields(rig) if one.name not in other):
        value, high = np.asarray(getattr(rig, name), float), below.get(name, np.inf)
        least, above = "above 0", value > 0
        if name in at_zero:
            least, above = "of 0 or more", value >= 0
        said = f"{name} = {getattr(rig, name)} is out of range."
        mend = f"Give a finite number {least}{f' and below {high:g}' if high < np.inf else ''}."
        require(type(rig).__name__, bool(np.all(above & (value < high))), said, mend)


def check_step(rig: str, dt: float) -> None:
    """Raises it where a time from sample to sample is not one."""
    require(rig, bool(np.isfinite(dt) and dt > 0), f"dt = {dt} s.", "Give seconds > 0.")


def check_lengths(rig: Any, *pairs: tuple[str, str]) -> None:
    """Raises it where two fields differ in length."""
    for one, other in pairs:
        require(
            type(rig).__name__, len(getattr(rig, one)) == len(getattr(rig, other)),
            f"{one} and {other} differ in length.", "Give one of each per element.",
        )  # fmt: skip
