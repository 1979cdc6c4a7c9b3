"""All inverses: each module registers those of its models with `invert`."""

from . import _bouc_wen as _bouc_wen
from . import _compose as _compose
from . import _curves as _curves
from . import _degrading_bouc_wen as _degrading_bouc_wen
from . import _moving as _moving
from . import _output_dependent as _output_dependent
from . import _prandtl_ishlinskii as _prandtl_ishlinskii
from . import _preisach as _preisach
from . import _sponge as _sponge
from . import _viscoelastic as _viscoelastic
from ._bracketed import BracketedCompensator as BracketedCompensator
from ._compensator import AbstractCompensator as AbstractCompensator
from ._compensator import Estimate as Estimate
from ._compensator import invert as invert
