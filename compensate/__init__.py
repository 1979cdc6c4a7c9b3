"""Fitted models run backwards.

`compensate.runtime` runs without JAX, so each name loads its file when it is first used.
"""

# hysid:own-package, which hysid/_packages.py looks for

import inspect
from typing import Any

from hysteresis._lazy import loaded_late as _loaded_late


def _in_own_precision(_: str, found: Any) -> Any:
    if not inspect.isfunction(found):
        return found
    # late: it loads JAX, and the runtime of this package does without
    from hysteresis._precision import in_own_precision

    return in_own_precision(found)


__getattr__, __dir__, __all__ = _loaded_late(__name__, __file__, _in_own_precision)
