"""Loads and deformations, told by their units: which of them the input is."""

from typing import Literal

from .._quantities import conversion
from ._abstract_record import AbstractRecord

LOADS = ("N", "Pa", "N*m")
DEFORMATIONS = ("m", "rad", "percent")
"""One unit of each quantity. A ratio, as of a strain, is one only beside a load."""


def kind_of_units(record: AbstractRecord) -> Literal["creep", "relaxation"] | None:
    """Creep where a load is the input and a deformation is read, relaxation the other way round.

    None where the units do not say: they are unknown, or neither of the two is a load.
    """
    units = record.input_unit, record.output_unit
    is_load, deforms = (
        [any(conversion(unit, one) is not None for one in known) for unit in units]
        for known in (LOADS, DEFORMATIONS)
    )
    # "1" may be any quantity that nobody named.
    deforms = [yes and unit != "1" for yes, unit in zip(deforms, units, strict=True)]
    if is_load[0] and deforms[1]:
        return "creep"
    return "relaxation" if deforms[0] and is_load[1] else None


def over(one: str, other: str) -> str:
    """The unit of a quotient."""
    return one if other == "1" else f"{one} / {other}"


def times(one: str, other: str) -> str:
    """The unit of a product."""
    return one if other == "1" else other if one == "1" else f"{one} * {other}"
