"""Fitted models run backwards.

`compensate.runtime` runs without JAX, so this package loads the rest when a name of it is first used.
"""

# hysid:own-package, which hysid/_packages.py looks for

import inspect
from importlib import import_module
from typing import TYPE_CHECKING, Any

from .runtime._status import Status as Status

if TYPE_CHECKING:
    from ._contract import AbstractCompensator as AbstractCompensator
    from ._contract import Estimate as Estimate
    from ._estimate import estimate as estimate
    from ._invert import invert as invert
    from .export._export import Exported as Exported
    from .export._export import Origin as Origin
    from .export._export import Quantity as Quantity
    from .export._export import export_c as export_c
    from .export._export import export_runtime as export_runtime
    from .export.targets._export_to import export_to as export_to
    from .guards._guarded import GuardedCompensator as GuardedCompensator
    from .guards._run_in import Past as Past
    from .inverses import BracketedCompensator as BracketedCompensator
    from .inverses import inverse_of as inverse_of
    from .qualification._loop_widths import Loop as Loop
    from .qualification._loop_widths import loop_widths as loop_widths
    from .qualification._qualify import Qualification as Qualification
    from .qualification._qualify import qualify as qualify
    from .recalibration._adaptive import AdaptiveCompensator as AdaptiveCompensator
    from .recalibration._adaptive import Recalibrated as Recalibrated
    from .recalibration._recursion import Advice as Advice
    from .recalibration._setup import adaptive as adaptive
    from .uncertainty._calibrated import CalibratedCompensator as CalibratedCompensator
    from .uncertainty._calibrated import LeftOut as LeftOut
    from .uncertainty._calibrated import calibrated as calibrated
    from .uncertainty._dead_band import DeadBandCompensator as DeadBandCompensator
    from .uncertainty._ensemble import EnsembleCompensator as EnsembleCompensator
    from .uncertainty._ensemble import UncertainEstimate as UncertainEstimate
    from .uncertainty._filtered import FilteredCompensator as FilteredCompensator
    from .uncertainty._flat_intervals import FlatInterval as FlatInterval
    from .uncertainty._flat_intervals import flat_intervals as flat_intervals
    from .uncertainty._guaranteed import BandedEstimate as BandedEstimate
    from .uncertainty._guaranteed import GuaranteedCompensator as GuaranteedCompensator
    from .uncertainty._guaranteed import guaranteed as guaranteed
    from .uncertainty._guaranteed import runs_needed as runs_needed

_HOME = {
    "_contract": ("AbstractCompensator", "Estimate"),
    "_estimate": ("estimate",),
    "_invert": ("invert",),
    "inverses": ("BracketedCompensator", "inverse_of"),
    "guards._guarded": ("GuardedCompensator",),
    "guards._run_in": ("Past",),
    "uncertainty._ensemble": ("EnsembleCompensator", "UncertainEstimate"),
    "uncertainty._calibrated": ("CalibratedCompensator", "LeftOut", "calibrated"),
    "uncertainty._dead_band": ("DeadBandCompensator",),
    "uncertainty._filtered": ("FilteredCompensator",),
    "uncertainty._guaranteed": (
        "BandedEstimate",
        "GuaranteedCompensator",
        "guaranteed",
        "runs_needed",
    ),
    "uncertainty._flat_intervals": ("FlatInterval", "flat_intervals"),
    "recalibration._adaptive": ("AdaptiveCompensator", "Recalibrated"),
    "recalibration._recursion": ("Advice",),
    "recalibration._setup": ("adaptive",),
    "qualification._loop_widths": ("Loop", "loop_widths"),
    "qualification._qualify": ("Qualification", "qualify"),
    "export._export": ("Exported", "Origin", "Quantity", "export_c", "export_runtime"),
    "export.targets._export_to": ("export_to",),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}
__all__ = sorted([*_MODULE, "Status"])


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f".{_MODULE[name]}", __name__), name)
    if inspect.isfunction(found):
        # late: it loads JAX, and the runtime of this package does without
        from hysteresis._precision import in_own_precision

        found = in_own_precision(found)
    return globals().setdefault(name, found)


def __dir__() -> list[str]:
    return __all__
