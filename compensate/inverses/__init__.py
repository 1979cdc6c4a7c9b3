"""Exact inverses, one file per model: each registers with `inverse_of` as it is imported."""

from . import _bouc_wen as _bouc_wen
from . import _compose as _compose
from . import _conditioned as _conditioned
from . import _curves as _curves
from . import _default as _default
from . import _degrading_bouc_wen as _degrading_bouc_wen
from . import _duhem as _duhem
from . import _linear_sponge as _linear_sponge
from . import _moving_preisach as _moving_preisach
from . import _oscillator as _oscillator
from . import _output_dependent as _output_dependent
from . import _prandtl_ishlinskii as _prandtl_ishlinskii
from . import _preisach as _preisach
from . import _viscoelastic as _viscoelastic
from ._bisection import BracketedCompensator as BracketedCompensator
from ._inverse_of import inverse_of as inverse_of
