"""hysid: from a test rig's CSV to a compensator that can be trusted inside a robot.

The names people use most, in one place; each loads its package when first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compensate import invert as invert
    from hysid.armor._calibration import calibrate_armor as calibrate_armor
    from hysid.armor._calibration import choose_presses as choose_presses
    from hysid.soft_sensor._force_records import ForceRecord as ForceRecord
    from hysid.soft_sensor._force_training import train_force as train_force
    from hysid.soft_sensor._positions import fit_positions as fit_positions
    from hysid.soft_sensor._sensor_file import load_sensor as load_sensor
    from hysteresis import BoucWen as BoucWen
    from hysteresis import Burgers as Burgers
    from hysteresis import DegradingBoucWen as DegradingBoucWen
    from hysteresis import FoamCurve as FoamCurve
    from hysteresis import GeneralizedKelvinVoigt as GeneralizedKelvinVoigt
    from hysteresis import GeneralizedMaxwell as GeneralizedMaxwell
    from hysteresis import InputError as InputError
    from hysteresis import KrasnoselskiiPokrovskii as KrasnoselskiiPokrovskii
    from hysteresis import LinearSponge as LinearSponge
    from hysteresis import PrandtlIshlinskii as PrandtlIshlinskii
    from hysteresis import Preisach as Preisach
    from hysteresis import Record as Record
    from hysteresis import StandardLinearSolid as StandardLinearSolid
    from hysteresis import read_csv as read_csv
    from hysteresis.preisach import GaussianDensity as GaussianDensity
    from hysteresis.preisach import GridDensity as GridDensity
    from hysteresis.preisach import LorentzianDensity as LorentzianDensity
    from identify import change as change
    from identify import compare as compare
    from identify import everett_surface as everett_surface
    from identify import fit as fit
    from identify import fit_many as fit_many
    from identify import fit_step as fit_step
    from identify import forc_curves as forc_curves
    from identify import forc_diagram as forc_diagram
    from identify import load as load
    from identify import pool as pool
    from identify import sample as sample
    from identify import save as save
    from identify import spectrum as spectrum

_HOME = {
    "compensate": ("invert",),
    "hysteresis": (
        "BoucWen",
        "Burgers",
        "DegradingBoucWen",
        "FoamCurve",
        "GeneralizedKelvinVoigt",
        "GeneralizedMaxwell",
        "InputError",
        "KrasnoselskiiPokrovskii",
        "LinearSponge",
        "PrandtlIshlinskii",
        "Preisach",
        "Record",
        "StandardLinearSolid",
        "read_csv",
    ),
    "hysteresis.preisach": ("GaussianDensity", "GridDensity", "LorentzianDensity"),
    "identify": (
        "change",
        "compare",
        "everett_surface",
        "fit",
        "fit_many",
        "fit_step",
        "forc_curves",
        "forc_diagram",
        "load",
        "pool",
        "sample",
        "save",
        "spectrum",
    ),
    "hysid.armor._calibration": ("calibrate_armor", "choose_presses"),
    "hysid.soft_sensor._force_records": ("ForceRecord",),
    "hysid.soft_sensor._force_training": ("train_force",),
    "hysid.soft_sensor._positions": ("fit_positions",),
    "hysid.soft_sensor._sensor_file": ("load_sensor",),
}
_PACKAGE = {name: package for package, names in _HOME.items() for name in names}
__all__ = sorted(_PACKAGE)


def __getattr__(name: str) -> Any:
    if name not in _PACKAGE:
        raise AttributeError(f"module 'hysid' has no attribute {name!r}")
    return getattr(import_module(_PACKAGE[name]), name)


def __dir__() -> list[str]:
    return __all__
