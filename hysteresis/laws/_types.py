"""Whether plain data are what annotations say."""

from math import isnan
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints, is_typeddict


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
