"""What a compensator's document holds, as types."""

from typing import Any, NotRequired, TypedDict


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
