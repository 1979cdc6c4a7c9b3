"""The public names of every package, and the one page on which each is documented."""

import importlib
import inspect
import re
from collections.abc import Iterator
from functools import cache
from typing import Any, get_args

PACKAGES = (
    "hysteresis",
    "hysteresis.preisach",
    "hysteresis.curves",
    "hysteresis.testing",
    "hysteresis.rigs",
    "identify",
    "compensate",
    "compensate.armor",
    "compensate.microchannel",
    "compensate.runtime",
    "hysid",
    "hysid.plots",
)
OWN = ("hysteresis", "identify", "compensate", "hysid")


def public_names() -> dict[str, Any]:
    """Every class and function by its home, the first package of the list that has it."""
    homes: dict[str, Any] = {}
    seen: set[int] = set()
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in dir(module):
            value = getattr(module, name)
            own = getattr(value, "__module__", None) or ""
            named = inspect.isclass(value) or inspect.isfunction(value) or callable(value)
            if name.startswith("_") or not named or own.split(".")[0] not in OWN:
                continue
            if (
                package == "hysid.plots"
                and own != package
                and not own.startswith(("hysid.figures._base", "hysid.figures._diagnostics"))
            ):
                continue
            if id(value) not in seen:
                seen.add(id(value))
                homes[f"{package}.{name}"] = value
    return homes


@cache
def received() -> dict[str, list[type]]:
    """By public name, the types that it gives back and that are no public names, each once."""
    homes = public_names()
    seen = {id(value) for value in homes.values()}
    found: dict[str, list[type]] = {}
    for home, value in homes.items():
        open_ = [value]
        while open_:
            for one in _given_back(open_.pop()):
                if id(one) not in seen:
                    seen.add(id(one))
                    open_.append(one)
                    found.setdefault(home, []).append(one)
    return found


def _given_back(value: Any) -> Iterator[type]:
    """What a function returns; of a class its fields, properties and methods, if they are of its folder or
    of no folder inside their package."""
    notes = [getattr(value, "__annotations__", {}).get("return")]
    if inspect.isclass(value):
        members = [
            getattr(x, "fget", getattr(x, "func", x))
            for k, x in vars(value).items()
            if not k.startswith("_")
        ]
        notes = [*vars(value).get("__annotations__", {}).values()]
        notes += [getattr(x, "__annotations__", {}).get("return") for x in members]
    while notes:
        note = notes.pop()
        notes += get_args(note)
        own = inspect.isclass(note) and note.__module__.split(".")[0] in OWN
        if not own or not note.__doc__ or re.search("^_|^Abstract|(State|Input)$", note.__name__):
            continue
        if not inspect.isclass(value) or _folder(note) in (_folder(value), *OWN):
            yield note


def _folder(value: type) -> str:
    return value.__module__.rpartition(".")[0]


def directives(package: str, names: list[str]) -> str:
    """The lines by which Sphinx documents these names of a package, and what only they give back.

    Raises `KeyError` where the package is not the home of one.
    """
    homes = public_names()
    lines = []
    for name in names:
        kind = "class" if inspect.isclass(homes[f"{package}.{name}"]) else "function"
        lines.append(f".. auto{kind}:: {package}.{name}")
        for one in received().get(f"{package}.{name}", ()):
            lines.append(f".. autoclass:: {one.__module__}.{one.__qualname__}")
    return "\n".join(lines) + "\n"
