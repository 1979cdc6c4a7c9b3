"""All inverses: each module registers those of its models with `invert`."""

from ._contract import AbstractCompensator as AbstractCompensator
from ._contract import Estimate as Estimate
from ._contract import invert as invert
from .inverses import _bouc_wen as _bouc_wen
from .inverses import _compose as _compose
from .inverses import _curves as _curves
from .inverses import _degrading_bouc_wen as _degrading_bouc_wen
from .inverses import _output_dependent as _output_dependent
from .inverses import _prandtl_ishlinskii as _prandtl_ishlinskii
from .inverses import _preisach as _preisach
from .inverses import _viscoelastic as _viscoelastic
from .inverses._bisection import BracketedCompensator as BracketedCompensator
