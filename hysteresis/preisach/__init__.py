"""The Preisach model, its densities and its memory."""

from ._coercive import GaussianDensity as GaussianDensity
from ._coercive import LorentzianDensity as LorentzianDensity
from ._dead_band import input_noise as input_noise
from ._density import GridDensity as GridDensity
from ._memory import Initial as Initial
from ._memory import memory_tree as memory_tree
from ._preisach import Preisach as Preisach
