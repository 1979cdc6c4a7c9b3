"""hysid: from a test rig's CSV to a compensator that can be trusted inside a robot.

The names people use most, in one place; each loads its package when first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compensate import invert as invert
    from hysteresis import Burgers as Burgers
    from hysteresis import InputError as InputError
    from hysteresis import LinearSponge as LinearSponge
    from hysteresis import Preisach as Preisach
    from hysteresis import Record as Record
    from hysteresis import read_csv as read_csv
    from hysteresis.preisach import GridDensity as GridDensity
    from identify import fit as fit
    from identify import load as load
    from identify import sample as sample
    from identify import save as save

_HOME = {
    "compensate": ("invert",),
    "hysteresis": ("Burgers", "InputError", "LinearSponge", "Preisach", "Record", "read_csv"),
    "hysteresis.preisach": ("GridDensity",),
    "identify": ("fit", "load", "sample", "save"),
}
_PACKAGE = {name: package for package, names in _HOME.items() for name in names}
__all__ = sorted(_PACKAGE)


def __getattr__(name: str) -> Any:
    if name not in _PACKAGE:
        raise AttributeError(f"module 'hysid' has no attribute {name!r}")
    return getattr(import_module(_PACKAGE[name]), name)


def __dir__() -> list[str]:
    return __all__
