"""The public names of compensate: type checkers read them here, and `__init__.py` loads each from here."""

from ._contract import AbstractCompensator as AbstractCompensator
from ._invert import invert as invert
from ._qualification import qualify as qualify
from ._readings import estimate as estimate
from .export._cards import material_card as material_card
from .export._export import Quantity as Quantity
from .export._export import export_c as export_c
from .export._export import export_runtime as export_runtime
from .export.targets._export_to import export_to as export_to
from .inverses import inverse_of as inverse_of
from .recalibration._setup import adaptive as adaptive
from .runtime._status import Status as Status
from .uncertainty._calibrated import calibrated as calibrated
from .uncertainty._ensemble import filtered as filtered
from .uncertainty._guaranteed import flat_intervals as flat_intervals
from .uncertainty._guaranteed import guaranteed as guaranteed
