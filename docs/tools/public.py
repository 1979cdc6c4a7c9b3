"""The public names of every package, and the one page on which each is documented."""

import importlib
import inspect
from typing import Any

PACKAGES = (
    "hysteresis",
    "hysteresis.preisach",
    "hysteresis.networks",
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


def directives(package: str, names: list[str]) -> str:
    """The lines by which Sphinx documents these names of a package.

    Raises `KeyError` where the package is not the home of one.
    """
    homes = public_names()
    lines = []
    for name in names:
        kind = "class" if inspect.isclass(homes[f"{package}.{name}"]) else "function"
        lines.append(f".. auto{kind}:: {package}.{name}")
    return "\n".join(lines) + "\n"
