"""Fitted models run backwards.

`compensate.runtime` runs without JAX, so this package loads the rest when a name of it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .runtime._status import Status as Status

if TYPE_CHECKING:
    from ._calibrated import CalibratedCompensator as CalibratedCompensator
    from ._calibrated import calibrated as calibrated
    from ._dead_band import DeadBandCompensator as DeadBandCompensator
    from ._ensemble import EnsembleCompensator as EnsembleCompensator
    from ._ensemble import UncertainEstimate as UncertainEstimate
    from ._export import Exported as Exported
    from ._export import Quantity as Quantity
    from ._export import export_c as export_c
    from ._export import export_runtime as export_runtime
    from ._filtered import FilteredCompensator as FilteredCompensator
    from ._flat import FlatInterval as FlatInterval
    from ._flat import flat_intervals as flat_intervals
    from ._inverses import AbstractCompensator as AbstractCompensator
    from ._inverses import BracketedCompensator as BracketedCompensator
    from ._inverses import Estimate as Estimate
    from ._inverses import invert as invert
    from ._loops import Loop as Loop
    from ._loops import loop_widths as loop_widths
    from ._qualify import Qualification as Qualification
    from ._qualify import qualify as qualify

_HOME = {
    "_inverses": ("AbstractCompensator", "BracketedCompensator", "Estimate", "invert"),
    "_ensemble": ("EnsembleCompensator", "UncertainEstimate"),
    "_calibrated": ("CalibratedCompensator", "calibrated"),
    "_dead_band": ("DeadBandCompensator",),
    "_filtered": ("FilteredCompensator",),
    "_flat": ("FlatInterval", "flat_intervals"),
    "_loops": ("Loop", "loop_widths"),
    "_qualify": ("Qualification", "qualify"),
    "_export": ("Exported", "Quantity", "export_c", "export_runtime"),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}
__all__ = sorted([*_MODULE, "Status"])


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import_module("._inverses", __name__)
    return getattr(import_module(f".{_MODULE[name]}", __name__), name)


def __dir__() -> list[str]:
    return __all__
