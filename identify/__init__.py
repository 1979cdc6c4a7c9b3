"""Learning a model from records: fits, posteriors, verdicts.

JAX takes a second to load, so each name loads its file when it is first used.
"""

# hysid:own-package, which hysid/_packages.py looks for

import inspect
from typing import Any

from hysteresis._lazy import loaded_late as _loaded_late


def _in_double(name: str, found: Any) -> Any:
    # Here, and not in their files: inside, one has called the other, and the precision is right. Of these
    # two the user's own JAX code is a part, which keeps its precision.
    if not inspect.isfunction(found) or name in ("calibrate", "train"):
        return found
    from hysteresis._precision import in_double  # late: it loads JAX

    return in_double(found)


__getattr__, __dir__, __all__ = _loaded_late(__name__, __file__, _in_double)
