"""What a compensator's document holds, as types, and whether one does."""

from math import isnan
from types import UnionType
from typing import (
    Any,
    NotRequired,
    TypedDict,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)


class Quantity(TypedDict):
    """A name and a unit."""

    name: str
    unit: str


class Condition(Quantity):
    """A condition and its known range."""

    low: float
    high: float


class Origin(TypedDict):
    """The verdict on the fit, the codes of its reasons, the date of the data."""

    verdict: str | None
    codes: list[str]
    date: str | None


class Lasting(TypedDict):
    """The part of the error's variance that lasts, and the time in which it decays."""

    share: float | None
    time: float | None


class Band(TypedDict):
    """A guaranteed band."""

    factor: float
    guarantee: float
    runs: NotRequired[int]
    by_deviation: bool
    gain: NotRequired[float]


class Operations(TypedDict):
    """How many operations a step takes, and over how many readings that was counted."""

    mean: float
    most: float
    readings: float


class Golden(TypedDict):
    """Readings and the estimates they give; null where there is none."""

    dt: list[float]
    reading: list[float]
    condition: NotRequired[list[float]]
    value: list[float | None]
    tolerance: float


class Document(TypedDict):
    """A compensator's file; what is not required was not written by earlier versions."""

    title: str
    reading: Quantity
    estimate: Quantity
    limits: list[float]
    rates: bool
    longest: NotRequired[float | None]
    inputs: NotRequired[list[float]]
    start: float | None
    tree: dict[str, Any]
    error: dict[str, Any] | None
    guard: NotRequired[dict[str, Any] | None]
    starts: NotRequired[list[list[dict[str, Any]]]]
    origin: NotRequired[Origin | None]
    condition: NotRequired[Condition | None]
    coverage: NotRequired[float | None]
    lasting: NotRequired[Lasting | None]
    band: NotRequired[Band | None]
    operations: NotRequired[Operations | None]
    golden: Golden


def check(value: Any, kind: Any, place: str = "") -> None:
    """Raise `TypeError` where plain data are not what an annotation says. NaN is not a number here."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        if value is not None or type(None) not in inner:
            check(value, inner[0], place)
    elif is_typeddict(kind) and isinstance(value, dict):
        check_fields(value, get_type_hints(kind), place, kind.__required_keys__)
    elif origin is list and isinstance(value, list):
        for k, part in enumerate(value):
            check(part, inner[0], f"{place}.{k}")
    elif kind is float:
        if type(value) not in (int, float) or isnan(value):
            raise TypeError(f"{place} is {value!r:.40}")
    elif type(value) is not (origin or kind) and kind is not Any:
        raise TypeError(f"{place} is {value!r:.40}")


def check_fields(values: dict[str, Any], hints: dict[str, Any], place: str, needed: Any) -> None:
    """`check` of each value by its name; further values are not looked at."""
    for name, kind in hints.items():
        if name in values:
            check(values[name], kind, f"{place}.{name}".lstrip("."))
        elif name in needed:
            raise TypeError(f"{place}.{name} is missing".lstrip("."))
