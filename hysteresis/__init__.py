"""What a material or a sensor does: models with memory, records of measurements, virtual rigs.

`hysteresis.laws` runs without JAX, so each name loads its file when it is first used.
"""

# hysid:own-package, which hysid/_packages.py looks for

from importlib import import_module
from typing import Any

from ._lazy import homes as _homes

_HOME = _homes(__file__)
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(_HOME[name], __name__)
    return globals().setdefault(name, getattr(module, name, module))


def __dir__() -> list[str]:
    return __all__
