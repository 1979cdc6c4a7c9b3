"""Fitted models run backwards.

`compensate.runtime` runs without JAX, so each name loads its file when it is first used.
"""

# hysid:own-package, which hysid/_packages.py looks for

import inspect
from importlib import import_module
from typing import Any

from hysteresis._lazy import homes as _homes

_HOME = _homes(__file__)
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOME[name], __name__), name)
    if inspect.isfunction(found):
        # late: it loads JAX, and the runtime of this package does without
        from hysteresis._precision import in_own_precision

        found = in_own_precision(found)
    return globals().setdefault(name, found)


def __dir__() -> list[str]:
    return __all__
