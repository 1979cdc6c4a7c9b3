"""Fields of an armor's cover: one text for `compensate.armor` and for plain Python, see `_arithmetic`."""

from collections.abc import Callable
from typing import Any

from . import _arithmetic as plain
from ._arithmetic import Arithmetic, Numbers, Real
from ._contact import square

Vector = tuple[float, float, float]
Field = Callable[[int, Vector], float]


def field(document: dict[str, Any]) -> tuple[Field, bool]:
    """A field of the cover, and whether it is the same all over a surface."""
    kind = document["kind"]
    if kind == "uniform":
        value = document["value"]
        if isinstance(value, list):
            return lambda surface, point: value[surface - 1], True
        return lambda surface, point: value, True
    centre = document["centre"]
    if kind == "bumps":
        amplitude, width, base = (document[name] for name in ("amplitude", "width", "base"))

        def bumps(surface: int, point: Vector) -> float:
            k = surface - 1
            return bump(plain, base[k], amplitude[k], width, centre[k], point)

        return bumps, False
    raise ValueError(f"no field {kind!r}")


def bump(
    o: Arithmetic, base: Real, amplitude: Real, width: Real, centre: Numbers, point: Numbers
) -> Real:
    """`compensate.armor.Bumps` on one surface."""
    return base + amplitude * o.exp(-square(point, centre) / (2 * width * width))
